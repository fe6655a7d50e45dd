"""Walkers in the simulated world: commands at any moment, actions one after the other, robots held in place.

World, estimator and walker are joined by function calls. Truth is read for the figures only.
"""

import copy
import math
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from benchmarks.bench import Bench, table, words_of
from surefoot.lab.runs.joined import TICK_S, sense
from surefoot.lab.statistics import wilson
from surefoot.lab.studies import Line, seeds_of, study
from surefoot.robot.reader import load_robot
from surefoot.services.estimator.stream import Estimator
from surefoot.services.simulator.ground.terrain import make_terrain
from surefoot.services.simulator.physics.perturb import perturbation
from surefoot.services.simulator.world import PhysicsWorld, WorldConfig
from surefoot.services.walker.biped.gait import BipedWalker
from surefoot.services.walker.biped.state import Mode
from surefoot.services.walker.interface import MotionCommand, WalkerOutputs
from surefoot.services.walker.legged.gait import LeggedWalker

BENCH = Bench("walker")

WIDE, TIGHT = math.radians(11.5), math.radians(23.0)
LONG, SHORT = 0.6, 0.2
"""`LONG`: distance of a command that continues past the moments tried, m; `SHORT`: distance of one whose fourth step is
the last, m."""
ORDERS = {
    "walk": MotionCommand("walk", distance=LONG), "back": MotionCommand("walk", distance=-LONG),
    "left": MotionCommand("turn", angle=8 * TIGHT), "right": MotionCommand("turn", angle=-8 * TIGHT),
    "arc_left": MotionCommand("walk", distance=LONG, angle=6 * TIGHT),
    "arc_right": MotionCommand("walk", distance=LONG, angle=-6 * TIGHT),
    "bend_left": MotionCommand("walk", distance=LONG, angle=6 * WIDE),
    "bend_right": MotionCommand("walk", distance=LONG, angle=-6 * WIDE), "stop": MotionCommand("stop"),
    "walk_end": MotionCommand("walk", distance=SHORT), "left_end": MotionCommand("turn", angle=2 * TIGHT),
    "right_end": MotionCommand("turn", angle=-2 * TIGHT),
    "arc_left_end": MotionCommand("walk", distance=SHORT, angle=2 * TIGHT),
    "arc_right_end": MotionCommand("walk", distance=SHORT, angle=-2 * TIGHT),
}  # fmt: skip
"""Commands by name, used as the one under way or the new one; of those that end in `_end` the fourth step is the last,
the fifth closes."""
PAIRS = (
    "left:right,right:left,walk:left,walk:right,left:walk,right:walk,arc_left:arc_right,arc_right:arc_left,"
    "bend_left:arc_right,bend_right:arc_left,left:arc_right,arc_right:left,walk:arc_left,arc_left:walk,walk:stop,"
    "left:stop,right:stop,arc_left:stop,walk:back,left_end:right,right_end:left,left_end:left,left_end:walk,"
    "left_end:arc_right,walk_end:walk,walk_end:left,walk_end:right,walk_end:arc_left,walk_end:stop,walk_end:back,"
    "arc_left_end:arc_right,arc_right_end:arc_left,arc_left_end:walk,arc_right_end:right,arc_left_end:right,"
    "left_end:stop"
)
MOMENTS = "0,1,2,4,6,8,10,13,16,20,24,25,26,28,32,40,50,60,70,80,89"
"""Default moments of the new command, in ticks before the landing of a step."""
STEPS = (-1, 3, 4)
"""Numbers of the steps in which the new command arrives, one of each foot; -1 = the shift of weight before the
first."""
AFTER_S = 4.0
"""Simulated time for which the robot is observed after the new command, s."""
STEEP_DEG = 10.0
"""Tilt of the trunk, deg, above which a run counts as steep in the table."""


class Loop:
    """World, estimator and walker of a robot, with the one-tick actuation delay of bus servos.

    Args:
        seed: seed of all random numbers.
        level: level of the perturbation of masses, servos and sensors.
        name: name of the robot.
        drift: turn of the robot's straight walk, rad/m.
    """

    def __init__(self, seed: int, level: float = 1.0, name: str = "nao", drift: float = 0.0) -> None:
        robot = load_robot(name)
        config = WorldConfig(perturbation=perturbation(level, seed, robot.nj, robot.kind), drift=drift)
        self.world = PhysicsWorld(robot, make_terrain("flat"), seed, config)
        self.estimator = Estimator.for_robot(robot)
        self.walker: Any = BipedWalker(robot) if robot.kind == "biped" else LeggedWalker(robot)
        self.pending = self.world.command.copy()

    def tick(self) -> WalkerOutputs:
        """Simulate one control tick of 10 ms of world, estimator and walker; return the walker's outputs."""
        out = self.walker.step(sense(self.world, self.estimator)[0])
        command, self.pending = self.pending, self.world.command if out.command is None else out.command
        self.world.step_tick(command)
        return out

    def saved(self) -> tuple[Any, ...]:
        """Return a copy of the state of world, estimator and walker, from which `back` continues."""
        parts = copy.deepcopy((self.estimator, self.walker.state, self.walker.params))
        return (self.world.checkpoint(), *parts, self.pending)

    def back(self, saved: tuple[Any, ...]) -> None:
        """Restore the whole state that `saved` returned earlier."""
        self.world.restore(saved[0])
        self.estimator, self.walker.state, self.walker.params = copy.deepcopy(saved[1:4])
        self.pending = saved[4].copy()

    def stand(self) -> None:
        """Run control ticks until the robot stands and its estimator is calibrated."""
        while self.tick().state != "standing" or self.walker.state.clock < 50:
            if self.world.tick > 800:
                raise RuntimeError("the robot does not stand")

    def pose(self) -> tuple[int, Any, float]:
        """Return the tick, the true place in m, (2,), and the true yaw, rad."""
        truth = self.world.truth()
        w, x, y, z = truth.quat_wxyz
        return self.world.tick, truth.position[:2].copy(), math.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))


def interrupted(seed: int, before: str, after: str, level: float, ticks: tuple[int, ...]) -> Line:
    """Issue one command at every given moment of some steps of another; return fall and largest tilt of each trial."""
    robot, tried = Loop(seed, level), list[dict[str, Any]]()
    robot.stand()
    robot.walker.command(ORDERS[before])
    for step in STEPS:
        mode = Mode.START if step < 0 else Mode.STEP
        while not (robot.walker.state.mode is mode and robot.walker.state.steps >= step):
            robot.tick()
            if robot.world.tick > 3000:
                raise RuntimeError(f"{before} has no step {step}")
        begin = robot.saved()
        for left in ticks:
            robot.back(begin)
            tilt = 0.0
            while robot.walker._ticks_left() > left:
                robot.tick()
            robot.walker.command(ORDERS[after])
            for _ in range(round(AFTER_S / TICK_S)):
                robot.tick()
                tilt = max(tilt, robot.world.truth().tilt)
                if robot.world.truth().fallen:
                    break
            fallen = bool(robot.world.truth().fallen)
            tried.append({"step": step, "ticks": left, "fallen": fallen, "tilt_deg": round(math.degrees(tilt), 2)})
        robot.back(begin)
    return {"tried": tried}


@BENCH.part()
def orders(
    *, seeds: str = "0:5", level: float = 1.0, ticks: str = MOMENTS, pairs: str = PAIRS, processes: int = 1,
    results: Path | None = None,
) -> None:  # fmt: skip
    """Command a walking Nao at any moment of a step: print falls and the largest tilt.

    Of each seed and each command under way the state at the begin of a step is kept, and every other command is tried
    from there at every moment.

    Args:
        level: level of the perturbation of masses, servos and sensors; 0 = none.
        ticks: ticks before the landing, comma-separated.
        pairs: command under way and command that comes, as left:right,walk:stop.
    """
    chosen = [pair.split(":") for pair in words_of(pairs)]
    jobs = [{"seed": seed, "before": a, "after": b} for seed in seeds_of(seeds) for a, b in chosen]
    moments = tuple(int(value) for value in words_of(ticks))
    lines = study(partial(interrupted, level=level, ticks=moments), jobs, results, processes=processes)
    found = [{**line, "pair": f"{line['before']} -> {line['after']}", **one} for line in lines for one in line["tried"]]
    for title, key in (("pair", "pair"), ("ticks before the landing", "ticks")):
        rows: list[tuple[object, ...]] = []
        for name in sorted({one[key] for one in found}):
            here = [one for one in found if one[key] == name]
            worst = max(here, key=lambda one: one["tilt_deg"])
            where = f"seed {worst['seed']}, {worst['pair']}, step {worst['step']}, {worst['ticks']} ticks"
            steep = sum(one["tilt_deg"] > STEEP_DEG for one in here)
            rows.append((str(name), sum(one["fallen"] for one in here), len(here), steep, worst["tilt_deg"], where))
        header = (title, "fell", "of", f"over {STEEP_DEG:g} deg", "tilt <= deg", "largest at")
        table(f"{sum(one['fallen'] for one in found)} of {len(found)} fell", header, rows)


STEP_M = 0.1
ACTIONS = {
    "walk": MotionCommand("walk", distance=STEP_M, learn=False),
    "left": MotionCommand("turn", angle=TIGHT, learn=False),
    "right": MotionCommand("turn", angle=-TIGHT, learn=False),
    "bend_left": MotionCommand("walk", distance=STEP_M, angle=0.5 * TIGHT, learn=False),
    "bend_right": MotionCommand("walk", distance=STEP_M, angle=-0.5 * TIGHT, learn=False),
    "arc_left": MotionCommand("walk", distance=STEP_M, angle=TIGHT, learn=False),
    "arc_right": MotionCommand("walk", distance=STEP_M, angle=-TIGHT, learn=False),
}
"""Commands of a navigator's actions by name."""
AHEAD_S = 0.3
"""Time before the end of an action at which the next one is commanded, s."""
STAND_S = 0.7


class Done(NamedTuple):
    """One action, from the landing of the last step before it to that of its own last step."""

    action: str
    before: str
    """Name of the action before this one."""
    seconds: float
    """Duration of the action, s."""
    forward: float
    """Displacement of base_link along its heading at the beginning of the action, m."""
    left: float
    """Displacement of base_link to the left of its heading at the beginning of the action, m."""
    turn: float
    """Change of the yaw over the action, rad, left positive."""
    tilt: float
    """Largest tilt of the trunk during the action, rad."""


class Fell(Exception):
    """Raised when the simulated robot has fallen."""


@dataclass
class Chain:
    """Robot that carries out actions one after the other, with the present action and its largest tilt, rad."""

    robot: Loop
    last: str = "stand"
    tilt: float = 0.0

    def __post_init__(self) -> None:
        self.robot.stand()
        self.begin, self.done = self.robot.pose(), list[Done]()

    def _tick(self) -> WalkerOutputs:
        out, truth = self.robot.tick(), self.robot.world.truth()
        self.tilt = max(self.tilt, truth.tilt)
        if truth.fallen:
            raise Fell
        return out

    def _note(self, action: str) -> None:
        (tick, place, yaw), (now, there, turned) = self.begin, self.robot.pose()
        move, c, s = there - place, math.cos(yaw), math.sin(yaw)
        turn = math.atan2(math.sin(turned - yaw), math.cos(turned - yaw))
        forward, left = float(c * move[0] + s * move[1]), float(c * move[1] - s * move[0])
        self.done.append(Done(action, self.last, TICK_S * (now - tick), forward, left, turn, self.tilt))
        self.begin, self.last, self.tilt = self.robot.pose(), action, 0.0

    def act(self, action: str, following: str) -> None:
        """Carry out an action that was commanded, and command the following one before its end."""
        if action == "stand":
            while self._tick().state != "standing":
                pass
            for _ in range(round(STAND_S / TICK_S)):
                self._tick()
        else:
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
        """Command the next action from the walker."""
        self.robot.walker.command(MotionCommand("stop") if action == "stand" else ACTIONS[action])


def chained(seed: int, actions: str, level: float, drift: float) -> Line:
    """Execute actions, comma-separated, one after the other; return each, and whether the robot fell."""
    chain, names = Chain(Loop(seed, level, drift=drift)), words_of(actions)
    chain.command(names[0])
    try:
        for action, following in zip(names, (*names[1:], "stand"), strict=True):
            chain.act(action, following)
    except Fell:
        return {"done": chain.done, "fell": True}
    return {"done": chain.done, "fell": False}


def _row(name: str, by_seed: Sequence[Sequence[Done]]) -> tuple[object, ...]:
    """Return a table row: mean, standard deviation between seeds, and standard deviation between actions of a seed."""
    cells: list[str] = []
    for field, scale, form in (("seconds", 1.0, ".2f"), ("forward", 1e3, ".1f"), ("left", 1e3, ".1f"),
                               ("turn", math.degrees(1.0), ".2f")):  # fmt: skip
        values = [np.array([scale * getattr(one, field) for one in some]) for some in by_seed]
        between, within = np.std([v.mean() for v in values]), np.sqrt(np.mean([v.var() for v in values]))
        cells.append(f"{np.mean([v.mean() for v in values]):{form}} +-{between:{form}} +-{within:{form}}")
    tilt = math.degrees(max(one.tilt for some in by_seed for one in some))
    return name, sum(map(len, by_seed)), *cells, f"{tilt:.1f}"


@BENCH.part("--seeds 0:1 --actions walk --count 2")
def actions(
    *, seeds: str = "0:4", level: float = 1.0, drift: float = 0.0, actions: str = ",".join(ACTIONS), count: int = 8,
    mixed: bool = False, processes: int = 1, results: Path | None = None,
) -> None:  # fmt: skip
    """Print duration, distance and turn of a navigator's actions on a Nao, one carried out directly after the other.

    Each command is given 0.3 s before the end of the one before, as `ends_in_s` reports it. Poses are those of
    base_link at the landing of an action's last step.

    Args:
        level: level of the perturbation of masses, servos and sensors; 0 = none.
        drift: turn of the robot's straight walk, deg per 10 cm.
        actions: names of actions, comma-separated; each in a chain of its own.
        count: actions of a chain.
        mixed: all actions in one chain, in random order.
    """
    names, jobs = words_of(actions), list[dict[str, Any]]()
    for seed in seeds_of(seeds):
        chains = [(name,) * count for name in names]
        if mixed:
            chains = [tuple(np.random.default_rng(seed).choice([*names, "stand"], count).tolist())]
        jobs += [{"seed": seed, "actions": ",".join(some)} for some in chains]
    lines = study(partial(chained, level=level, drift=math.radians(drift) / 0.1), jobs, results, processes=processes)
    rows: dict[str, dict[int, list[Done]]] = {}
    for line in lines:
        for one in (Done(*each) for each in line["done"]):
            pair = mixed or "stand" in (one.before, one.action)
            name = f"{one.action} after {one.before}" if pair else one.action
            rows.setdefault(name, {}).setdefault(line["seed"], []).append(one)
    table(
        f"{len(lines)} chains, {sum(line['fell'] for line in lines)} fell; mean +-sd between seeds +-sd within",
        ("action", "n", "s", "forward mm", "left mm", "turn deg", "tilt <= deg"),
        [_row(name, list(rows[name].values())) for name in sorted(rows)],
    )


ROBOTS = ("bioloid", "nao", "ragno")
HELD_TICKS, MOST_TICKS = 300, 3000
HELD_M = 0.2
"""Distance of the walk during which the robot is held, m."""


def moments_of(name: str, seed: int, every: int) -> Iterator[tuple[str, bool]]:
    """Yield, for the moments of one walk, whether one foot or all stood, and whether the held robot fell."""
    loop, walked = Loop(seed, 1.0, name), False
    for tick in range(MOST_TICKS):
        out = loop.tick()
        if out.state == "standing":
            if walked:
                return
            walked = loop.walker.command(MotionCommand("walk", distance=HELD_M)).accepted
        elif walked and tick % every == 0:
            yield "all feet" if bool(out.stance.all()) else "in a step", falls(loop.world)
    raise RuntimeError(f"{name} seed {seed} does not end its walk in {MOST_TICKS} ticks")


def falls(world: PhysicsWorld) -> bool:
    """Return True if the robot falls within 3 s without commands; the state of the world is restored afterwards."""
    saved = world.checkpoint()
    for _ in range(HELD_TICKS):
        world.step_tick(None)
        if world.truth().fallen:
            break
    fallen = bool(world.truth().fallen)
    world.restore(saved)
    return fallen


@BENCH.part("ragno --seeds 0:1 --every 200")
def held(*robots: str, seeds: str = "0:4", every: int = 5) -> None:
    """Stop all commands at one tick of a walk: print how many robots fall while the joints are held for 3 s.

    In every so many ticks the world is saved, held without commands until it has fallen or 3 s are over, and restored.
    Nothing else goes wrong, so a robot that falls here could not have been held. The driver holds the same way when no
    command comes (100 ms).

    Args:
        robots: names; default: bioloid, nao and ragno.
        every: ticks between two moments.
    """
    rows: list[tuple[object, ...]] = []
    for name in robots or ROBOTS:
        total, fallen = Counter[str](), Counter[str]()
        for seed in seeds_of(seeds):
            for where, fell in moments_of(name, seed, every):
                total[where] += 1
                fallen[where] += fell
        for where in sorted(total):
            below = f"{100 * wilson(fallen[where], total[where])[1]:.1f} %"
            rows.append((f"{name}, {where}", fallen[where], total[where], below))
    table("held robots", ("robot, moment", "fall", "of", "below (95 %)"), rows)
