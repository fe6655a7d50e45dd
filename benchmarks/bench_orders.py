"""Commands at any moment of a step: does a simulated Nao stay on its feet, and how far does it tilt?

World, estimator and walker joined by function calls. Of each seed and each command under way the state at the begin of
a step is kept, and every other command is tried from there at every moment. Truth is read by the judge only. Finished
runs are kept in a file, so that an interrupted study goes on where it was.

    python -m benchmarks.bench_orders --seeds 0:10 --results orders.jsonl
"""

import argparse
import copy
import json
import math
import os
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from benchmarks.joined import TICK_S, sense
from surefoot.robot.reader import load_robot
from surefoot.services.estimator.stream import Estimator
from surefoot.services.simulator.ground.terrain import make_terrain
from surefoot.services.simulator.physics.perturb import perturbation
from surefoot.services.simulator.world import PhysicsWorld, WorldConfig
from surefoot.services.walker.biped.gait import BipedWalker
from surefoot.services.walker.biped.state import Mode
from surefoot.services.walker.interface import MotionCommand

WIDE, TIGHT = math.radians(11.5), math.radians(23.0)
ORDERS = {
    "walk": MotionCommand("walk", distance=0.6),
    "back": MotionCommand("walk", distance=-0.6),
    "left": MotionCommand("turn", angle=8 * TIGHT),
    "right": MotionCommand("turn", angle=-8 * TIGHT),
    "arc_left": MotionCommand("walk", distance=0.6, angle=6 * TIGHT),
    "arc_right": MotionCommand("walk", distance=0.6, angle=-6 * TIGHT),
    "bend_left": MotionCommand("walk", distance=0.6, angle=6 * WIDE),
    "bend_right": MotionCommand("walk", distance=0.6, angle=-6 * WIDE),
    "stop": MotionCommand("stop"),
    "walk_end": MotionCommand("walk", distance=0.2),
    "left_end": MotionCommand("turn", angle=2 * TIGHT),
    "right_end": MotionCommand("turn", angle=-2 * TIGHT),
    "arc_left_end": MotionCommand("walk", distance=0.2, angle=2 * TIGHT),
    "arc_right_end": MotionCommand("walk", distance=0.2, angle=-2 * TIGHT),
}
"""What may be under way, and what may come; of those with `_end` the fourth step is the last, the fifth closes."""
PAIRS = (
    ("left", "right"), ("right", "left"), ("walk", "left"), ("walk", "right"), ("left", "walk"), ("right", "walk"),
    ("arc_left", "arc_right"), ("arc_right", "arc_left"), ("bend_left", "arc_right"), ("bend_right", "arc_left"),
    ("left", "arc_right"), ("arc_right", "left"), ("walk", "arc_left"), ("arc_left", "walk"), ("walk", "stop"),
    ("left", "stop"), ("right", "stop"), ("arc_left", "stop"), ("walk", "back"),
    ("left_end", "right"), ("right_end", "left"), ("left_end", "left"), ("left_end", "walk"), ("left_end", "arc_right"),
    ("walk_end", "walk"), ("walk_end", "left"), ("walk_end", "right"), ("walk_end", "arc_left"), ("walk_end", "stop"),
    ("walk_end", "back"), ("arc_left_end", "arc_right"), ("arc_right_end", "arc_left"), ("arc_left_end", "walk"),
    ("arc_right_end", "right"), ("arc_left_end", "right"), ("left_end", "stop"),
)  # fmt: skip
MOMENTS = (0, 1, 2, 4, 6, 8, 10, 13, 16, 20, 24, 25, 26, 28, 32, 40, 50, 60, 70, 80, 89)
"""Ticks before the landing."""
STEPS = (-1, 3, 4)
"""The steps in which the new command comes: one of each foot; -1 = the shift of weight before the first."""
AFTER_S = 4.0
"""Simulated time that the robot is watched for from then on."""


@dataclass(frozen=True)
class Tried:
    """One command at one moment."""

    seed: int
    before: str
    after: str
    step: int
    ticks: int
    """Before the landing."""
    fallen: bool
    tilt_deg: float


class Robot:
    """World, estimator and walker, and the way back to where they were."""

    def __init__(self, seed: int, level: float, name: str = "nao", drift: float = 0.0) -> None:
        robot = load_robot(name)
        differs = perturbation(level, seed, robot.nj, robot.kind)
        self.world = PhysicsWorld(robot, make_terrain("flat"), seed, WorldConfig(perturbation=differs, drift=drift))
        self.estimator, self.walker = Estimator.for_robot(robot), BipedWalker(robot)
        self.pending = self.world.command.copy()

    def tick(self) -> Any:
        """One control tick with the one-tick actuation delay of bus servos."""
        out = self.walker.step(sense(self.world, self.estimator)[0])
        command, self.pending = self.pending, self.world.command if out.command is None else out.command
        self.world.step_tick(command)
        return out

    def saved(self) -> tuple[Any, ...]:
        return (
            self.world.checkpoint(),
            *copy.deepcopy((self.estimator, self.walker.state, self.walker.params)),
            self.pending,
        )

    def back(self, saved: tuple[Any, ...]) -> None:
        """Return to it."""
        self.world.restore(saved[0])
        self.estimator, self.walker.state, self.walker.params = copy.deepcopy(saved[1:4])
        self.pending = saved[4].copy()


def stand(robot: Robot) -> None:
    """Wait for the calibrated stance."""
    while robot.tick().state != "standing" or robot.walker.state.clock < 50:
        if robot.world.tick > 800:
            raise RuntimeError("the robot does not stand")


def moments(seed: int, before: str, afters: list[str], level: float, ticks: tuple[int, ...]) -> Iterator[Tried]:
    """Every command of `afters` at every moment of two steps of `before`."""
    robot = Robot(seed, level)
    stand(robot)
    robot.walker.command(ORDERS[before])
    for step in STEPS:
        mode = Mode.START if step < 0 else Mode.STEP
        while not (robot.walker.state.mode is mode and robot.walker.state.steps >= step):
            robot.tick()
            if robot.world.tick > 3000:
                raise RuntimeError(f"{before} has no step {step}")
        begin = robot.saved()
        for after in afters:
            for left in ticks:
                robot.back(begin)
                tilt = 0.0
                while robot.walker._ticks_left() > left:  # pyright: ignore[reportPrivateUsage] - the moment is its
                    robot.tick()
                robot.walker.command(ORDERS[after])
                for _ in range(round(AFTER_S / TICK_S)):
                    robot.tick()
                    tilt = max(tilt, robot.world.truth().tilt)
                    if robot.world.truth().fallen:
                        break
                yield Tried(seed, before, after, step, left, robot.world.truth().fallen, round(math.degrees(tilt), 2))
        robot.back(begin)


def _job(arguments: tuple[Any, ...]) -> list[Tried]:
    return list(moments(*arguments))


def summary(found: list[Tried]) -> str:
    """Falls and largest tilt by pair of commands, and by moment."""
    lines: list[str] = []
    for title, key in (("pair", lambda t: f"{t.before} -> {t.after}"), ("ticks before the landing", lambda t: t.ticks)):
        lines.append(f"by {title}:")
        for name in sorted({key(t) for t in found}):
            here = [t for t in found if key(t) == name]
            worst = max(here, key=lambda t: t.tilt_deg)
            over = sum(t.tilt_deg > 10.0 for t in here)
            lines.append(
                f"    {name}: {sum(t.fallen for t in here)} of {len(here)} fell, {over} over 10 deg, "
                f"tilt <= {worst.tilt_deg:.1f} deg "
                f"(seed {worst.seed}, {worst.before} -> {worst.after}, step {worst.step}, {worst.ticks} ticks)"
            )
    return "\n".join(lines)


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", default="0:5", help="first:end")
    parser.add_argument("--level", type=float, default=1.0)
    parser.add_argument("--ticks", help="before the landing, by commas")
    parser.add_argument("--pairs", help="as left:right,walk:stop")
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--results", type=Path, help="file that keeps finished runs")
    args = parser.parse_args()
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    first, end = (int(value) for value in args.seeds.split(":"))
    ticks = MOMENTS if args.ticks is None else tuple(int(value) for value in args.ticks.split(","))
    pairs = PAIRS if args.pairs is None else tuple(tuple(pair.split(":")) for pair in args.pairs.split(","))
    found: list[Tried] = []
    results: Path | None = args.results
    if results is not None and results.is_file():
        found = [Tried(**json.loads(line)) for line in results.read_text(encoding="utf-8").splitlines()]
    done = {(t.seed, t.before, t.after) for t in found}
    jobs: list[tuple[Any, ...]] = []
    for seed in range(first, end):
        for before in sorted({a for a, _ in pairs}):
            afters = [b for a, b in pairs if a == before and (seed, a, b) not in done]
            if afters:
                jobs.append((seed, before, afters, args.level, ticks))
    with ProcessPoolExecutor(args.jobs) as pool:
        for some in pool.map(_job, jobs):
            found += some
            if results is not None:
                with results.open("a", encoding="utf-8") as file:
                    file.writelines(json.dumps(asdict(one)) + "\n" for one in some)
    print(summary(found))


if __name__ == "__main__":
    main()
