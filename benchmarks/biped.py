"""Walks of the bipeds over many seeds: falls, speed, yaw, pushes, what the walker costs.

World, estimator and walker are joined by function calls, in the order of a control tick and with the one-tick actuation
delay of bus servos. Truth is read for the figures only. Finished runs are kept in a file together with a digest of the
code they depend on, so that an interrupted study continues, and a run of other code is another run.
"""

# mujoco has no type stubs for its compiled modules:
# pyright: reportAttributeAccessIssue=false
import hashlib
import json
import math
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple, cast

import mujoco
import numpy as np

from benchmarks.bench import Bench, microseconds, numbers_of, table, words_of
from surefoot.geometry import rotations
from surefoot.geometry.constants import GRAVITY
from surefoot.geometry.polygon import hull, signed_distance
from surefoot.lab.runs.joined import TICK_S, sense
from surefoot.lab.studies import Line, seeds_of, study
from surefoot.robot import kinematics
from surefoot.robot.description import Robot
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
from surefoot.services.walker.interface import MotionCommand, WalkerOutputs

BENCH = Bench("biped")

PATIENCE_S = 6.0  # simulated time to stand before the command
LIMIT_S = 90.0  # simulated time of a run
PUSH_TICKS = 10
STANDING = RIGHT  # the foot that stands in a step with a push
KEPT = Path.home() / ".cache/surefoot/biped.jsonl"
CLOSING_S = 0.61  # from the end of a walk until the walker reports that it stands


@dataclass(frozen=True)
class Setting:
    """Conditions of a run; the seed comes on top.

    Attributes:
        distance: length of the walk, m.
        turn: deg, in place of a walk.
        arc: turn over the distance, deg.
        level: level of the perturbation of masses, servos and sensors.
        backlash: backlash of the legs' joints, deg; default: as the robot description has it.
        friction: friction coefficient of the ground; default: that of the simulator.
        stop: time of a stop command after the start of the walk, s.
        set: values of BipedParams as name=number, comma-separated.
    """

    distance: float = 1.0
    turn: float | None = None
    arc: float | None = None
    level: float = 1.0
    backlash: float | None = None
    friction: float | None = None
    stop: float | None = None
    set: str = ""
    robot: str = "bioloid"
    push: Sequence[float] | None = None
    """Push of the trunk for 0.1 s: force in N, direction in deg, phase 0..1 of a step at which it begins; None = no
    push."""


class Capture(NamedTuple):
    """True capture point at the end of a push, in axes of the sole of the step's standing foot."""

    ahead_mm: float
    """Distance of the capture point ahead of the ankle, mm."""
    outward_mm: float
    """Distance of the capture point from the ankle away from the swinging foot, mm."""
    beyond_mm: float
    """Distance of the capture point beyond the sole's outline, mm; negative = inside the outline."""
    edge: str
    """Edge of the sole (front, rear, outer, inner) that the capture point lies beyond, or is nearest to."""


def robot_with(setting: Setting) -> Robot:
    """Return the robot that a setting names, with the setting's backlash of the leg joints if it has one."""
    robot = load_robot(setting.robot)
    if setting.backlash is None:
        return robot
    play = math.radians(setting.backlash)
    legs = {j for leg in robot.legs for j in leg.joints}
    joints = tuple(
        replace(joint, servo=replace(joint.servo, backlash=play)) if i in legs else joint
        for i, joint in enumerate(robot.joints)
    )
    return replace(robot, joints=joints)


def command_of(setting: Setting) -> MotionCommand:
    """Return the walk or the turn of a setting."""
    if setting.turn is not None:
        return MotionCommand("turn", angle=math.radians(setting.turn))
    arc = None if setting.arc is None else math.radians(setting.arc)
    return MotionCommand("walk", distance=setting.distance, angle=arc)


class Feet:
    """Slip and twist of standing feet, and the whole turn of the trunk, by truth."""

    def __init__(self, robot: Robot) -> None:
        self.model = robot.model
        self.stance, self.start = np.zeros(len(robot.legs), dtype=bool), np.zeros((len(robot.legs), 3))
        self.turned, self._last = 0.0, math.nan
        self.slip = self.twist = 0.0

    def look(self, truth: Any, stance: Any) -> None:
        """Update the largest slip, m, and twist, rad, of standing feet by the state at the end of a tick."""
        rot, _ = kinematics.forward(self.model, truth.joints)
        base, yaw = rotations.matrix_from_quat(truth.quat_wxyz), _yaw(truth.quat_wxyz)
        self.turned += 0.0 if math.isnan(self._last) else _wrap(yaw - self._last)
        self._last = yaw
        for i, link in enumerate(self.model.foot_link):
            ahead = base @ rot[link][:, 0]
            now = np.array([*truth.foot_position[i, :2], math.atan2(ahead[1], ahead[0])])
            loaded = bool(stance[i]) and truth.foot_force_n[i] > 2.0
            if loaded and not self.stance[i]:
                self.start[i] = now
            self.stance[i] = loaded
            if loaded:
                self.slip = max(self.slip, float(np.hypot(*(now - self.start[i])[:2])))
                self.twist = max(self.twist, abs(_wrap(now[2] - self.start[i, 2])))


class Run:
    """One simulated command of a biped to its end, a fall or the time limit."""

    def __init__(self, seed: int, setting: Setting) -> None:
        robot = robot_with(setting)
        physics = Physics() if setting.friction is None else Physics(friction=setting.friction)
        config = WorldConfig(physics=physics, perturbation=perturbation(setting.level, seed, robot.nj, robot.kind))
        numbers = {name: float(value) for name, _, value in (item.partition("=") for item in words_of(setting.set))}
        self.setting = setting
        self.world = PhysicsWorld(robot, make_terrain("flat", seed=seed), seed, config)
        self.estimator = Estimator.for_robot(robot)
        self.walker = BipedWalker(robot, BipedParams.for_robot(robot, **numbers))
        self.limits = np.array([joint.servo.max_torque for joint in robot.joints])
        self.feet, self.digest, self.costs = Feet(robot), hashlib.sha256(), list[float]()
        self.pending = self.world.command.copy()
        self.begin, self.out = self.world.truth(), cast(WalkerOutputs, None)  # set by the first tick
        self.began = self.stopped = self.push_end = -1  # ticks
        self.first_step = self.stop_step = self.unreachable = self.saturated = 0
        self.tilt, self.capture, self.pushed = 0.0, None, setting.push is None

    def tick(self) -> bool:
        """Simulate a control tick; return True while the run continues, False when it has ended."""
        world, walker = self.world, self.walker
        inputs, _ = sense(world, self.estimator)
        clock = time.perf_counter()
        self.out = out = walker.step(inputs)
        self.costs.append(time.perf_counter() - clock)
        self.unreachable += out.unreachable
        truth = world.truth()
        self.digest.update(truth.position.tobytes() + truth.quat_wxyz.tobytes())
        if self.began >= 0:
            self.tilt = max(self.tilt, truth.tilt)
            self.saturated += int(np.any(np.abs(world.data.actuator_force) > 0.98 * self.limits))
            self.feet.look(truth, out.stance)
        if self._ended(truth):
            return False
        command, self.pending = self.pending, world.command if out.command is None else out.command
        world.step_tick(command)
        return not truth.fallen and world.tick * TICK_S < LIMIT_S

    def _ended(self, truth: Any) -> bool:
        """Issue the commands and the push that are due; return True if the robot has ended its walk."""
        out, walker, now = self.out, self.walker, self.world.tick * TICK_S
        if self.began < 0:
            standing = out.state == "standing" and walker.state.clock > 50
            if standing and walker.command(command_of(self.setting)).accepted:
                self.began, self.begin, self.first_step = self.world.tick, truth, out.steps
            return self.began < 0 and now > PATIENCE_S
        stop_s = self.setting.stop
        if stop_s is not None and self.stopped < 0 and now - self.began * TICK_S > stop_s:
            walker.command(MotionCommand("stop"))
            self.stopped, self.stop_step = self.world.tick, out.steps
        if not self.pushed and out.steps - self.first_step >= 4 and walker.state.mode is Mode.STEP:
            self._push()
        if self.world.tick == self.push_end:
            self.capture = capture_point(self.world, STANDING)
        return out.state in ("standing", "refused") and walker.state.clock > 60

    def _push(self) -> None:
        """Push the trunk when a step of the left foot reaches the wanted phase."""
        s = self.walker.state
        assert self.setting.push is not None
        assert s.step is not None
        force, direction, phase = self.setting.push
        if s.step.swing == STANDING or s.clock != max(1, round(phase * self.walker.params.step_s / TICK_S)):
            return
        yaw = _yaw(self.world.truth().quat_wxyz) + math.radians(direction)
        self.world.push((force * math.cos(yaw), force * math.sin(yaw), 0.0), PUSH_TICKS * TICK_S)
        self.pushed, self.push_end = True, self.world.tick + PUSH_TICKS

    def line(self) -> Line:
        """Return the figures of the run as a line of a results file."""
        out, truth, feet = self.out, self.world.truth(), self.feet
        yaw0, yaw1 = _yaw(self.begin.quat_wxyz), _yaw(truth.quat_wxyz)
        move, c, s = truth.position[:2] - self.begin.position[:2], math.cos(yaw0), math.sin(yaw0)
        pose = self.estimator.pose()
        turned = feet.turned + _wrap(yaw1 - yaw0 - feet.turned)
        walk_s = (self.world.tick - self.began) * TICK_S - (CLOSING_S if out.state == "standing" else 0.0)
        median_us, p99_us = microseconds(self.costs)
        return {
            "ok": bool(self.began >= 0 and not truth.fallen and out.state == "standing" and self.pushed),
            "fallen": bool(truth.fallen), "state": out.state, "reason": out.reason,
            "x": round(float(c * move[0] + s * move[1]), 4), "y": round(float(-s * move[0] + c * move[1]), 4),
            "yaw_deg": round(math.degrees(turned), 2), "walk_s": round(walk_s, 2),
            "steps": out.steps - self.first_step,
            "stop_steps": out.steps - self.stop_step if self.stopped >= 0 else 0,
            "tilt_deg": round(math.degrees(self.tilt), 2), "twist_deg": round(math.degrees(feet.twist), 2),
            "slip_mm": round(1e3 * feet.slip, 2),
            "odometry_mm": round(1e3 * float(np.hypot(*(np.array(pose.position[:2]) - truth.position[:2]))), 1),
            "heading_error_deg": round(math.degrees(_wrap(pose.yaw - yaw1)), 2),
            "unreachable": self.unreachable,
            "saturated": round(self.saturated / max(1, self.world.tick - self.began), 4), "walker_us": median_us,
            "walker_p99_us": p99_us, "sha256": self.digest.hexdigest()[:16],
            "capture": None if self.capture is None else list(self.capture),
        }  # fmt: skip


def capture_point(world: PhysicsWorld, foot: int) -> Capture:
    """Return where the linear inverted pendulum would come to rest, c + c' sqrt(z/g) (Pratt et al. 2006), by truth.

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


def walked(seed: int, setting: dict[str, Any], code: str) -> Line:
    """Simulate one walk of a biped and return its line of results; `code`: digest of the code, stored in the line."""
    run = Run(seed, Setting(**setting))
    while run.tick():
        pass
    return run.line()


@cache
def code_version() -> str:
    """Return a SHA-256 digest of all code and parameter files that a simulated walk depends on, in hexadecimal."""
    root = Path(__file__).parents[1]
    folders = ("surefoot", "services/simulator", "services/estimator", "services/walker")
    names = sorted(path for name in folders for kind in ("*.py", "*.toml") for path in (root / name).rglob(kind))
    digest = hashlib.sha256()
    for path in (*names, Path(__file__), root / "lab/runs/joined.py"):
        digest.update(path.read_bytes())
    return digest.hexdigest()


def summary(lines: Sequence[Line], distance: float) -> list[tuple[str, object]]:
    """Return the rows (what, figure) of the table of walks of `distance` m: means over the good runs unless stated."""
    good = [line for line in lines if line["ok"]]

    def mean(name: str) -> float:
        return float(np.mean([line[name] for line in good])) if good else math.nan

    speed = [100.0 * line["x"] / line["walk_s"] for line in good if line["walk_s"] > 0] or [math.nan]
    yaw = [line["yaw_deg"] / max(0.01, abs(distance)) for line in good] or [math.nan]
    return [
        ("good", f"{len(good)} of {len(lines)}"), ("fell", sum(line["fallen"] for line in lines)),
        ("x, m", mean("x")), ("|y|, m", float(np.mean([abs(line["y"]) for line in good] or [math.nan]))),
        ("speed, start and closing step included, cm/s", float(np.mean(speed))), ("yaw, deg", mean("yaw_deg")),
        ("sigma of the yaw, deg/m", float(np.std(yaw))), ("tilt, deg", mean("tilt_deg")),
        ("largest tilt of all runs, deg", max(line["tilt_deg"] for line in lines)),
        ("twist of a foot, deg", mean("twist_deg")), ("slip of a foot, mm", mean("slip_mm")),
        ("odometry error, mm", mean("odometry_mm")), ("heading error, deg", mean("heading_error_deg")),
        ("most steps to stop", max(line["stop_steps"] for line in lines)),
        ("ticks with a saturated servo, %", 100 * mean("saturated")),
        ("walker, us a tick, median", mean("walker_us")),
        ("walker, us a tick, 99th percentile", mean("walker_p99_us")),
    ]  # fmt: skip


def show_pushes(lines: Sequence[Line]) -> None:
    """Print how many pushes were survived: by force, by lost direction and phase, and by place of the capture point."""
    rows: list[tuple[object, ...]] = []
    runs = [(line, line["setting"]["push"]) for line in lines]
    for force in sorted({push[0] for _, push in runs}):
        here = [(line, push) for line, push in runs if push[0] == force]
        good = sum(line["ok"] for line, _ in here)
        rows.append((f"{force:g} N, all", good, len(here)))
        for way in sorted({tuple(push[1:]) for line, push in here if not line["ok"]}):
            same = [line for line, push in here if tuple(push[1:]) == way]
            at = [Capture(*line["capture"]) for line in same if not line["ok"] and line["capture"] is not None]
            where = np.array([point[:3] for point in at]).mean(axis=0).tolist() if at else [None] * 3
            edges = "/".join(sorted({point.edge for point in at}))
            ok = sum(line["ok"] for line in same)
            rows.append((f"{force:g} N, {way[0]:.0f} deg, phase {way[1]:.2f}", ok, len(same), *where, edges))
    header = ("push", "survive", "of", "ahead mm", "outward mm", "beyond mm", "edge")
    table("pushes survived; true capture point of the lost ones at the end of the push", header, rows)
    found = [(line["ok"], Capture(*line["capture"])) for line in lines if line["capture"] is not None]
    rows = []
    for edge in ("outer", "inner", "front", "rear"):
        for low, high in ((-math.inf, 0.0), (0.0, 10.0), (10.0, 20.0), (20.0, 40.0), (40.0, math.inf)):
            here = [ok for ok, point in found if point.edge == edge and low < point.beyond_mm <= high]
            if here:
                rows.append((f"{edge} edge, {low:g} to {high:g} mm beyond", sum(here), len(here)))
    table("survived by the place of the true capture point", ("place", "survive", "of"), rows)


@BENCH.part("bioloid --seeds 0:1 --distance 0.1 --results /dev/null")
def walks(
    robot: str = "bioloid", /, *, setting: Setting, push: bool = False, forces: str = "4,6,8,10,12",
    seeds: str = "0:10", processes: int = 2, results: Path = KEPT, show: bool = False,
) -> None:  # fmt: skip
    """Simulate walks, turns and pushes of a biped: print falls, speed, yaw, and processor time of the walker.

    Args:
        robot: bioloid or nao.
        setting: conditions of the walks.
        push: 8 directions x 4 phases of each force, 0.1 s long.
        forces: forces of the pushes, N, comma-separated.
        show: every run.
    """
    chosen = [(seed, replace(setting, robot=robot)) for seed in seeds_of(seeds)]
    if push:
        short = replace(setting, robot=robot, distance=0.3 if robot == "bioloid" else 0.5)
        chosen = [
            (seed, replace(short, push=(force, 45.0 * way, phase)))
            for force in numbers_of(forces) for seed in seeds_of(seeds) for way in range(8)
            for phase in (0.0, 0.25, 0.5, 0.75)
        ]  # fmt: skip
    results.parent.mkdir(parents=True, exist_ok=True)
    jobs = [{"seed": seed, "setting": asdict(each), "code": code_version()} for seed, each in chosen]
    lines = study(walked, jobs, results, processes=processes)
    for line in lines:
        if show or (not line["ok"] and not push):
            print(json.dumps(line))
    if push:
        show_pushes(lines)
    else:
        table(
            f"{robot}, seeds {seeds}",
            ("what", "figure"),
            summary(lines, setting.distance if setting.turn is None else 1.0),
        )
