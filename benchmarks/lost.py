"""Lost robots: time until the navigator notices and recovers, wrong maps, false alarms, processor time of a tick.

The service `navigator` runs whole (localiser, tracker, pilot, maps), and its own `lost` of `state/pose` is measured.
"""

import math
import time
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from statistics import median

import numpy as np
from numpy.typing import NDArray

from benchmarks.bench import Bench, goal, seconds_of, table
from benchmarks.lost_floor import World
from benchmarks.lost_robot import TICK, WEIGHED_S, Robot, wrapped
from surefoot.arrays import Array
from surefoot.lab.studies import Line, study

BENCH = Bench("lost")

CHI2_95 = 7.815
"""95 % quantile of the chi-squared distribution with three degrees of freedom, for the NEES of a pose."""
ENOUGH = 4
"""Number of detected landmarks of another place that make a robot count as lost: 8.6 nats of 1.4 to 2 each."""
NEEDED = 8.6
"""Log likelihood ratio, nats, from which on an oracle decides that a robot was put down elsewhere: odds of 9 after a
prior probability of 1e-3 per s over 1.7 s."""
LONGEST_S = 20.0
"""Longest wait for a robot that was put down elsewhere to notice it, s."""

APART_S = 300.0
"""Longest wait for a lost robot to find its pose, s."""


def put_down(seed: int, distance: float, turn_deg: float, walking: bool, world: World) -> Line:
    """Put a robot down elsewhere while it walks or stands; return when it noticed and recovered."""
    robot = Robot(seed, world)
    robot.step(0.3)
    if walking:
        robot.goto(5.0, 0.0)
    robot.step(12.0 + 0.1 * (seed % 40))
    early = robot.lost
    robot.put(distance, turn_deg)
    before, placed_at = robot.navigator.localiser.relocated, robot.tick_number
    noticed = robot.until(lambda: robot.lost or robot.navigator.localiser.relocated > before, LONGEST_S)
    recovered = None if noticed is None else robot.until(lambda: not robot.lost, 40.0)
    far, turned = robot.error()
    wrong = recovered is not None and (far > 0.3 or turned > 0.5)
    if noticed is not None and noticed < WEIGHED_S:
        robot.step(WEIGHED_S - TICK * (robot.tick_number - placed_at))
    sights = [TICK * (tick - placed_at) for tick in robot.sights]
    known = sum(value for value, _ in robot.evidence)
    anywhere = float(np.logaddexp.reduce(sum((values for _, values in robot.evidence), robot.weights)))
    return {
        "early": early, "noticed": noticed, "sights": sights, "recovered": recovered, "far": far, "wrong": wrong,
        "decided": known >= NEEDED, "found": anywhere >= NEEDED,
    }  # fmt: skip


def with_map(seed: int, kind: str, world: World) -> Line:
    """Walk by a map that does not fit; return when and after how many metres it counts as lost."""
    robot = Robot(seed, world, kind)
    robot.step(0.3)
    robot.goto(5.0, 0.0)
    noticed = robot.until(lambda: robot.lost, LONGEST_S)
    return {"noticed": noticed, "walked": math.hypot(*robot.walker.pose[:2].tolist())}


def undisturbed(seed: int, minutes: float, world: World) -> Line:
    """Return the alarms of a robot that walks to and fro and stands, and its NEES per degree of freedom."""
    robot, alarms, was = Robot(seed, world), 0, False
    nees: list[float] = []
    robot.step(0.31)  # then every 0.1 s ends with a tick in which the belief is published
    for leg in range(1000):
        if robot.tick_number * TICK > 60.0 * minutes:
            break
        robot.goto(*((4.5, 0.2), (0.3, -0.2))[leg % 2])
        for _ in range(1200):
            robot.step(0.1)
            alarms, was = alarms + (robot.lost and not was), robot.lost
            nees.append(consistency(robot))
            if not robot.navigator.pilot.under_way:
                break
        robot.step(3.0)
    return {
        "alarms": alarms,
        "nees": float(np.mean(nees)),
        "inside": percent(np.array(nees) <= CHI2_95 / 3.0),
        "minutes": robot.tick_number * TICK / 60.0,
    }


def consistency(robot: Robot) -> float:
    """Return the NEES of the navigator's believed pose per degree of freedom."""
    tracker = robot.navigator.localiser.tracker
    e = np.array(tracker.pose) - robot.walker.pose
    e[2] = wrapped(e[2])
    return float(e @ np.linalg.solve(tracker.cov[:3, :3], e)) / 3.0


CASES = (
    (0.35, 20.0), (0.35, 90.0), (0.7, 20.0), (0.7, 90.0), (0.7, 180.0), (1.5, 90.0), (3.0, 20.0), (3.0, 180.0),
)  # fmt: skip
"""Displacements of the robot that are tried: distance, m, and turn, deg."""


def shares(lines: list[Line], limit: float) -> tuple[float, ...]:
    """Return share within `limit` s, share not within the longest time, median and 95 % quantile of the others, s."""
    times = times_of(lines)
    found = np.quantile(times, (0.5, 0.95), method="higher")
    return (100.0 * float((times <= limit).mean()), 100.0 * float(np.isinf(times).mean()), *map(float, found))


def oracles(lines: list[Line]) -> tuple[float, float]:
    """Return the shares of robots that two oracles count as put down by the frames of 3 s, %.

    Both know the camera and where a robot that was not put down would be, and need as many nats as the navigator; one
    knows where this one is, the other weighs all places of the corridor alike. Their false alarms are not counted.
    """
    known, anywhere = (percent(np.array([line[name] for line in lines])) for name in ("decided", "found"))
    return known, anywhere


def percent(these: NDArray[np.bool_]) -> float:
    """Return the share of the flags `these`, (n,), that are True, %."""
    return 100.0 * float(these.mean())


def times_of(lines: list[Line]) -> Array:
    """Return the times until robots noticed that they were put down elsewhere, (n,) s, inf = never."""
    return np.array([math.inf if line["noticed"] is None else line["noticed"] for line in lines])


@BENCH.part("--robots 1")
def put(*, robots: int = 12, world: World, processes: int = 1) -> None:
    """Share of robots that the navigator counts as lost within 3 s after they were put down elsewhere.

    Args:
        robots: number of robots of each case.
        world: conditions.
    """
    jobs = [
        {"seed": world.first + seed, "distance": distance, "turn_deg": turn, "walking": walking}
        for distance, turn in CASES for walking in (True, False) for seed in range(robots)
    ]  # fmt: skip
    lines = study(partial(put_down, world=world), jobs, processes=processes)
    rows: list[tuple[object, ...]] = []
    for walking in (True, False):
        for distance, turn in CASES:
            own = [
                line for line in lines
                if (line["distance"], line["turn_deg"], line["walking"]) == (distance, turn, walking)
            ]  # fmt: skip
            back = [line["recovered"] for line in own if line["recovered"] is not None]
            name = f"{distance:g} m, {turn:g} deg, {'walking' if walking else 'standing'}"
            rows.append((name, *shares(own, WEIGHED_S), *oracles(own), len(back), sum(line["wrong"] for line in own)))
    for name, own in (
        ("all walking", [line for line in lines if line["walking"]]),
        ("all standing", [line for line in lines if not line["walking"]]), ("all", lines),
    ):  # fmt: skip
        back = sum(line["recovered"] is not None for line in own)
        rows.append((name, *shares(own, WEIGHED_S), *oracles(own), back, sum(line["wrong"] for line in own)))
    for count in (1, ENOUGH):
        seen = np.array([sorted(line["sights"])[count - 1] if len(line["sights"]) >= count else 0.0 for line in lines])
        what = f"noticed within 3 s of the sight of {count} landmark{'s' if count > 1 else ''}"
        goal(what, percent(times_of(lines) <= seen + WEIGHED_S), ">=", 99.0, "%")
    could = [line for line in lines if line["found"]]
    if could:
        goal("noticed within 3 s, of those of the oracle by no pose", shares(could, WEIGHED_S)[0], ">=", 99.0, "%")
    header = ("case", "% within 3 s", "% not in 20 s", "median s", "95 % s", "oracle %", "by no pose %", "recovered",
              "wrong poses")  # fmt: skip
    table(f"{robots} robots a case, {world}", header, rows)


def told_apart(seed: int, world: World) -> Line:
    """Put a walking robot down where places look alike; return the outcome, its time, and the distance walked."""
    robot = Robot(seed, world)
    robot.step(0.3)
    robot.goto(5.0, 0.0)
    robot.step(30.0)
    robot.put(0.7 + 0.2 * (seed % 8), 90.0 * (seed % 4))
    robot.until(lambda: robot.lost, LONGEST_S)
    pilot, way, here, began = robot.navigator.pilot, 0.0, robot.walker.pose[:2].copy(), robot.tick_number
    while robot.lost and pilot.under_way and TICK * (robot.tick_number - began) < APART_S:
        robot.step(0.1)
        way, here = way + math.dist(here, robot.walker.pose[:2]), robot.walker.pose[:2].copy()
    far, turned = robot.error()
    found = not robot.lost
    return {"found": found, "wrong": found and bool(far > 0.3 or turned > 0.5), "way": way,
            "time": TICK * (robot.tick_number - began), "far": far}  # fmt: skip


@BENCH.part("--robots 1")
def alike(*, robots: int = 40, world: World, processes: int = 1) -> None:
    """Share of lost robots that find their pose on a floor of which the middle looks alike when turned by half.

    Args:
        robots: number of robots.
        world: conditions; each landmark stands twice but for `apart`, 1 m if it is 0, and none is copied.
    """
    floor = replace(world, twice=1.0, copied=0.0, apart=world.apart or 1.0)
    lines = study(partial(told_apart, world=floor), [{"seed": world.first + k} for k in range(robots)],
                  processes=processes)  # fmt: skip
    own = [line for line in lines if line["found"]]
    middle = [median(line[name] for line in own) if own else math.nan for name in ("time", "way")]
    most = max(line["way"] for line in lines)
    table(f"{robots} robots, {floor}",
          ("found %", "median s", "walked m", "most walked m", "wrong poses"),
          [(100.0 * len(own) / robots, *middle, most, sum(line["wrong"] for line in lines))])  # fmt: skip


def turned(seed: int, pitch: float, roll: float, aside: float, world: World) -> Line:
    """Walk with a turned camera; return when the turn was found and what is left of it after 30 s, deg."""
    planted = (math.radians(pitch), math.radians(roll), math.radians(aside))
    robot = Robot(seed, world, turn=planted)
    localiser = robot.navigator.localiser
    robot.step(0.3)
    robot.goto(5.0, 0.0)
    found = robot.until(lambda: localiser.camera_turn != (0.0, 0.0, 0.0), 30.0)
    if found is not None:
        robot.step(30.0 - found)
    left = [math.degrees(a - b) for a, b in zip(planted, localiser.camera_turn, strict=True)]
    return {"noticed": found, "left": left, "lost": robot.lost, "far": robot.error()[0]}


TURNS = ((0.0, 0.0, 0.0), (2.0, 0.0, 0.0), (-4.0, 0.0, 0.0), (0.0, 3.0, 0.0), (0.0, 0.0, 6.0), (3.0, -3.0, -5.0))
"""Rotations of the camera from its assumed mount that are tried: pitch, roll and turn about the vertical, deg."""


@BENCH.part("--robots 1")
def turns(*, robots: int = 12, world: World, processes: int = 1) -> None:
    """Time until the navigator finds that its camera is turned, and what is left of the turn after 30 s.

    Args:
        robots: number of robots of each turn of the camera.
        world: conditions.
    """
    names = ("pitch", "roll", "aside")
    jobs = [
        {"seed": world.first + seed, **dict(zip(names, each, strict=True))} for each in TURNS for seed in range(robots)
    ]
    lines = study(partial(turned, world=world), jobs, processes=processes)
    rows: list[tuple[object, ...]] = []
    for each in TURNS:
        own = [line for line in lines if tuple(line[name] for name in names) == each]
        left = np.sqrt(np.mean(np.square([line["left"] for line in own]), axis=0)).tolist()
        far = float(np.sqrt(np.mean([line["far"] ** 2 for line in own])))
        name = ", ".join(f"{angle:g}" for angle in each)
        rows.append((name, *shares(own, 3.0), *left, far, sum(line["lost"] for line in own)))
    header = ("pitch, roll, aside deg", "% within 3 s", "% never", "median s", "95 % s", "left of pitch", "roll",
              "aside", "error m", "lost")  # fmt: skip
    table(f"{robots} robots a turn, {world}", header, rows)


@BENCH.part("--robots 1")
def maps(*, robots: int = 12, world: World, processes: int = 1) -> None:
    """Time and distance until the navigator counts as lost with a map that does not fit the floor.

    Args:
        robots: number of robots of each kind of map.
        world: conditions.
    """
    kinds = ("mirrored", "shuffled", "stretched")
    jobs = [{"seed": world.first + seed, "kind": kind} for kind in kinds for seed in range(robots)]
    lines = study(partial(with_map, world=world), jobs, processes=processes)
    rows: list[tuple[object, ...]] = []
    for kind in kinds:
        own = [line for line in lines if line["kind"] == kind]
        rows.append((kind, *shares(own, 3.0), float(max(line["walked"] for line in own))))
    table(f"{robots} robots a map, {world}",
          ("map", "% within 3 s", "% not in 20 s", "median s", "95 % s", "walked m"), rows)  # fmt: skip


@BENCH.part("--minutes 0.5 --robots 1")
def calm(*, minutes: float = 10.0, robots: int = 4, world: World, processes: int = 1) -> None:
    """Print how often robots that are not disturbed report themselves lost, and the NEES of their pose.

    Args:
        minutes: simulated time of each robot, min.
        robots: number of robots.
        world: conditions.
    """
    jobs = [{"seed": world.first + 10_000 + seed} for seed in range(robots)]
    lines = study(partial(undisturbed, minutes=minutes, world=world), jobs, processes=processes)
    count, spent = sum(line["alarms"] for line in lines), sum(line["minutes"] for line in lines)
    nees, inside = (float(np.mean([line[name] for line in lines])) for name in ("nees", "inside"))
    print(f"{spent / 60.0:.1f} h undisturbed, {world}: {count} false alarms")
    print(f"NEES per degree of freedom {nees:.2f}, {inside:.1f} % within the 95 % region")


def seconds(function: Callable[[], object], times: int) -> float:
    """Return the median processor time per call, s, over `times` calls after one call that is not counted."""
    function()
    return median(seconds_of(function, time.process_time) for _ in range(times))


@BENCH.part("--minutes 0.2")
def looks(*, minutes: float = 10.0, world: World) -> None:
    """Print the processor time of a tick: of a lost robot that stands, early and late, and of a frame of a walking one.

    Args:
        minutes: time for which the lost robot stands; the other one walks by a right map for a tenth of it.
        world: conditions.
    """
    robot = Robot(world.first, world, "shuffled")
    robot.step(0.3)
    for when in ("first", "last"):
        spent = [seconds_of(lambda: robot.step(0.01), time.process_time) for _ in range(1000)]
        goal(f"tick of a lost robot, {when} 10 s, 99 %", 1e3 * float(np.quantile(spent, 0.99)), unit="ms")
        robot.step(60.0 * minutes if when == "first" else 0.0)
    right, spent = Robot(world.first, world), list[float]()
    right.step(0.3)
    right.goto(4.5, 0.2)
    for _ in range(round(600.0 * minutes)):
        before = right.frames
        each = seconds_of(lambda: right.step(0.01), time.process_time)
        spent += [each] if right.frames > before else []
    goal("tick with a frame, robot with a goal by a right map, 95 %", 1e3 * float(np.quantile(spent, 0.95)), unit="ms")
