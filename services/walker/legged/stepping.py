"""Motion of feet: a planned step tick by tick, touch-down by the foot switches, and landing after a start."""

import numpy as np

from surefoot.arrays import Array, Flags
from surefoot.geometry import rotations
from surefoot.robot import kinematics
from surefoot.robot.description import Robot

from . import planning, posture, swing
from .params import WalkerParams
from .planning import StepPlan
from .state import Stage, WalkerState

TOUCH_PHASE = 0.05  # of the swing after the fall begins: earlier switch readings belong to the lift-off
SETTLE_SPEED = 0.04  # m/s, how fast a lifted foot looks for the ground after a start
SETTLE_DEPTH = 0.08  # m, how far
HANGING = 2  # samples with an open switch after which a landed foot goes on down: one may be a bounce
CARRYING_FEET = 3  # that touch while another looks for the ground
LOAD_S = 0.1  # s, in which a standing foot takes its load
KEPT = 2.0 / 3.0  # of a lean, in which a foot that will lift keeps its load: the foot across loses as much as it does


def advance(state: WalkerState, robot: Robot, params: WalkerParams, dt: float, tilt: Array) -> bool:
    """Move trunk and feet by one tick of the planned step, `dt` s; return True if the step is done.

    The trunk moves evenly over the step. In a leaning gait it moves before the swing, while all feet stand, and the
    feet that will lift pass their load to the others at the end of that movement, so that the trunk does not tip. A
    foot that finds no ground at its landing is lowered further while the trunk waits. In a leaning gait a foot without
    contact after a landing is also lowered while the trunk moves back from its lean, and once the trunk is over it; no
    foot lifts before it has contact, since three feet carry the trunk only if all of them bear load. `tilt`: estimated
    roll and pitch of the trunk, (2,) rad. `state` and the landings of its plan are changed in place.
    """
    s, p, plan = state, params, state.plan
    assert plan is not None
    s.clock += dt
    if s.clock <= plan.lean:
        last = s.clock + dt > plan.lean
        if _seek(s, robot, plan, ~plan.swing, p.touch_speed * dt if last else 0.0) and last:
            s.clock -= dt
        way = np.where(plan.swing, 0.0, plan.feet_to[:, 2] - s.feet[:, 2])
        s.feet[:, 2] += np.clip(way, -p.press_speed * dt, p.press_speed * dt)
        there = swing.smooth(s.clock / plan.lean)
        given = swing.smooth(max(0.0, (s.clock / plan.lean - KEPT) / (1.0 - KEPT)))
        s.support = np.where(plan.swing, np.minimum(s.support, 1.0 - given), np.minimum(1.0, s.support + dt / LOAD_S))
        _move(s, plan, there)
        return False
    clock = s.clock - plan.lean
    if plan.lean > 0.0 and clock < 1.5 * dt:  # the first tick of the swing, whatever was rounded
        s.landed, s.skew = ~plan.swing, tilt - s.level
    u = min(1.0, clock / plan.duration)
    v = max(0.0, (clock / plan.duration - p.overlap) / (1.0 - 2.0 * p.overlap))
    if s.fresh and v > plan.shape.fall_start + TOUCH_PHASE:
        _touch(s, robot, plan)
    if v > 1.0:
        _give_up(s, robot, plan)
    leant, down = plan.lean > 0.0, bool(s.landed.all())
    bearing = s.landed if leant and down else plan.swing & s.landed
    seeking = _seek(s, robot, plan, bearing, p.touch_speed * dt)
    paths = swing.SwingPaths(plan.shape, plan.swing, plan.feet_from, plan.feet_to, plan.top, plan.go, plan.arrive)
    rate = dt / (p.overlap * plan.duration)
    s.feet, s.support = swing.targets(paths, s.landed, v, s.feet, p.press_speed * dt, s.support, rate)
    if leant and not s.held:
        _keep_height(s, plan.swing & ~s.landed, tilt, p.search_m)
    if not (leant and down):
        _move(s, plan, 1.0 if leant else u)
    elif seeking:
        _centre(s, p.trunk_speed * dt)
    if u < 1.0 or seeking or not down:
        return False
    s.footholds = plan.feet_to.copy()
    s.steps += 1
    s.steps_in_walk += 1
    return True


def _move(state: WalkerState, plan: StepPlan, part: float) -> None:
    """Move the trunk of the state to a part of its movement in the step, 0..1; its height changes smoothly."""
    a, b, ease = plan.begin, plan.end, swing.smooth(part)
    state.body[:] = (a.x + part * (b.x - a.x), a.y + part * (b.y - a.y), a.z + ease * (b.z - a.z))
    state.yaw = a.yaw + part * (b.yaw - a.yaw)


def _keep_height(state: WalkerState, feet: Flags, tilt: Array, most: float) -> None:
    """Raise feet in the air, (L,), by what the trunk has tipped towards them since lift-off, `most` m at most.

    They would else meet the ground early, at the speed of their fall, and throw the trunk back over two feet. `tilt`:
    estimated roll and pitch of the trunk, (2,) rad. The feet of `state` are changed in place.
    """
    s = state
    roll, pitch = tilt - s.level - s.skew
    ahead, left = planning.rotated(-s.yaw, s.feet[:, :2] - s.body[:2]).T
    s.feet[feet, 2] += np.clip(pitch * ahead - roll * left, -most, most)[feet]


def _centre(state: WalkerState, reach: float) -> None:
    """Move the trunk of the state back from its lean by `reach`, m, in place: two feet carry it there only just."""
    s = state
    size = float(np.hypot(s.lean[0], s.lean[1]))
    step = s.lean * min(1.0, reach / max(size, 1e-12))
    s.lean = s.lean - step
    s.body[:2] -= planning.rotated(s.yaw, step[None])[0]


def _touch(state: WalkerState, robot: Robot, plan: StepPlan) -> None:
    """Mark swinging feet that touch as landed where they are, in state and plan; their height is the measured one."""
    s = state
    touched = plan.swing & ~s.landed & s.contacts
    if touched.any() and s.measured is not None:
        _put(s, robot, plan, touched)
        s.landed |= touched


def _put(state: WalkerState, robot: Robot, plan: StepPlan, feet: Flags) -> None:
    """Set the planned landings of these feet (L,) to their present positions at the measured height, in place."""
    s = state
    assert s.measured is not None
    rot = rotations.matrix_from_rpy(s.level[0], s.level[1], s.yaw)
    measured = posture.into_map(kinematics.foot_positions(robot.model, s.measured), s.body, rot)
    plan.feet_to[feet] = s.feet[feet]
    plan.feet_to[feet, 2] = measured[feet, 2]


def _seek(state: WalkerState, robot: Robot, plan: StepPlan, landed: Flags, way: float) -> bool:
    """Lower those of the feet `landed` (L,) that have lost contact by `way`, m; return True if there are any.

    A foot that met an edge on its way stands there for a moment and then hangs beside it: were the others lifted now,
    the robot would fall onto it. Counters of the state and landings of the plan are changed in place.
    """
    s = state
    if s.fresh:
        found = landed & s.contacts & (s.hanging >= HANGING)
        if found.any() and s.measured is not None:
            _put(s, robot, plan, found)
        s.hanging = np.where(landed & ~s.contacts, s.hanging + 1, 0)
    seeking = (s.hanging >= HANGING) & (plan.feet_to[:, 2] > plan.deepest)
    plan.feet_to[seeking, 2] -= way
    return bool(seeking.any())


def bear(state: WalkerState, robot: Robot, params: WalkerParams, dt: float) -> bool:
    """Lower standing feet without contact over `dt` s, by `search_m` in all at most; return True if any is lowered.

    No foot is lowered while fewer than three others touch: a robot that is lifted has no ground below its feet. `state`
    is changed.
    """
    s = state
    if s.fresh:
        s.hanging = np.where(s.contacts, 0, s.hanging + 1)
    hangs = s.hanging >= HANGING
    way = np.where(hangs, np.clip(params.search_m - s.sunk, 0.0, params.touch_speed * dt), 0.0)
    if np.count_nonzero(~hangs) >= CARRYING_FEET and way.any():
        s.sunk += way
        s.footholds[:, 2] -= way
        s.feet[:, 2] -= way
        return True
    if hangs.any():
        s.reason = _no_ground(robot, hangs)
    return False


def _no_ground(robot: Robot, feet: Flags) -> str:
    names = [name for name, gone in zip(robot.leg_names, feet, strict=True) if gone]
    return f"no ground found under {', '.join(names)}"


def _give_up(state: WalkerState, robot: Robot, plan: StepPlan) -> None:
    """Mark swinging feet that found no ground down to their deepest height as landed where they are."""
    s = state
    lost = plan.swing & ~s.landed & (s.feet[:, 2] < plan.deepest)
    if lost.any():
        s.landed |= lost
        plan.feet_to[lost] = s.feet[lost]
        s.reason = _no_ground(robot, lost)


def settle(state: WalkerState, dt: float) -> None:
    """Lower every foot without contact over a tick of `dt` s; once all have landed, set the stage to STAND."""
    s = state
    if s.fresh:
        s.landed |= s.contacts
    s.landed |= s.footholds[:, 2] - s.feet[:, 2] > SETTLE_DEPTH
    s.feet[~s.landed, 2] -= SETTLE_SPEED * dt
    load(s, dt)
    if s.landed.all():
        s.footholds = s.feet.copy()
        s.stage = Stage.STAND


def load(state: WalkerState, dt: float) -> None:
    """Raise the load share of feet that have landed, `state.support`, towards 1 over `dt` s (0.1 s from 0 to 1)."""
    state.support = np.minimum(1.0, state.support + state.landed * (dt / LOAD_S))
