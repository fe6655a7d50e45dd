"""Plan of one step before it is taken: motion of the trunk, landings of the feet, reach of the legs."""

import math
from dataclasses import dataclass, replace

import numpy as np

from surefoot.arrays import Array, Flags
from surefoot.geometry import rotations
from surefoot.geometry.linear import product
from surefoot.robot import kinematics
from surefoot.robot.description import Robot

from ..interface import Advance, BodyPose, FootholdRequest, LandingRequest, StanceCheck
from . import posture, swing
from .ground import Ground, Rectangle
from .params import WalkerParams
from .patterns import GaitPattern
from .route import moved
from .swing import SwingShape

HEIGHT_TRIALS = tuple(0.005 * k for n in range(9) for k in ((n, -n) if n else (0,)))  # m, nearest first
FURTHER_TRIALS = tuple(0.005 * k for n in range(9, 17) for k in (n, -n))  # m, of a trunk that stands too high or low


@dataclass(frozen=True, eq=False)
class PlanningContext:
    """Inputs of the planning of a step that do not change during it: robot, settings, ground, neutral feet."""

    robot: Robot
    params: WalkerParams
    ground: Ground | None
    neutral: Array
    """Positions of the feet in the neutral posture relative to the trunk, heading axes, (L, 2) m."""


@dataclass(frozen=True, eq=False)
class StepPlan:
    """A planned step: swinging feet, their paths, and the motion of the trunk from one pose to another."""

    swing: Flags
    """True for each leg that swings in the step, False for each that stands, (L,)."""
    begin: BodyPose
    end: BodyPose
    feet_from: Array
    """Positions of the foot centres at lift-off, (L, 3) m, map frame."""
    feet_to: Array
    """Positions of the foot centres at touch-down, (L, 3) m, map frame; standing feet stay where they are."""
    deepest: Array
    """Least height to which each foot centre searches for the ground, (L,) m, map frame."""
    top: Array
    """Height of the foot centre on the level part of each swing, (L,) m, map frame."""
    go: Array
    arrive: Array
    """Swing phase, 0..1, at which each foot's sideways movement ends, (L,); it begins at phase `go`."""
    duration: float
    """Duration of the step without the lean, s: half a gait period, in a gait that leans 0.675 of one, or longer when a
    foot has far to descend."""
    shape: SwingShape
    """Phases of the swings, and height of the slow approach."""
    lean: float = 0.0
    """Time before the swing in which the trunk moves to its end pose on all feet, s; 0 = it moves during the whole
    step."""


def rotated(yaw: float, vectors: Array) -> Array:
    """Return vectors in the plane, (n, 2), any unit, turned by `yaw` rad, (n, 2)."""
    c, s = math.cos(yaw), math.sin(yaw)
    return product(vectors, np.array([[c, s], [-s, c]]))


def centre_height(frame: PlanningContext, x: float, y: float, feet: Array) -> float:
    """Return the height of a foot centre that stands at (x, y) m, frame map; the mean of the feet where unknown.

    `feet`: foot centres now, (L, 3) m, map.
    """
    z = frame.ground.centre_height(x, y) if frame.ground is not None else float("nan")
    return z if np.isfinite(z) else float(np.mean(feet[:, 2]))


def landings(
    frame: PlanningContext, gait: GaitPattern, legs: tuple[int, ...], end: BodyPose, after: Advance, feet: Array
) -> Array:
    """Return nominal landings of n legs, (n, 3) m, map: neutral feet about the trunk `gait.lead` steps after this step.

    Args:
        frame: robot, settings, ground.
        gait: gives the number of steps by which a landing is ahead.
        legs: numbers of the legs that swing.
        end: pose of the trunk after this step.
        after: movement of the trunk in each step after it.
        feet: foot centres now, (L, 3) m, map: their mean height stands for ground that is not known.
    """
    ahead = moved(end, after, gait.lead)
    xy = rotated(ahead.yaw, frame.neutral[list(legs)]) + np.array([ahead.x, ahead.y])
    return np.array([[x, y, centre_height(frame, x, y, feet)] for x, y in xy])


def foothold_request(
    legs: tuple[int, ...], nominal: Array, end: BodyPose, after: Advance, gait: GaitPattern
) -> LandingRequest:
    """Return the request to the foothold service for all legs of the step.

    Args:
        legs: numbers of the n legs that swing.
        nominal: nominal landings of their foot centres, frame map, (n, 3) m.
        end: pose of the trunk after the step.
        after: movement of the trunk in each step after it.
        gait: gives the number of steps for which a foot stands.
    """
    stance_steps = 2.0 * gait.lead
    x, y = rotated(end.yaw, np.array([[after.forward, after.left]]))[0] * -stance_steps
    return LandingRequest(
        body=(end.x, end.y, end.z),
        yaw=end.yaw,
        legs=tuple(
            FootholdRequest(leg=leg, nominal=(float(p[0]), float(p[1]), float(p[2])), stroke=(float(x), float(y), 0.0))
            for leg, p in zip(legs, nominal, strict=True)
        ),
    )


def trunk_height(frame: PlanningContext, feet: Array, at: BodyPose, shift: float) -> float:
    """Return the height of base_link, m, map: mean ground under the feet + hip height + shift, clear of the ground.

    `feet`: foot centres, (L, 3) m, map; `at`: place and heading of the trunk; `shift`: asked for, m.
    """
    robot, params = frame.robot, frame.params
    z = float(np.mean(feet[:, 2])) - robot.foot_radius + params.hip_height_m + shift
    if frame.ground is not None:
        half = 0.5 * robot.trunk.box
        highest = frame.ground.highest_under(Rectangle(at.x, at.y, at.yaw, float(half[0]), float(half[1])))
        if np.isfinite(highest):
            z = max(z, highest + params.belly_m + float(half[2]))
    return z


def swing_tops(frame: PlanningContext, legs: tuple[int, ...], feet: Array, feet_to: Array) -> tuple[Array, Array]:
    """Return the swept ground (n, 13) and the height of the level part (n,) of the swings of n legs, m, map.

    Swept ground: lowest admissible height of the foot centre in 13 sections of the path, NaN = unknown. `feet`,
    `feet_to`: foot centres at lift-off and at landing, (L, 3) m, map.
    """
    swept = np.full((len(legs), swing.SAMPLES), np.nan)
    if frame.ground is not None:
        for k, leg in enumerate(legs):
            swept[k] = swing.swept_ground(frame.ground.centres, feet[leg], feet_to[leg], frame.params.corridor_m)
    clearance = frame.params.clearance_m
    top = np.array([swing.top_of(feet[leg], feet_to[leg], swept[k], clearance) for k, leg in enumerate(legs)])
    return swept, top


def apex(legs: tuple[int, ...], feet: Array, feet_to: Array, top: Array) -> Array:
    """Return the foot centres in the middle of the swings of n legs at their tops, (L, 3) m, map.

    `feet`, `feet_to`: foot centres at lift-off and at landing, (L, 3) m; `top`: height of each swing, (n,) m.
    """
    high, some = feet_to.copy(), list(legs)
    high[some] = 0.5 * (feet[some] + feet_to[some])
    high[some, 2] = top
    return high


def end_pose(
    frame: PlanningContext,
    begin: BodyPose,
    planar: BodyPose,
    feet: Array,
    feet_to: Array,
    apex: Array,
    shift: float,
    leans: bool,
) -> BodyPose | None:
    """Return the trunk pose at the end of the step, at the wanted or the nearest reachable height; None = no such.

    Heights at which the swinging feet also reach the tops of their swings are preferred.

    Args:
        frame: robot, settings, ground.
        begin: the trunk now.
        planar: the trunk at the end; its height is not used.
        feet: foot centres now, (L, 3) m, map.
        feet_to: foot centres at the end, (L, 3) m.
        apex: foot centres at the tops of the swings, (L, 3) m.
        shift: change of the trunk's height that the foothold service asked for, m.
        leans: True if the trunk is at its end pose before the swing begins.
    """
    limit = frame.params.trunk_step_m
    wanted = trunk_height(frame, feet_to, planar, shift)
    wanted = begin.z + max(-limit, min(limit, wanted - begin.z))
    checks, top_part = (((feet, 1.0), (feet_to, 1.0)), 1.0) if leans else (((feet_to, 0.5), (feet_to, 1.0)), 0.5)
    second: BodyPose | None = None
    for trial in HEIGHT_TRIALS:
        end = BodyPose(planar.x, planar.y, wanted + trial, planar.yaw)
        if all(reaches(frame, begin, end, each, part) for each, part in checks):
            if reaches(frame, begin, end, apex, top_part):
                return end
            second = second or end
    return second


def height_in_reach(frame: PlanningContext, at: BodyPose, feet: Array) -> float | None:
    """Return the height of the trunk nearest to its present one at which all legs reach the feet that they stand on, m.

    None: they reach them as it is, or at no height.

    Args:
        frame: robot, settings, ground.
        at: the trunk now.
        feet: foot centres now, (L, 3) m, map.
    """
    for trial in HEIGHT_TRIALS + FURTHER_TRIALS:
        if reaches(frame, at, replace(at, z=at.z + trial), feet, 1.0):
            return at.z + trial if trial != 0.0 else None
    return None


def reaches(frame: PlanningContext, begin: BodyPose, end: BodyPose, feet: Array, part: float) -> bool:
    """Return True if all legs reach their `feet` (L, 3) m, map, after a `part` of the step, 0..1; level trunk."""
    a, b = begin, end
    body = np.array([a.x + part * (b.x - a.x), a.y + part * (b.y - a.y), a.z + part * (b.z - a.z)])
    rot = rotations.matrix_from_rpy(0.0, 0.0, a.yaw + part * (b.yaw - a.yaw))
    return bool(kinematics.legs_ik(frame.robot.model, posture.into_base(feet, body, rot))[1].all())


def complete(
    frame: PlanningContext,
    legs: tuple[int, ...],
    begin: BodyPose,
    end: BodyPose,
    feet: Array,
    feet_to: Array,
    swings: tuple[Array, Array],
    leans: bool,
) -> StepPlan:
    """Return the plan of the step with its swing paths over the whole swept ground.

    Args:
        frame: robot, ground and parameters.
        legs: numbers of the n legs that swing.
        begin: pose of the trunk before the step.
        end: pose of the trunk after it.
        feet: foot centres before the step, frame map, (L, 3) m.
        feet_to: foot centres after it, (L, 3) m.
        swings: swept ground (n, 13), NaN = unknown, and height of the level part (n,) of each swing, m.
        leans: True if the trunk is over the feet that stand before the swing; the foot then comes down more slowly.
    """
    n, params, (swept, highest) = feet.shape[0], frame.params, swings
    feet_to = feet_to.copy()
    feet_to[list(legs), 2] -= params.press_m
    fall = float(np.max(highest - feet_to[list(legs), 2]))
    duration = 0.5 * params.period_s * min(params.longest_step, max(1.0, fall / params.full_speed_fall_m))
    usual = SwingShape()
    if leans:
        usual, duration = swing.GENTLE, swing.GENTLE_TIME * duration
    slow = (1.0 - usual.fall_end) * (1.0 - 2.0 * params.overlap) * duration
    shape = usual._replace(approach=min(params.touch_speed * slow, 0.5 * params.clearance_m))
    swinging = np.zeros(n, dtype=np.bool_)
    top, go, arrive = np.zeros(n), np.zeros(n), np.ones(n)
    for k, leg in enumerate(legs):
        swinging[leg], top[leg] = True, highest[k]
        go[leg], arrive[leg] = swing.window(shape, feet[leg], feet_to[leg], highest[k], swept[k], params.margin_m)
    deepest = feet_to[:, 2] - params.search_m
    return StepPlan(swinging, begin, end, feet.copy(), feet_to, deepest, top, go, arrive, duration, shape)


def contacts(frame: PlanningContext, feet: Array) -> tuple[Array, Array]:
    """Return the points of the ground under standing feet, (n, 3) m, map, and its unit normals there, (n, 3).

    `feet`: foot centres, (n, 3) m, map.
    """
    r, ground = frame.robot.foot_radius, frame.ground
    up = np.array([0.0, 0.0, 1.0])
    normals = np.array([up if ground is None else ground.normal(p[0], p[1], p[2] - r) for p in feet])
    return feet - r * normals, normals


def check_request(frame: PlanningContext, plan: StepPlan, joints: Array, rot: Array) -> StanceCheck:
    """Return the request to the stability service: the standing feet and the trunk's movement over them.

    `joints`: angles before the step, (nj,) rad; `rot`: rotation from base_link to map, (3, 3).
    """
    positions, normals = contacts(frame, plan.feet_from[~plan.swing])
    begin, end = plan.begin, plan.end
    return StanceCheck(
        positions=positions,
        normals=normals,
        mu=frame.params.friction,
        joints=joints,
        base_position=np.array([begin.x, begin.y, begin.z]),
        base_quat=rotations.quat_from_matrix(rot),
        movement=(end.x - begin.x, end.y - begin.y, end.z - begin.z),
        legs=tuple(name for name, gone in zip(frame.robot.leg_names, plan.swing, strict=True) if not gone),
    )


def leant_request(frame: PlanningContext, plan: StepPlan, level: Array) -> StanceCheck:
    """Return the request to the stability service for a step whose trunk moves to its end before a foot lifts.

    Args:
        frame: robot, settings, ground.
        plan: the step.
        level: commanded roll and pitch of the trunk, (2,) rad.
    """
    end = plan.end
    rot = rotations.matrix_from_rpy(level[0], level[1], end.yaw)
    feet = posture.into_base(plan.feet_from, np.array([end.x, end.y, end.z]), rot)
    return check_request(frame, replace(plan, begin=end), kinematics.legs_ik(frame.robot.model, feet)[0], rot)
