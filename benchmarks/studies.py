"""Scenarios over many seeds, the real services of a seed in one process on the in-memory bus.

Every part takes ``--results FILE``: each finished run is a line of that file, and runs that it holds are not repeated.
Results belong to one state of the code: begin a new file after a change.
"""

import tempfile
import time
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np

from benchmarks.bench import Bench, table
from surefoot.lab.chaos.marks import MARKS, Marks
from surefoot.lab.chaos.run import run_chaos
from surefoot.lab.runs.local import run_local
from surefoot.lab.statistics import wilson
from surefoot.lab.studies import Line, metrics, passed, run_scenario, seeds_of, study
from surefoot.record.recording import read_recording
from surefoot.schemas.topics import HW_LANDMARKS, HW_RANGE, STATE_GAIT
from surefoot.services.supervisor.scenarios.scenario import Scenario, find_scenario, load_scenario, parse_scenario
from tests.surefoot.lockstep import toy_chaos as toys

BENCH = Bench("studies")

SCENARIOS = ("rough-terrain", "flat", "rough-terrain-high")
HIGH_M = 0.087
"""Height of the highest hill of `rough-terrain-high`, m."""
SHOWN = (
    "distance_m", "max_tilt_deg", "mean_slip_mm", "velocity_rmse_mps", "odometry_error_percent", "min_margin_m",
    "min_margin_measured_m", "duration_s",
)  # fmt: skip
"""Names of the metrics of a walk that the table shows."""


def named(name: str) -> Scenario:
    """Return a scenario by name or path; `rough-terrain-high` is the demo's with higher hills."""
    if name != "rough-terrain-high":
        return load_scenario(find_scenario(name))
    text = find_scenario("rough-terrain").read_text().replace("[world]", f"[world]\namplitude = {HIGH_M}")
    return parse_scenario(text, Path("rough-terrain-high.toml"))


def walked(scenario: str, seed: int) -> Line:
    """Run a scenario on one seed; return its line of results."""
    return run_scenario(named(scenario), seed)


def failures(line: Line) -> None:
    """Print what failed in a run."""
    if line["failed"] or line["problems"]:
        what = " ".join(str(line[key]) for key in ("scenario", "arm", "journey") if key in line)
        print(f"  {what} seed {line['seed']}: failed {line['failed']} {line['problems']}", flush=True)


@BENCH.part("flat 0:1")
def scenarios(
    scenario: str = "", seeds: str = "100", /, *, results: Path | None = None, processes: int | None = None
) -> None:
    """Run walking scenarios over many seeds: print the share of passed runs, median and extremes of each metric.

    Goals: rough-terrain 95 of 100 reach the end without a fall; flat 100 of 100 with contact sliding of at most 0.5 mm
    per stance in the mean (gate 0.5 N). Hills of 8.7 cm are reported without a goal.

    Args:
        scenario: name or path; default: rough-terrain, flat and rough-terrain-high.
    """
    for name in (scenario,) if scenario else SCENARIOS:
        jobs = [{"scenario": name, "seed": seed} for seed in seeds_of(seeds)]
        lines = study(walked, jobs, results, processes=processes, show=failures)
        rate = passed(lines)
        table(
            f"{name}: {rate.good} of {rate.runs} passed (95 %: {100 * rate.low:.0f} to {100 * rate.high:.0f} %)",
            ("metric", "median", "least", "seed", "most", "seed"),
            metrics(lines, SHOWN),
        )


CHAOS = {"toys": "0:1700", "ragno": "0:100", "bioloid": "0:100", "nao": "0:100"}
"""Default range of seeds, first:end, of each system under faults."""
EVENTS = 5
MARKED = 1000
"""Number of consecutive seeds over which recoveries not seen before are counted."""
WAYS = {"ragno": (0.1, 300), "bioloid": (0.1, 600), "nao": (0.1, 400)}
"""Distance walked, m, and number of ticks over which the fault events are spread, by robot."""
SHORT_WALK = """
description = "a short walk while things go wrong"
compose = "{robot}"
max_duration_s = 40.0
[world]
terrain = "flat"
map_profile = "exact"
[[step]]
when = "ready"
do = "walk"
distance = {distance}
[limits]
no_fall = true
"""


def spoilt(what: str, seed: int) -> Line:
    """Run toy services, or a short walk of a robot, under the faults of a seed; return the violations and counts."""
    began = time.process_time()
    if what == "toys":
        line = _toys(seed)
    else:
        distance, ticks = WAYS[what]
        scenario = parse_scenario(SHORT_WALK.format(robot=what, distance=distance), Path(f"{what}.toml"))
        with Marks() as marks:
            run = run_chaos(scenario, seed, EVENTS, ticks=ticks, paced=seed % 2 == 1)
        slowest = max((o.recovered - o.began for o in run.outcomes if o.recovered is not None), default=0.0)
        line = {"bad": list(run.violations), "events": len(run.outcomes), "ticks": run.ticks, "recovered_s": slowest,
                "unbound": run.unbound, "marks": sorted(marks.taken)}  # fmt: skip
    return line | {"cpu_s": round(time.process_time() - began, 3)}


def _toys(seed: int) -> Line:
    events = toys.drawn(seed)
    with Marks() as marks:
        bad = toys.failure(events, seed, toys.reference())
    return {"bad": [bad] if bad else [], "events": len(events), "ticks": toys.TICKS, "marks": sorted(marks.taken)}


def _bad(line: Line) -> None:
    if line["bad"]:
        print(f"  {line['what']} seed {line['seed']}: {'; '.join(line['bad'])}", flush=True)


@BENCH.part("toys 0:4")
def chaos(*what: str, results: Path | None = None, processes: int = 1) -> None:
    """Inject faults from 2,000 seeds into toy services and into short walks of three robots; print the violations.

    Even seeds run in lockstep, where time waits for whoever is missing; odd ones in paced time, where it continues. The
    toys run in lockstep: with even seeds only messages are spoilt and the run must be that without faults to the bit,
    with odd seeds services are killed and frozen, too, and all must recover.

    Args:
        what: pairs of toys, ragno, bioloid or nao, and first:end; default: 1700 seeds of toys and 100 of each robot.
    """
    rows: list[tuple[object, ...]] = []
    taken: list[tuple[object, ...]] = []
    for name, seeds in zip(what[::2], what[1::2], strict=True) if what else CHAOS.items():
        jobs = [{"what": name, "seed": seed} for seed in seeds_of(seeds)]
        lines = study(spoilt, jobs, results, processes=processes, show=_bad)
        bad = [line["seed"] for line in lines if line["bad"]]
        taken.append(_marked(name, lines))
        rows.append(
            (
                name, len(lines), sum(line["events"] for line in lines), len(bad),
                f"{100 * wilson(len(bad), len(lines))[1]:.1f} %",
                sum(line["cpu_s"] for line in lines) / max(1, len(lines)),
                max((line.get("recovered_s", 0.0) for line in lines), default=0.0), ", ".join(map(str, bad[:20])),
            )
        )  # fmt: skip
    header = ("system", "seeds", "events", "bad", "below (95 %)", "processor s a seed", "slowest recovery s", "which")
    table("faults", header, rows)
    marks = ("system", "seeds", "recoveries taken", f"new in each {MARKED}", "never")
    table(f"recoveries taken, of {len(MARKS)}", marks, taken)


def _marked(name: str, lines: list[Line]) -> tuple[object, ...]:
    """Return a row of the table of recoveries: number of kinds taken, new kinds per thousand seeds, kinds never taken.

    `name`: of the system, first in the row; `lines`: results of its seeds, one each.
    """
    seen, new = set[str](), list[int]()
    for first in range(0, len(lines), MARKED):
        before = len(seen)
        seen.update(*(line["marks"] for line in lines[first : first + MARKED]))
        new.append(len(seen) - before)
    never = ", ".join(mark for mark in MARKS if mark not in seen)
    return name, len(lines), len(seen), " ".join(map(str, new)), never


@BENCH.part("--seeds 0:2")
def planted(*, seeds: str = "0:300") -> None:
    """Plant faults into the protocol: print the first seed of the toy services that finds each, and its events.

    Goals: all 20 found; median of at most five events; the shrunk failure replayed to the bit.
    """
    expected, lengths = toys.reference(), list[int]()
    rows: list[tuple[object, ...]] = []
    for name, (owner, attribute, value) in toys.PLANTED.items():
        original = getattr(owner, attribute)
        setattr(owner, attribute, value)
        try:
            found = toys.shrunk(expected, seeds_of(seeds))
            again = found and toys.failure(found[1].events, found[0], expected) == found[1].failure
        finally:
            setattr(owner, attribute, original)
        if found is None:
            rows.append((name, "-", "-", "-", "-", "not found"))
            continue
        lengths.append(len(found[1].events))
        rows.append((name, found[0], toys.EVENTS, lengths[-1], again, found[1].failure[:70]))
    header = ("planted", "seed", "events", "shrunk", "replayed", "failure")
    table(f"{len(lengths)} of {len(rows)} found, median of {median(lengths or [0]):g} events", header, rows)


LANDMARKS = """
description = "Nao stands, then walks on a floor with landmarks and a goal, towards a wall"
compose = "nao"
max_duration_s = 40.0
[world]
terrain = "room"
map_profile = "exact"
perturbation = 1.0
goal = [0.9, 0.0]
[[step]]
when = "ready"
do = "stand"
duration = 3.0
[[step]]
when = "ready"
after_s = 3.0
do = "walk"
distance = {distance}
"""


def watched(seed: int, distance: float) -> Line:
    """Run a Nao that stands for 3 s and walks some metres; return what its camera and ultrasound recognise.

    Returns:
        Landmarks of each frame by the gait's state, frames with the goal marker, distances of the ultrasound in m.
    """
    frames: dict[str, list[int]] = {}
    goals, echoes, state = 0, list[float | None](), ""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "run.mcap"
        run_local(parse_scenario(LANDMARKS.format(distance=distance)), seed, recording=path)
        for item in read_recording(path, (HW_LANDMARKS.key, HW_RANGE.key, STATE_GAIT.key)):
            message: Any = item.message()
            match item.key:
                case STATE_GAIT.key:
                    state = message.state
                case HW_RANGE.key:
                    echoes.append(message.distance)
                case _:
                    frames.setdefault(state, []).append(len(message.landmarks))
                    goals += message.goal is not None
    return {"frames": frames, "goals": goals, "echoes": echoes}


@BENCH.part()
def landmarks(
    *, seeds: str = "0:5", distance: float = 0.7, results: Path | None = None, processes: int | None = None
) -> None:
    """Landmarks that a Nao recognises in one image, standing and walking, read from a recording without truth.

    Osswald et al. matched 3.25 features a frame on a slowly walking Nao and far more on a standing one.

    Args:
        distance: length of the walk, m.
    """
    jobs = [{"seed": seed, "distance": distance} for seed in seeds_of(seeds)]
    lines = study(watched, jobs, results, processes=processes)
    rows: list[tuple[object, ...]] = []
    for name in ("standing", "walking"):
        means = [float(np.mean(line["frames"][name])) for line in lines]
        count = sum(len(line["frames"][name]) for line in lines)
        rows.append((name, count, float(np.mean(means)), min(means), max(means)))
    table(f"landmarks a frame, seeds {seeds}", ("gait", "frames", "mean of seeds", "least", "most"), rows)
    seen = [[echo for echo in line["echoes"] if echo is not None] for line in lines]
    rows = [(line["seed"], line["goals"], far[0], far[-1]) for line, far in zip(lines, seen, strict=True)]
    table("goal and wall", ("seed", "frames with the goal", "wall at first m", "at last m"), rows)
