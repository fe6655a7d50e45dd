"""Walks over many seeds: how often the hexapod reaches the end, how far its feet slide, what the walker costs.

One process per seed: world, estimator and walker joined by function calls, in the order of a control tick and with
the one-tick actuation delay of bus servos. Truth is read by the judge only.

    python -m benchmarks.bench_walk demo --seeds 0:100
    python -m benchmarks.bench_walk flat --distance 2 --seeds 0:100
"""

import argparse
import json
import math
import time
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from benchmarks.joined import TICK_S, costs_us, sense
from surefoot.geometry.heightmap import HeightMap
from surefoot.robot.description import Robot
from surefoot.robot.reader import load_robot
from surefoot.services.estimator.stream import Estimator
from surefoot.services.simulator.ground.terrain import make_terrain, observed_map
from surefoot.services.simulator.world import PhysicsWorld
from surefoot.services.walker.hexapod.gait import HexapodWalker
from surefoot.services.walker.hexapod.params import WalkerParams
from surefoot.services.walker.interface import MotionCommand, Select, WalkerOutputs

PATIENCE_S = 5.0  # simulated time to stand before the walk command
REACHED = 0.95  # part of the commanded distance that counts as the end, by truth


@dataclass(frozen=True)
class Setting:
    """What is the same for all seeds of a study."""

    terrain: str = "demo"
    distance: float = 1.5
    amplitude: float | None = None
    robot: str = "ragno"
    profile: str = "noise"
    footholds: bool = True
    """Ask the foothold selector; False: nominal landings."""
    delay: int = 1
    limit_s: float = 120.0
    params: tuple[tuple[str, Any], ...] = ()
    command: MotionCommand | None = None


@dataclass(frozen=True)
class Walk:
    """Verdict of one seed."""

    seed: int
    reached: bool
    fallen: bool
    state: str
    reason: str
    x: float
    y: float
    time_s: float
    steps: int
    tilt_deg: float
    sliding_mm: float
    displacement_mm: float
    stances: int
    odometry_mm: float
    margin_mm: float
    unreachable: int
    walker_us: float
    walker_p99_us: float


class Judge:
    """Follows truth."""

    def __init__(self, world: PhysicsWorld) -> None:
        self.tilt = 0.0
        self.sliding: list[float] = []
        self.displacement: list[float] = []
        self._stances = world.truth().stances.copy()

    def look(self, world: PhysicsWorld) -> bool:
        """Whether the robot has fallen."""
        truth = world.truth()
        self.tilt = max(self.tilt, truth.tilt)
        for foot in np.flatnonzero(truth.stances > self._stances):
            self.sliding.append(float(truth.stance_sliding[foot]))
            self.displacement.append(float(truth.stance_displacement[foot]))
        self._stances = truth.stances
        return truth.fallen


def foothold_select(robot: Robot, heights: HeightMap) -> Select:
    """The foothold selector without its service."""
    from surefoot.services.footholds import select as chooser
    from surefoot.services.footholds.ground import build_ground
    from surefoot.services.footholds.models.score import HandScore
    from surefoot.services.walker.interface import FootholdReply, LandingRequest

    ground, model = build_ground(heights, robot.foot_radius), HandScore()

    def ask(request: LandingRequest) -> list[FootholdReply]:
        half = 0.5 * request.yaw
        base = chooser.TrunkPose(request.body, (math.cos(half), 0.0, 0.0, math.sin(half)))
        landings = [chooser.Landing(leg.leg, leg.nominal, leg.stroke) for leg in request.legs]
        replies = chooser.select(ground, robot, model, base, landings)
        return [FootholdReply(r.status, r.foothold, r.trunk_shift, r.reason) for r in replies]

    return ask


def walk(
    seed: int, setting: Setting, observe: Callable[[PhysicsWorld, HexapodWalker, WalkerOutputs], None] | None = None
) -> Walk:
    """One walk to its end, a refusal, a fall or the time limit."""
    robot = load_robot(setting.robot)
    terrain = make_terrain(setting.terrain, seed=seed, amp=setting.amplitude)
    heights = observed_map(terrain, setting.profile, seed)
    world = PhysicsWorld(robot, terrain, seed=seed)
    estimator = Estimator.for_robot(robot)
    select = {"select": foothold_select(robot, heights)} if setting.footholds else {}
    walker = HexapodWalker(robot, WalkerParams.for_robot(robot, **dict(setting.params)), **select)
    walker.set_map(heights)
    command = setting.command or MotionCommand("walk", distance=setting.distance)
    judge, costs, unreachable, margin = Judge(world), [], 0, math.inf
    pending = [world.command.copy()] * setting.delay
    started, out, odometry = False, None, 0.0
    while world.tick * TICK_S < setting.limit_s:
        inputs, _ = sense(world, estimator)
        began = time.perf_counter()
        out = walker.step(inputs)
        costs.append(time.perf_counter() - began)
        unreachable += out.unreachable
        margin = margin if out.margin is None else min(margin, out.margin)
        if observe is not None:
            observe(world, walker, out)
        if not started and out.state == "standing":
            started = walker.command(command).accepted
        elif started and out.state in ("standing", "refused"):
            break
        if not started and world.tick * TICK_S > PATIENCE_S:
            break
        pending.append(world.command if out.command is None else out.command)
        world.step_tick(pending.pop(0))
        if judge.look(world):
            break
    truth = world.truth()
    odometry = math.hypot(*(np.array(estimator.pose().position[:2]) - truth.position[:2]))
    assert out is not None
    median_us, p99_us = costs_us(costs)
    way = setting.distance if setting.command is None else 0.0
    return Walk(
        seed=seed,
        reached=bool(started and not truth.fallen and out.state == "standing" and truth.position[0] >= REACHED * way),
        fallen=bool(truth.fallen),
        state=out.state,
        reason=out.reason,
        x=round(float(truth.position[0]), 4),
        y=round(float(truth.position[1]), 4),
        time_s=round(TICK_S * world.tick, 2),
        steps=out.steps,
        tilt_deg=round(math.degrees(judge.tilt), 2),
        sliding_mm=round(1e3 * float(np.mean(judge.sliding or [0.0])), 4),
        displacement_mm=round(1e3 * float(np.mean(judge.displacement or [0.0])), 4),
        stances=len(judge.sliding),
        odometry_mm=round(1e3 * odometry, 1),
        margin_mm=round(1e3 * margin, 1),
        unreachable=unreachable,
        walker_us=median_us,
        walker_p99_us=p99_us,
    )


def summary(walks: list[Walk]) -> str:
    """One line for a table."""
    good = [w for w in walks if w.reached]

    def mean(name: str) -> float:
        return float(np.mean([getattr(w, name) for w in good])) if good else math.nan

    return ", ".join(
        (
            f"{len(good)}/{len(walks)} reached",
            f"{sum(w.fallen for w in walks)} fell",
            f"tilt <= {max(w.tilt_deg for w in walks):.1f} deg",
            f"sliding {mean('sliding_mm'):.3f}, displacement {mean('displacement_mm'):.2f} mm per stance",
            f"odometry {mean('odometry_mm'):.1f} mm",
            f"margin >= {min(w.margin_mm for w in walks):.0f} mm",
            f"{mean('time_s'):.1f} s",
            f"unreachable {mean('unreachable'):.1f}",
            f"walker {mean('walker_us'):.0f} us (p99 {mean('walker_p99_us'):.0f})",
        )
    )


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("terrain", nargs="?", default="demo")
    parser.add_argument("--distance", type=float, default=1.5)
    parser.add_argument("--seeds", default="0:10", help="first:end")
    parser.add_argument("--amplitude", type=float)
    parser.add_argument("--robot", default="ragno")
    parser.add_argument("--profile", default="noise")
    parser.add_argument("--nominal", action="store_true", help="land on nominal footholds")
    parser.add_argument("--set", action="append", default=[], metavar="FIELD=NUMBER", help="of WalkerParams")
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--json", action="store_true")
    args = parser.parse_args()
    params = tuple((name, float(value)) for name, _, value in (item.partition("=") for item in args.set))
    setting = replace(
        Setting(), terrain=args.terrain, distance=args.distance, amplitude=args.amplitude, robot=args.robot,
        profile=args.profile, footholds=not args.nominal, params=params,
    )  # fmt: skip
    first, end = (int(value) for value in args.seeds.split(":"))
    walks: list[Walk] = []
    with ProcessPoolExecutor(args.jobs) as pool:
        for one in pool.map(partial(walk, setting=setting), range(first, end)):
            walks.append(one)
            if args.json or not one.reached:
                print(json.dumps(asdict(one)), flush=True)
    print(f"{args.terrain} {args.distance} m, seeds {args.seeds}: {summary(walks)}")


if __name__ == "__main__":
    main()
