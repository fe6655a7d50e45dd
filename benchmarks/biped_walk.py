"""One walk of a biped: world, estimator and walker joined by function calls, truth read by the judge only.

In the order of a control tick and with the one-tick actuation delay of bus servos.
"""

# mujoco has no type stubs for its compiled modules:
# pyright: reportAttributeAccessIssue=false
import hashlib
import math
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import mujoco
import numpy as np

from benchmarks.joined import TICK_S, costs_us, sense
from surefoot.geometry.constants import GRAVITY
from surefoot.geometry.polygon import hull, signed_distance
from surefoot.robot.reader import load_robot
from surefoot.services.estimator.stream import Estimator
from surefoot.services.simulator.ground.terrain import make_terrain
from surefoot.services.simulator.physics.model import Physics
from surefoot.services.simulator.physics.perturb import perturbation
from surefoot.services.simulator.world import PhysicsWorld, WorldConfig
from surefoot.services.walker.biped.gait import BipedWalker
from surefoot.services.walker.biped.params import BipedParams
from surefoot.services.walker.biped.plan import RIGHT
from surefoot.services.walker.biped.state import Mode
from surefoot.services.walker.interface import MotionCommand

PATIENCE_S = 6.0  # simulated time to stand before the command
PUSH_TICKS = 10
STANDING = RIGHT  # the foot that stands in a step with a push


@dataclass(frozen=True)
class Setting:
    """What is the same for all seeds of a study."""

    robot: str = "bioloid"
    distance: float | None = 1.0
    turn_deg: float | None = None
    arc_deg: float | None = None
    level: float = 1.0
    backlash_deg: float | None = None
    """None = as the robot description says."""
    friction: float | None = None
    stop_s: float | None = None
    """Stop command this long after the start of the walk."""
    push: tuple[float, float, float] | None = None
    """N, direction deg, phase of a step 0..1 in which it begins; lasts 0.1 s at the trunk."""
    params: tuple[tuple[str, Any], ...] = ()
    limit_s: float = 90.0


class Capture(NamedTuple):
    """The TRUE capture point, at the end of a push, in axes of the sole of the step's standing foot."""

    ahead_mm: float
    """Of the ankle,"""
    outward_mm: float
    """and away from the swinging foot."""
    beyond_mm: float
    """Distance to the sole's outline, negative inside."""
    edge: str
    """The side of the sole it lies beyond, or is nearest to."""


@dataclass(frozen=True)
class Walk:
    """Verdict of one run."""

    seed: int
    ok: bool
    fallen: bool
    state: str
    reason: str
    x: float
    y: float
    yaw_deg: float
    walk_s: float
    steps: int
    stop_steps: int
    tilt_deg: float
    twist_deg: float
    slip_mm: float
    odometry_mm: float
    heading_error_deg: float
    unreachable: int
    saturated: float
    walker_us: float
    walker_p99_us: float
    sha256: str
    capture: Capture | None = None
    """At the end of a push."""


def robot_with(setting: Setting) -> Any:
    """The robot, with another backlash if asked for."""
    robot = load_robot(setting.robot)
    if setting.backlash_deg is None:
        return robot
    play = math.radians(setting.backlash_deg)
    legs = {j for leg in robot.legs for j in leg.joints}
    joints = tuple(
        replace(joint, servo=replace(joint.servo, backlash=play)) if i in legs else joint
        for i, joint in enumerate(robot.joints)
    )
    return replace(robot, joints=joints)


def walk(seed: int, setting: Setting, observe: Callable[..., None] | None = None) -> Walk:
    """One command to its end, a fall or the time limit."""
    robot = robot_with(setting)
    physics = Physics() if setting.friction is None else Physics(friction=setting.friction)
    differs = perturbation(setting.level, seed, robot.nj, robot.kind)
    world = PhysicsWorld(
        robot, make_terrain("flat", seed=seed), seed, WorldConfig(physics=physics, perturbation=differs)
    )
    estimator = Estimator.for_robot(robot)
    walker = BipedWalker(robot, BipedParams.for_robot(robot, **dict(setting.params)))
    if setting.turn_deg is not None:
        command = MotionCommand("turn", angle=math.radians(setting.turn_deg))
    else:
        arc = None if setting.arc_deg is None else math.radians(setting.arc_deg)
        command = MotionCommand("walk", distance=setting.distance, angle=arc)
    pending = [world.command.copy()]
    costs: list[float] = []
    digest = hashlib.sha256()
    began = stopped_at = -1
    begin_truth, tilt, twist, slip, saturated, out = world.truth(), 0.0, 0.0, 0.0, 0, None
    start_steps = stop_steps = unreachable = 0
    limits = np.array([joint.servo.max_torque for joint in robot.joints])
    judge = FootJudge(robot)
    pushed, capture, push_end = setting.push is None, None, -1
    while world.tick * TICK_S < setting.limit_s:
        inputs, estimate = sense(world, estimator)
        clock = time.perf_counter()
        out = walker.step(inputs)
        costs.append(time.perf_counter() - clock)
        unreachable += out.unreachable
        truth = world.truth()
        digest.update(truth.position.tobytes() + truth.quat_wxyz.tobytes())
        if began >= 0:
            tilt = max(tilt, truth.tilt)
            saturated += int(np.any(np.abs(world.data.actuator_force) > 0.98 * limits))
            slipped, twisted = judge.look(truth, out.stance)
            slip, twist = max(slip, slipped), max(twist, twisted)
        if observe is not None:
            observe(world, walker, out, estimate)
        now = world.tick * TICK_S
        if began < 0 and out.state == "standing" and walker.state.clock > 50:
            if walker.command(command).accepted:
                began, begin_truth, start_steps = world.tick, truth, out.steps
        elif began >= 0:
            if setting.stop_s is not None and stopped_at < 0 and now - began * TICK_S > setting.stop_s:
                walker.command(MotionCommand("stop"))
                stopped_at, stop_steps = world.tick, out.steps
            if not pushed and out.steps - start_steps >= 4 and walker.state.mode is Mode.STEP:
                pushed = _push(world, walker, setting)
                push_end = world.tick + PUSH_TICKS if pushed else -1
            if world.tick == push_end:
                capture = capture_point(world, STANDING)
            if out.state in ("standing", "refused") and walker.state.clock > 60:
                break
        if began < 0 and now > PATIENCE_S:
            break
        pending.append(world.command if out.command is None else out.command)
        world.step_tick(pending.pop(0))
        if truth.fallen:
            break
    assert out is not None
    median_us, p99_us = costs_us(costs)
    truth = world.truth()
    yaw0, yaw1 = _yaw(begin_truth.quat_wxyz), _yaw(truth.quat_wxyz)
    move = truth.position[:2] - begin_truth.position[:2]
    c, s = math.cos(yaw0), math.sin(yaw0)
    x, y = float(c * move[0] + s * move[1]), float(-s * move[0] + c * move[1])
    pose = estimator.pose()
    turned = _turned(judge.yaw_total, yaw1 - yaw0)
    walk_s = (world.tick - began) * TICK_S - (0.61 if out.state == "standing" else 0.0)
    drift = np.array(pose.position[:2]) - truth.position[:2]
    return Walk(
        seed=seed,
        ok=bool(began >= 0 and not truth.fallen and out.state == "standing" and pushed),
        fallen=bool(truth.fallen), state=out.state, reason=out.reason, x=round(x, 4), y=round(y, 4),
        yaw_deg=round(math.degrees(turned), 2), walk_s=round(walk_s, 2), steps=out.steps - start_steps,
        stop_steps=out.steps - stop_steps if stopped_at >= 0 else 0, tilt_deg=round(math.degrees(tilt), 2),
        twist_deg=round(math.degrees(twist), 2), slip_mm=round(1e3 * slip, 2),
        odometry_mm=round(1e3 * float(np.hypot(*drift)), 1),
        heading_error_deg=round(math.degrees(_wrap(pose.yaw - yaw1)), 2),
        unreachable=unreachable, saturated=round(saturated / max(1, world.tick - began), 4),
        walker_us=median_us, walker_p99_us=p99_us,
        sha256=digest.hexdigest()[:16], capture=capture,
    )  # fmt: skip


class FootJudge:
    """Slip and twist of standing feet, and the whole turn of the trunk, from truth."""

    def __init__(self, robot: Any) -> None:
        self.model = robot.model
        self.stance = np.zeros(len(robot.legs), dtype=bool)
        self.start = np.zeros((len(robot.legs), 3))
        self.yaw_total, self._last = 0.0, math.nan

    def look(self, truth: Any, stance: Any) -> tuple[float, float]:
        """Largest displacement (m) and twist (rad) of a foot since it began to stand by plan."""
        from surefoot.geometry import rotations
        from surefoot.robot import kinematics

        rot, _ = kinematics.forward(self.model, truth.joints)
        base = rotations.matrix_from_quat(truth.quat_wxyz)
        yaw = _yaw(truth.quat_wxyz)
        self.yaw_total += 0.0 if math.isnan(self._last) else _wrap(yaw - self._last)
        self._last = yaw
        slip = twist = 0.0
        for i, link in enumerate(self.model.foot_link):
            ahead = base @ rot[link][:, 0]
            now = np.array([*truth.foot_position[i, :2], math.atan2(ahead[1], ahead[0])])
            loaded = bool(stance[i]) and truth.foot_force_n[i] > 2.0
            if loaded and not self.stance[i]:
                self.start[i] = now
            self.stance[i] = loaded
            if loaded:
                slip = max(slip, float(np.hypot(*(now - self.start[i])[:2])))
                twist = max(twist, abs(_wrap(now[2] - self.start[i, 2])))
        return slip, twist


def _push(world: PhysicsWorld, walker: BipedWalker, setting: Setting) -> bool:
    """Push in the wanted phase of a step of the left foot; tells whether it was done."""
    s = walker.state
    assert setting.push is not None
    assert s.step is not None
    force, direction, phase = setting.push
    if s.step.swing == STANDING or s.clock != max(1, round(phase * walker.params.step_s / TICK_S)):
        return False
    yaw = _yaw(world.truth().quat_wxyz) + math.radians(direction)
    world.push((force * math.cos(yaw), force * math.sin(yaw), 0.0), PUSH_TICKS * TICK_S)
    return True


def capture_point(world: PhysicsWorld, foot: int) -> Capture:
    """Where the linear inverted pendulum would come to rest, c + c' sqrt(z/g) (Pratt et al. 2006), from the true state.

    Args:
        world: on level ground; the state at the end of a tick.
        foot: whose sole it is seen from.
    """
    mujoco.mj_subtreeVel(world.model, world.data)  # derived quantities only: the run stays the same
    trunk, body, truth = world.address.trunk, world.address.foot_bodies[foot], world.truth()
    height = truth.com[2] - truth.foot_position[foot, 2]
    point = truth.com[:2] + world.data.subtree_linvel[trunk][:2] * math.sqrt(height / GRAVITY)
    rot = world.data.xmat[body].reshape(3, 3)
    yaw = math.atan2(rot[1, 0], rot[0, 0])
    away = point - world.data.xpos[body][:2]
    ahead, left = (math.cos(yaw) * away[0] + math.sin(yaw) * away[1], math.cos(yaw) * away[1] - math.sin(yaw) * away[0])
    sole = np.array(world.robot.legs[foot].foot.points)[:, :2]
    side = -1.0 if foot == RIGHT else 1.0
    beyond = {
        "front": ahead - sole[:, 0].max(), "rear": sole[:, 0].min() - ahead,
        "outer": side * left - (side * sole[:, 1]).max(), "inner": (side * sole[:, 1]).min() - side * left,
    }  # fmt: skip
    edge = max(beyond, key=lambda name: beyond[name])
    outside = -signed_distance(hull(sole), ahead, left)
    ahead_mm, outward_mm, beyond_mm = (round(1e3 * float(v), 1) for v in (ahead, side * left, outside))
    return Capture(ahead_mm, outward_mm, beyond_mm, edge)


def _yaw(quat: Any) -> float:
    w, x, y, z = quat
    return math.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))


def _wrap(angle: float) -> float:
    return math.atan2(math.sin(angle), math.cos(angle))


def _turned(total: float, wrapped: float) -> float:
    """The whole turn, by the wrapped one at the end."""
    return total + _wrap(wrapped - total)
