"""Goals of the Nao past obstacles that no map shows: people who cross the corridor, walls, a closed door."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np

from benchmarks.bench import Bench, table, words_of
from benchmarks.goals import ARMS, GOAL, INSIDE, corridor, inside_of, saved
from surefoot.bus.interface import Delivery
from surefoot.lab.runs.local import run_local
from surefoot.lab.studies import Line, seeds_of, study, verdict_line
from surefoot.lockstep.local import LocalSystem
from surefoot.schemas.navigation import NavigationFeedback
from surefoot.schemas.sim import Obstacle
from surefoot.schemas.topics import NAVIGATOR_FEEDBACK

BENCH = Bench("obstacles")

PEOPLE, PERSON, TALL = 4, 0.2, 1.2
"""`PEOPLE`: number of people in a run; `PERSON`: half of a person's width, m; `TALL`: a person's height, m."""
SIDE = 0.72
"""Largest distance of a person from the middle line of the corridor, m; the walls are at 1 m."""
OPENS_S = 60.0
"""Simulated time at which the door opens in runs in which it does, s."""


def people(seed: int) -> tuple[Obstacle, ...]:
    """Return people who cross ahead of the robot within the first 80 s, halt while it is near, and leave after 60 s."""
    rng = np.random.default_rng((seed, 1))
    found: list[Obstacle] = []
    for _ in range(PEOPLE):
        x, side, speed = rng.uniform(0.8, 4.2), rng.choice((-SIDE, SIDE)), rng.uniform(0.3, 0.8)
        begin = rng.uniform(3.0, 80.0)
        found.append(
            Obstacle(
                centre=(x, side),
                to=(x + rng.uniform(-0.3, 0.3), -side),
                half=(PERSON, PERSON),
                height=TALL,
                speed=speed,
                from_s=begin,
                until_s=begin + 60.0,
            )
        )
    return tuple(found)


def walls(seed: int) -> tuple[Obstacle, ...]:
    """Return two pieces of wall, on random sides of the corridor of 2 m, that leave 1 to 1.4 m of its width free."""
    rng = np.random.default_rng((seed, 2))
    found: list[Obstacle] = []
    for x in (rng.uniform(1.0, 2.0), rng.uniform(3.0, 4.0)):
        half, side = rng.uniform(0.3, 0.5), rng.choice((-1.0, 1.0))
        found.append(Obstacle(centre=(x, side * (1.0 - half)), half=(rng.uniform(0.05, 0.2), half), height=TALL))
    return tuple(found)


def door(seed: int) -> tuple[Obstacle, ...]:
    """Return a closed door across the corridor, which opens after 60 s where the seed is even and else never."""
    x = float(np.random.default_rng((seed, 3)).uniform(2.0, 3.5))
    return (Obstacle(centre=(x, 0.0), half=(0.05, 1.0), height=TALL, until_s=None if seed % 2 else OPENS_S),)


WORLDS: dict[str, Callable[[int], tuple[Obstacle, ...]]] = {"people": people, "walls": walls, "door": door}
"""Functions that return the obstacles of a seed, by kind of obstacle."""


def right_end(kind: str, seed: int) -> str:
    """Return the required end of a goal: `blocked` if the door stays closed (odd seeds), else `succeeded`."""
    return "blocked" if kind == "door" and seed % 2 else "succeeded"


def hindered(arm: str, kind: str, seed: int) -> Line:
    """Walk the corridor with obstacles that no map shows; return its line, with the end of the goal in words.

    Args:
        arm: name of policy and action set in `benchmarks.goals.ARMS`.
        kind: kind of obstacles, a key of `WORLDS`.
        seed: seed of everything random, the obstacles included.
    """
    ends: list[str] = []

    def listen(system: LocalSystem) -> None:
        system.bus.subscribe(NAVIGATOR_FEEDBACK, heard)

    def heard(delivery: Delivery) -> None:
        feedback = None if delivery.prime else delivery.message()
        if isinstance(feedback, NavigationFeedback) and feedback.results:
            ends[:] = [feedback.results[-1].error_code or feedback.results[-1].state]

    scenario, (policy, actions) = corridor(), ARMS[arm]
    config = {"navigator": scenario.config["navigator"] | {"policy": policy, "actions": actions}}
    world = scenario.world.model_copy(update={"obstacles": WORLDS[kind](seed)})
    found = run_local(replace(scenario, config=config, world=world), seed, without=("recorder",), meddle=listen)
    line = verdict_line(found.verdict, (*GOAL, "touches"))
    return line | {"end": ends[-1] if ends else "none"}


@BENCH.part()
def goals(
    *, seeds: str = "500:502", kinds: str = ",".join(WORLDS), arms: str = "hand,planner,planner arcs",
    results: Path | None = None, processes: int | None = None,
) -> None:  # fmt: skip
    """Nao walks 5 m to a goal past obstacles that no map shows, in the hard world; runs of a seed are pairs.

    People who cross and halt before it, two pieces of wall, a door that opens after 60 s or (odd seeds) never. Goals:
    every goal ends as it should, no obstacle is touched, no fall.

    Args:
        kinds: kinds of obstacles, comma-separated.
        arms: policies, comma-separated; the first is what the others are compared with.
    """
    chosen, names = words_of(kinds), words_of(arms)
    jobs = [{"arm": arm, "kind": kind, "seed": seed} for kind in chosen for seed in seeds_of(seeds) for arm in names]
    lines = study(hindered, jobs, results, processes=processes)
    for kind in chosen:
        own = [line for line in lines if line["kind"] == kind]
        by = {(line["arm"], line["seed"]): line for line in own}
        rows: list[tuple[object, ...]] = []
        for arm in names:
            mine = [line for line in own if line["arm"] == arm]
            wrong = [f"{line['seed']} {line['end']}" for line in mine if line["end"] != right_end(kind, line["seed"])]
            times = [line["values"]["goal_time_s"] for line in mine if line["end"] == "succeeded"]
            rows.append(
                (
                    arm, len(mine), len(mine) - len(wrong), float(np.mean(times)) if times else np.nan,
                    sum(line["values"]["touches"] for line in mine), sum(line["values"]["fell"] for line in mine),
                    float(np.mean([line["values"]["pose_nees"] for line in mine])), inside_of(mine),
                    saved(by, arm, names[0]),
                    ", ".join(wrong) or "none",
                )
            )  # fmt: skip
        header = (
            "policy",
            "runs",
            "right end",
            "time s",
            "touched",
            "fell",
            "NEES",
            INSIDE,
            f"faster than {names[0]}",
            "wrong",
        )
        table(f"{kind}, seeds {seeds}", header, rows)
