"""What the actions of a navigator become on a simulated Nao: time, way and turn of each, one chained to the other.

Each command is given 0.3 s before the end of the one before, as `ends_in_s` reports it. Poses are those of base_link
at the landing of an action's last step, by truth; they are read by the judge only.

    python -m benchmarks.bench_actions --seeds 0:10
    python -m benchmarks.bench_actions --seeds 0:16 --actions walk,arc_left --drift 2
"""

import argparse
import math
import os
from collections.abc import Iterable
from concurrent.futures import ProcessPoolExecutor
from typing import Any, NamedTuple

import numpy as np

from benchmarks.bench_orders import Robot, stand
from benchmarks.joined import TICK_S
from surefoot.services.walker.interface import MotionCommand

WALK_M, TURN = 0.1, math.radians(23.0)
ACTIONS = {
    "walk": MotionCommand("walk", distance=WALK_M, learn=False),
    "left": MotionCommand("turn", angle=TURN, learn=False),
    "right": MotionCommand("turn", angle=-TURN, learn=False),
    "bend_left": MotionCommand("walk", distance=WALK_M, angle=0.5 * TURN, learn=False),
    "bend_right": MotionCommand("walk", distance=WALK_M, angle=-0.5 * TURN, learn=False),
    "arc_left": MotionCommand("walk", distance=WALK_M, angle=TURN, learn=False),
    "arc_right": MotionCommand("walk", distance=WALK_M, angle=-TURN, learn=False),
}
AHEAD_S = 0.3
STAND_S = 0.7


class Done(NamedTuple):
    """One action."""

    action: str
    before: str
    """The action before it."""
    seconds: float
    forward: float
    """m along the heading at its begin."""
    left: float
    """m"""
    turn: float
    """rad"""
    tilt: float
    """Largest of the trunk, rad."""


class Fell(Exception):
    """The robot has fallen."""


class Chain:
    """A robot that is led from action to action.

    Args:
        seed: of everything random.
        level: of the perturbation.
        drift: of the world, rad/m.
    """

    def __init__(self, seed: int, level: float, drift: float) -> None:
        self.robot, self.last, self.tilt = Robot(seed, level, drift=drift), "stand", 0.0
        stand(self.robot)
        self.begin, self.done = self._pose(), list[Done]()

    def _pose(self) -> tuple[int, Any, float]:
        truth = self.robot.world.truth()
        w, x, y, z = truth.quat_wxyz
        return (
            self.robot.world.tick,
            truth.position[:2].copy(),
            math.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z)),
        )

    def _tick(self) -> Any:
        out = self.robot.tick()
        truth = self.robot.world.truth()
        self.tilt = max(self.tilt, truth.tilt)
        if truth.fallen:
            raise Fell
        return out

    def _note(self, action: str) -> None:
        (tick, place, yaw), (now, there, turned) = self.begin, self._pose()
        move, c, s = there - place, math.cos(yaw), math.sin(yaw)
        turn = math.atan2(math.sin(turned - yaw), math.cos(turned - yaw))
        forward, left = float(c * move[0] + s * move[1]), float(c * move[1] - s * move[0])
        self.done.append(Done(action, self.last, TICK_S * (now - tick), forward, left, turn, self.tilt))
        self.begin, self.last, self.tilt = self._pose(), action, 0.0

    def act(self, action: str, following: str) -> None:
        """Carry out an action that was commanded, and command the following one before its end."""
        if action == "stand":
            while self._tick().state != "standing":
                pass
            for _ in range(round(STAND_S / TICK_S)):
                self._tick()
        else:
            steps = self.robot.walker.state.steps
            while (self._tick().ends_in_s or math.inf) > AHEAD_S:
                pass
            steps = self.robot.walker.state.steps
            self.command(following)
            while self.robot.walker.state.steps == steps:
                self._tick()
        self._note(action)
        if action == "stand":
            self.command(following)

    def command(self, action: str) -> None:
        """Command the next action."""
        self.robot.walker.command(MotionCommand("stop") if action == "stand" else ACTIONS[action])


def chain(seed: int, actions: tuple[str, ...], level: float, drift: float) -> tuple[int, list[Done], bool]:
    """Carry out actions one after the other; returns the seed, what came of them and whether the robot fell."""
    led = Chain(seed, level, drift)
    led.command(actions[0])
    try:
        for action, following in zip(actions, (*actions[1:], "stand"), strict=True):
            led.act(action, following)
    except Fell:
        return seed, led.done, True
    return seed, led.done, False


def _job(arguments: tuple[Any, ...]) -> tuple[int, list[Done], bool]:
    return chain(*arguments)


def row(name: str, by_seed: list[list[Done]]) -> str:
    """Mean, standard deviation between seeds and from action to action of a seed."""
    parts: list[str] = []
    for field, unit, scale, form in (
        ("seconds", "s", 1.0, ".2f"), ("forward", "mm", 1e3, ".1f"), ("left", "mm", 1e3, ".1f"),
        ("turn", "deg", math.degrees(1.0), ".2f"),
    ):  # fmt: skip
        values = [np.array([scale * getattr(one, field) for one in some]) for some in by_seed]
        between = float(np.std([v.mean() for v in values]))
        within = float(np.sqrt(np.mean([v.var() for v in values])))
        mean = float(np.mean([v.mean() for v in values]))
        parts.append(f"{field} {mean:{form}} +-{between:{form}} +-{within:{form}} {unit}")
    tilt = max(one.tilt for some in by_seed for one in some)
    return f"{name:>24} n {sum(map(len, by_seed)):4}: {', '.join(parts)}; tilt <= {math.degrees(tilt):.1f} deg"


def table(found: Iterable[list[Done]], whole: bool) -> str:
    """One row for each action, or for each action after each other one."""
    rows: dict[str, list[list[Done]]] = {}
    for done in found:
        groups: dict[str, list[Done]] = {}
        for one in done:
            first = one.before == "stand" or one.action == "stand"
            groups.setdefault(f"{one.action} after {one.before}" if whole or first else one.action, []).append(one)
        for name, some in groups.items():
            rows.setdefault(name, []).append(some)
    return "\n".join(row(name, some) for name, some in sorted(rows.items()))


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", default="0:4", help="first:end")
    parser.add_argument("--level", type=float, default=1.0, help="of the perturbation")
    parser.add_argument("--drift", type=float, default=0.0, help="deg per 10 cm")
    parser.add_argument("--actions", default=",".join(ACTIONS), help="names by commas; each in a chain of its own")
    parser.add_argument("--count", type=int, default=8, help="actions of a chain")
    parser.add_argument("--mixed", action="store_true", help="all actions in one chain, in random order")
    parser.add_argument("--jobs", type=int, default=1)
    args = parser.parse_args()
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    first, end = (int(value) for value in args.seeds.split(":"))
    names, drift = args.actions.split(","), math.radians(args.drift) / 0.1
    jobs: list[tuple[Any, ...]] = []
    for seed in range(first, end):
        chains = [(name,) * args.count for name in names]
        if args.mixed:
            chains = [tuple(np.random.default_rng(seed).choice([*names, "stand"], args.count).tolist())]
        jobs += [(seed, some, args.level, drift) for some in chains]
    found: dict[int, list[Done]] = {}
    fell = 0
    with ProcessPoolExecutor(args.jobs) as pool:
        for seed, done, down in pool.map(_job, jobs):
            found.setdefault(seed, []).extend(done)
            fell += down
    print(f"{len(jobs)} chains, {fell} fell; mean +-sd between seeds +-sd from action to action")
    print(table(found.values(), args.mixed))


if __name__ == "__main__":
    main()
