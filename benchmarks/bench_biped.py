"""Walks of the bipeds over many seeds: falls, speed, yaw, pushes, what the walker costs.

One process per seed: world, estimator and walker joined by function calls, in the order of a control tick and with the
one-tick actuation delay of bus servos. Truth is read by the judge only. Finished runs are kept in a file, so that an
interrupted study goes on where it was.

    python -m benchmarks.bench_biped bioloid --distance 1 --level 1 --seeds 0:100
    python -m benchmarks.bench_biped nao --turn 138 --seeds 0:20
    python -m benchmarks.bench_biped bioloid --push --seeds 0:4
"""

import argparse
import dataclasses
import hashlib
import json
import math
import os
import sys
import time
from collections.abc import Callable, Iterable
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from services.estimator.estimator import Estimator
from services.simulator.ground import perturbation
from services.simulator.model import Physics
from services.simulator.terrain import make_terrain
from services.simulator.world import World, WorldConfig
from services.walker.biped import BipedWalker
from services.walker.biped_params import BipedParams
from services.walker.biped_state import Mode
from services.walker.interface import Command, WalkerInputs
from surefoot.robot import load_robot

TICK_S = 0.01
PATIENCE_S = 6.0  # simulated time to stand before the command


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
    adjusted: int
    unreachable: int
    saturated: float
    walker_us: float
    walker_p99_us: float
    sha256: str


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
    world = World(robot, make_terrain("flat", seed=seed), seed, WorldConfig(physics=physics, perturbation=differs))
    estimator = Estimator.for_robot(robot)
    walker = BipedWalker(robot, BipedParams.for_robot(robot, **dict(setting.params)))
    if setting.turn_deg is not None:
        command = Command("turn", angle=math.radians(setting.turn_deg))
    else:
        arc = None if setting.arc_deg is None else math.radians(setting.arc_deg)
        command = Command("walk", distance=setting.distance, angle=arc)
    pending = [world.command.copy()]
    costs: list[float] = []
    digest = hashlib.sha256()
    began = stopped_at = -1
    begin_truth, tilt, twist, slip, saturated, out = world.truth(), 0.0, 0.0, 0.0, 0, None
    start_steps = stop_steps = unreachable = 0
    limits = np.array([joint.servo.max_torque for joint in robot.joints])
    judge = FootJudge(robot)
    pushed = setting.push is None
    while world.tick * TICK_S < setting.limit_s:
        samples = world.samples
        imu, joints, contacts = samples.imu, samples.joints, samples.contacts
        if imu is not None:
            estimator.on_imu(imu.stamp_ns, imu.gyro, imu.acc)
        touch = None if contacts is None else np.array([any(foot) for foot in contacts.touch])
        if joints is not None and touch is not None:
            estimator.on_kinematics(joints.stamp_ns, joints.position, touch)
        estimate, pose = estimator.estimate(), estimator.pose()
        inputs = WalkerInputs(
            stamp=TICK_S * world.tick, roll=estimate.roll, pitch=estimate.pitch,
            rate=tuple(float(w) for w in estimate.angular_velocity), x=float(pose.position[0]),
            y=float(pose.position[1]), yaw=pose.yaw, estimate_stamp=1e-9 * estimate.stamp_ns,
            initialised=estimate.initialised, joints=None if joints is None else joints.position, contacts=touch,
        )  # fmt: skip
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
                walker.command(Command("stop"))
                stopped_at, stop_steps = world.tick, out.steps
            if not pushed and out.steps - start_steps >= 4 and walker.state.mode is Mode.STEP:
                pushed = _push(world, walker, setting)
            if out.state in ("standing", "refused") and walker.state.clock > 60:
                break
        if began < 0 and now > PATIENCE_S:
            break
        pending.append(world.command if out.command is None else out.command)
        world.step_tick(pending.pop(0))
        if truth.fallen:
            break
    assert out is not None
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
        heading_error_deg=round(math.degrees(_wrap(pose.yaw - yaw1)), 2), adjusted=walker.state.adjusted,
        unreachable=unreachable, saturated=round(saturated / max(1, world.tick - began), 4),
        walker_us=round(1e6 * float(np.median(costs)), 1),
        walker_p99_us=round(1e6 * float(np.percentile(costs, 99)), 1),
        sha256=digest.hexdigest()[:16],
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
        from surefoot import kinematics, rotations

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


def _push(world: World, walker: BipedWalker, setting: Setting) -> bool:
    """Push in the wanted phase of a step of the left foot; tells whether it was done."""
    s = walker.state
    assert setting.push is not None
    assert s.step is not None
    force, direction, phase = setting.push
    if s.step.swing != 0 or s.clock != max(1, round(phase * walker.params.step_s / TICK_S)):
        return False
    yaw = _yaw(world.truth().quat_wxyz) + math.radians(direction)
    world.push((force * math.cos(yaw), force * math.sin(yaw), 0.0), 0.1)
    return True


def _yaw(quat: Any) -> float:
    w, x, y, z = quat
    return math.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))


def _wrap(angle: float) -> float:
    return math.atan2(math.sin(angle), math.cos(angle))


def _turned(total: float, wrapped: float) -> float:
    """The whole turn, by the wrapped one at the end."""
    return total + _wrap(wrapped - total)


def study(jobs: Iterable[tuple[int, Setting]], processes: int, keep: Path) -> list[Walk]:
    """All jobs, each in a process of its own; finished ones come from the file `keep`."""
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    done: dict[str, Walk] = {}
    if keep.is_file():
        for line in keep.read_text(encoding="utf-8").splitlines():
            row = json.loads(line)
            key = row.pop("key")
            done[key] = Walk(**row)
    jobs = list(jobs)
    keys = [_key(seed, setting) for seed, setting in jobs]
    missing = [(key, job) for key, job in zip(keys, jobs, strict=True) if key not in done]
    keep.parent.mkdir(parents=True, exist_ok=True)
    if missing:
        with ProcessPoolExecutor(processes) as pool, keep.open("a", encoding="utf-8") as file:
            running = {pool.submit(partial(walk, seed, setting)): key for key, (seed, setting) in missing}
            for n, job in enumerate(as_completed(running)):
                key, one = running[job], job.result()
                done[key] = one
                file.write(json.dumps({"key": key, **asdict(one)}) + "\n")
                file.flush()
                good = sum(done[k].ok for k in keys if k in done)
                print(f"\r{n + 1}/{len(missing)} runs, {good} ok", end="", file=sys.stderr, flush=True)
            print(file=sys.stderr)
    return [done[key] for key in keys]


def _key(seed: int, setting: Setting) -> str:
    """Job and code: a run of other code is another run."""
    text = json.dumps([seed, dataclasses.asdict(setting), code_version()], sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()[:16]


def code_version() -> str:
    """Digest of everything a run depends on."""
    root = Path(__file__).parents[1]
    names = sorted(
        path
        for folder in ("surefoot", "services/simulator", "services/estimator", "services/walker")
        for kind in ("*.py", "*.toml")
        for path in (root / folder).rglob(kind)
    )
    digest = hashlib.sha256()
    for path in (*names, Path(__file__)):
        digest.update(path.read_bytes())
    return digest.hexdigest()


def summary(walks: list[Walk], setting: Setting) -> str:
    """One line for a table."""
    good = [w for w in walks if w.ok]

    def mean(name: str) -> float:
        return float(np.mean([getattr(w, name) for w in good])) if good else math.nan

    speed = [100.0 * w.x / w.walk_s for w in good if w.walk_s > 0]
    per_metre = max(0.01, abs(setting.distance or 1.0))
    yaw = [w.yaw_deg / per_metre for w in good]
    return ", ".join(
        (
            f"{len(good)}/{len(walks)} ok",
            f"{sum(w.fallen for w in walks)} fell",
            f"x {mean('x'):.3f} m, |y| {float(np.mean([abs(w.y) for w in good] or [math.nan])):.3f} m",
            f"{float(np.mean(speed or [math.nan])):.2f} cm/s",
            f"yaw {mean('yaw_deg'):.1f} deg, sigma {float(np.std(yaw or [math.nan])):.1f} deg/m",
            f"tilt {mean('tilt_deg'):.1f} (max {max(w.tilt_deg for w in walks):.1f}) deg",
            f"twist {mean('twist_deg'):.2f} deg, slip {mean('slip_mm'):.1f} mm",
            f"odometry {mean('odometry_mm'):.0f} mm, {mean('heading_error_deg'):.1f} deg",
            f"steps to stop <= {max(w.stop_steps for w in walks)}",
            f"adjusted {mean('adjusted'):.1f}, saturated {100 * mean('saturated'):.1f} %",
            f"walker {mean('walker_us'):.0f} us (p99 {mean('walker_p99_us'):.0f})",
        )
    )


def push_table(walks: list[Walk], jobs: list[tuple[int, Setting]]) -> str:
    """Survival by force, and the lost directions and phases."""
    lines: list[str] = []
    forces = sorted({s.push[0] for _, s in jobs if s.push})
    for force in forces:
        here = [(w, s.push) for w, (_, s) in zip(walks, jobs, strict=True) if s.push and s.push[0] == force]
        good = sum(w.ok for w, _ in here)
        lost = sorted({(p[1], p[2]) for w, p in here if not w.ok and p})
        lines.append(f"{force:4.1f} N: {good}/{len(here)} survive ({100 * good / len(here):.0f} %); lost {lost}")
    return "\n".join(lines)


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("robot", nargs="?", default="bioloid")
    parser.add_argument("--distance", type=float, default=1.0)
    parser.add_argument("--turn", type=float, help="deg")
    parser.add_argument("--arc", type=float, help="deg over the distance")
    parser.add_argument("--level", type=float, default=1.0)
    parser.add_argument("--backlash", type=float, help="deg")
    parser.add_argument("--friction", type=float)
    parser.add_argument("--stop", type=float, help="s after the command")
    parser.add_argument("--push", action="store_true", help="8 directions x 4 phases, 0.1 s")
    parser.add_argument("--forces", default="4,6,8,10,12")
    parser.add_argument("--seeds", default="0:10", help="first:end")
    parser.add_argument("--set", action="append", default=[], metavar="FIELD=NUMBER", help="of BipedParams")
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--keep", type=Path, default=Path.home() / ".cache/surefoot/bench_biped.jsonl")
    parser.add_argument("--show", action="store_true", help="every run")
    args = parser.parse_args()
    params = tuple((name, float(value)) for name, _, value in (item.partition("=") for item in args.set))
    setting = Setting(
        args.robot, None if args.turn is not None else args.distance, args.turn, args.arc, args.level, args.backlash,
        args.friction, args.stop, None, params,
    )  # fmt: skip
    first, end = (int(value) for value in args.seeds.split(":"))
    jobs = [(seed, setting) for seed in range(first, end)]
    if args.push:
        short = replace(setting, distance=0.3 if args.robot == "bioloid" else 0.5)
        jobs = [
            (seed, replace(short, push=(force, 45.0 * d, phase)))
            for force in (float(f) for f in args.forces.split(","))
            for seed, _ in jobs
            for d in range(8)
            for phase in (0.0, 0.25, 0.5, 0.75)
        ]
    walks = study(jobs, args.jobs, args.keep)
    for one in walks:
        if args.show or (not one.ok and not args.push):
            print(json.dumps(asdict(one)))
    print(push_table(walks, jobs) if args.push else f"{args.robot}, seeds {args.seeds}: {summary(walks, setting)}")


if __name__ == "__main__":
    main()
