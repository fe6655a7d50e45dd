"""Reactions of the walker to a step with too small a static margin.

In this order: the trunk moves over the feet that will stand while all of them still do; a gait that lifts fewer legs;
a shorter step, of a leaning gait another leg; refusal. The gait of the command returns after one cycle of the other.
"""

import math

import numpy as np

from surefoot.arrays import Array
from surefoot.geometry import rotations
from surefoot.geometry.linear import product
from surefoot.kernels.jit import kernel
from surefoot.robot import kinematics

from ..interface import BodyPose, StanceVerdict
from . import planning, posture
from .params import WalkerParams
from .patterns import HEXAPOD_GAITS, GaitPattern
from .planning import PlanningContext
from .standins import ring_of
from .state import Stage, WalkerState

SWEEPS = 200
FEASIBLE = 1e-5  # m
PARTS = (1.0, 0.75, 0.5, 0.25)  # of a shift or of the wanted margin, tried in this order
LEG_SHARE = 1.2  # way of the trunk per way of the centre of mass: the standing legs stay behind
LEAN_ROUNDS = 2  # the legs move with the trunk, which moves the centre of mass a little: twice is within 1 mm
LEAST_SHIFT = 0.001  # m; a shorter one changes nothing


@kernel
def nearest_inside(edges: Array, slack: Array, wanted: float) -> tuple[Array, bool]:
    """Return the shortest shift t, (2,) m, with slack_k - n_k't >= wanted for all edges, and True if it was found.

    Hildreth's method.

    Args:
        edges: outward unit normals n_k of the edges of a convex region, (k, 2).
        slack: distance inside each edge before the shift, (k,) m.
        wanted: least distance inside after it, m.
    """
    push = np.zeros(slack.size)
    t = np.zeros(2)
    for _ in range(SWEEPS):
        worst = 0.0
        for k in range(slack.size):
            over = edges[k, 0] * t[0] + edges[k, 1] * t[1] - slack[k] + wanted
            worst = max(worst, over)
            step = max(-push[k], over)
            push[k] += step
            t[0] -= step * edges[k, 0]
            t[1] -= step * edges[k, 1]
        if worst <= FEASIBLE:
            return t, True
    return t, False


def hull_edges(ring: Array) -> tuple[Array, Array]:
    """Return outward unit normals n_k (k, 2) of the edges of a ring (n, 2) m, and n_k'p of a point p on each, (k,) m.

    The ring is counter-clockwise; edges without length are left out.
    """
    along = np.roll(ring, -1, axis=0) - ring
    length = np.hypot(along[:, 0], along[:, 1])
    keep = length > 1e-9
    edges = np.column_stack((along[keep, 1], -along[keep, 0])) / length[keep, None]
    return edges, (edges * ring[keep]).sum(axis=1)


def shift_into(reply: StanceVerdict, wanted: float) -> Array | None:
    """Return the shortest shift of the centre of mass, (2,) m, map, to a margin `wanted`, m; None = no such shift.

    The margin holds before and after the movement. Where the region has no room for it, a part of it is taken.
    """
    if reply.region is None or reply.com is None or reply.com_after is None or len(reply.region) < 3:
        return None
    ring = reply.region
    edges, reach = hull_edges(ring)
    slack = reach - np.maximum(product(edges, reply.com), product(edges, reply.com_after))
    worst = float(slack.min())
    for part in PARTS:
        shift, found = nearest_inside(edges, slack, worst + part * (wanted - worst))
        if found:
            return shift
    return None


def react(state: WalkerState, frame: PlanningContext, begin: BodyPose, reply: StanceVerdict) -> bool:
    """React to the check of a step, e.g. to a small margin; return True if the step may be taken as planned.

    Args:
        state: a new goal of the trunk, gait or scale, and the reason in words, are written to it.
        frame: robot, settings, ground.
        begin: pose of the trunk from which it would move over its feet.
        reply: result of the check of the step.
    """
    s, p = state, frame.params
    margin = reply.margin if reply.margin is not None else -math.inf
    told = f"margin {1e3 * margin:.0f} mm" if reply.margin is not None else f"status {reply.status}"
    if s.shifts < p.max_shifts:
        s.shifts += 1
        shift = shift_into(reply, p.wanted_margin_m)
        if shift is not None and _aim(s, frame, begin, LEG_SHARE * shift):
            s.reason = f"{told} is low: the trunk moves by {1e3 * math.hypot(*(s.goal - s.body[:2])):.0f} mm"  # pyright: ignore[reportOptionalOperand]
            return False
    if reply.stable and margin >= p.least_margin_m:
        return True
    if s.gait.careful is not None:
        s.gait = HEXAPOD_GAITS[s.gait.careful]
        s.group, s.shifts, s.careful_steps = lagging(s, frame), 0, 0
        s.reason = f"{told} is low: {s.gait.name} gait"
        return False
    if reply.stable:
        return True
    if s.gait.leans:  # a shorter step stands on the same three feet; one of them may have to step first
        s.group, s.shifts = (s.group + 1) % s.gait.steps_per_cycle, 0
    else:
        s.scale *= 0.5
    s.reason = f"step would not be stable (status {reply.status}, {told})"
    return False


def _aim(state: WalkerState, frame: PlanningContext, begin: BodyPose, shift: Array) -> bool:
    """Set the trunk's goal as near to the shifted position as all legs reach; return True if there is one.

    `shift`: from the pose `begin`, (2,) m, frame map; cut to the longest movement that the settings allow.
    """
    size = float(np.hypot(shift[0], shift[1]))
    if size < LEAST_SHIFT:
        return False
    shift = shift * min(1.0, frame.params.shift_limit_m / size)
    for part in PARTS:
        goal = BodyPose(begin.x + part * float(shift[0]), begin.y + part * float(shift[1]), begin.z, begin.yaw)
        if planning.reaches(frame, begin, goal, state.footholds, 1.0):
            _head_for(state, np.array([goal.x, goal.y]))
            return True
    return False


def _head_for(state: WalkerState, goal: Array) -> None:
    """Set the trunk's goal, (2,) m, frame map; feet in contact may again be lowered by the full search depth."""
    state.goal = goal
    state.hanging[state.contacts] = 0
    state.sunk[state.contacts] = 0.0


def lean(state: WalkerState, frame: PlanningContext, legs: tuple[int, ...], place: BodyPose) -> BodyPose:
    """Return the trunk pose with the centre of mass over the feet that stand while `legs` swing.

    It is the pose nearest to the present lean at which the centre of mass has the margin `lean_margin_m` in the hull of
    these feet, or a part of that margin where the hull has no room. After half of the tries that a step gets, half of
    the margin is wanted, then a quarter: wide leans may be out of the legs' reach.

    Args:
        state: state of the walker; not changed.
        frame: robot, settings, ground.
        legs: numbers of the legs that will swing.
        place: place of the trunk at the end of the step without leaning, map.
    """
    s, model = state, frame.robot.model
    standing = [i for i in range(frame.robot.nlegs) if i not in legs]
    edges, bounds = hull_edges(ring_of(planning.contacts(frame, s.footholds[standing])[0][:, :2]))
    rot = rotations.matrix_from_rpy(s.level[0], s.level[1], place.yaw)
    at = np.array([place.x, place.y]) + planning.rotated(place.yaw, s.lean[None])[0]
    late = s.attempts / frame.params.max_attempts
    parts = PARTS if late < 0.5 else tuple(p for p in PARTS if p <= (0.5 if late < 0.75 else 0.25))
    for _ in range(LEAN_ROUNDS):
        body = np.array([at[0], at[1], place.z])
        q = kinematics.legs_ik(model, posture.into_base(s.footholds, body, rot))[0]
        com = at + product(rot, kinematics.com(model, q))[:2]
        slack = bounds - product(edges, com)
        for part in parts:
            way, found = nearest_inside(edges, slack, part * frame.params.lean_margin_m)
            if found:
                at = at + way
                break
    return BodyPose(float(at[0]), float(at[1]), place.z, place.yaw)


def upright(state: WalkerState, place: BodyPose) -> bool:
    """Return True if the trunk leans to one side; then set `place`, its position without leaning, as its goal."""
    leans = math.hypot(state.lean[0], state.lean[1]) >= LEAST_SHIFT
    if leans:
        _head_for(state, np.array([place.x, place.y]))
        state.stage, state.plan = Stage.STAND, None
    return leans


def lean_time(begin: BodyPose, end: BodyPose, params: WalkerParams) -> float:
    """Return the duration T of a trunk movement over all feet, s; the distance d, m, follows 3 a^2 - 2 a^3, a = t / T.

    Its largest acceleration, 6 d / T^2 at the beginning, is `params.lean_acceleration`; T is at least `params.lean_s`.
    """
    way = math.hypot(end.x - begin.x, end.y - begin.y)
    return max(params.lean_s, math.sqrt(6.0 * way / params.lean_acceleration))


def shift(state: WalkerState, reach: float) -> None:
    """Move the trunk by at most `reach` (m) towards its goal over standing feet; clear the goal when it is reached."""
    s = state
    if s.goal is None:
        return
    way = s.goal - s.body[:2]
    left = float(np.hypot(way[0], way[1]))
    step = way * min(1.0, reach / max(left, 1e-12))
    s.body[:2] += step
    if s.gait.leans:
        s.lean += planning.rotated(-s.yaw, step[None])[0]
    if left <= reach:
        s.goal = None


def stand_at(state: WalkerState, frame: PlanningContext, now: BodyPose, shift: tuple[float, float]) -> str | None:
    """Set a goal for the standing trunk, `shift` m forward and left of the middle of its feet.

    Return the reason of a refusal in words; None: the goal is set.
    """
    s = state
    if s.stage is not Stage.STAND or s.route is not None or s.closing or s.recovering:
        return "the trunk is moved over its feet only while the robot stands"
    middle = s.footholds[:, :2].mean(axis=0) - planning.rotated(s.yaw, frame.neutral).mean(axis=0)
    goal = middle + planning.rotated(s.yaw, np.array([shift]))[0]
    end = BodyPose(float(goal[0]), float(goal[1]), now.z, now.yaw)
    if not (np.isfinite(goal).all() and planning.reaches(frame, now, end, s.footholds, 1.0)):
        return f"the legs do not reach their feet with the trunk shifted by ({shift[0]:g}, {shift[1]:g}) m"
    _head_for(s, goal)
    return None


def lagging(state: WalkerState, frame: PlanningContext) -> int:
    """Return the index of the group of legs that swings first: that farthest from neutral; just landed feet count 0."""
    off = state.footholds[:, :2] - state.body[:2] - planning.rotated(state.yaw, frame.neutral)
    far = np.hypot(off[:, 0], off[:, 1])
    far[list(state.swung)] = 0.0
    return int(np.argmax([far[list(group)].mean() for group in state.gait.groups]))


def relax(state: WalkerState, frame: PlanningContext) -> None:
    """Switch from the careful gait back to that of the command after a whole cycle; called after each step."""
    s = state
    s.shifts = 0
    if s.gait is s.usual:
        return
    s.careful_steps += 1
    if s.careful_steps >= s.gait.steps_per_cycle:
        s.gait = s.usual
        s.group = lagging(s, frame)


def usual(state: WalkerState, gait: GaitPattern) -> None:
    """Set the gait that a command requests, also as the one to return to after a careful gait."""
    state.gait = state.usual = gait
    state.group %= gait.steps_per_cycle
