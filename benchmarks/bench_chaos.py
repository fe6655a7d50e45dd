"""Faults from 2,000 seeds on the in-memory bus: toys and short walks of three robots, each seed a run of its own.

Even seeds run in lockstep, where time waits for whoever is missing; odd ones in paced time, where it goes on. The toys
run in lockstep: of even seeds only messages are spoilt and the run must be that without faults to the bit, of odd seeds
services are killed and frozen, too, and all must be back.

    python -m benchmarks.bench_chaos --results chaos.jsonl
    python -m benchmarks.bench_chaos --results chaos.jsonl toys 0:1700 ragno 0:100

With ``--results`` every finished seed is a line of that file; seeds it holds already are not run again.
"""

import argparse
import json
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from benchmarks.bench_study import seeds_of, wilson
from surefoot.lab.chaos.run import run_chaos
from surefoot.services.supervisor.scenarios.scenario import parse_scenario
from tests.surefoot.lockstep.test_chaos import MESSAGES, TICKS, Found, reference
from tests.surefoot.lockstep.test_chaos import run as run_toys

SEEDS = ("toys", "0:1700", "ragno", "0:100", "bioloid", "0:100", "nao", "0:100")
EVENTS = 5
WALK = """
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
WALKS = {"ragno": (0.1, 300), "bioloid": (0.1, 600), "nao": (0.1, 400)}
"""Way, m, and ticks over which the events are spread."""


def toys(seed: int) -> dict[str, Any]:
    """A run of the toys."""
    kinds = {} if seed % 2 else {"kinds": MESSAGES}
    try:
        history, system = run_toys(seed, **kinds)  # type: ignore[arg-type]
    except Found as found:
        return {"bad": [str(found)], "events": 0, "ticks": 0}
    bad = [] if seed % 2 or history == reference() else ["another run than that without faults"]
    return {"bad": bad, "events": len(system.outcomes), "ticks": TICKS}


def walk(robot: str, seed: int) -> dict[str, Any]:
    """A walk of a robot."""
    distance, ticks = WALKS[robot]
    scenario = parse_scenario(WALK.format(robot=robot, distance=distance), Path(f"{robot}.toml"))
    run = run_chaos(scenario, seed, EVENTS, ticks=ticks, paced=seed % 2 == 1)
    slowest = max((o.recovered - o.began for o in run.outcomes if o.recovered is not None), default=0.0)
    return {
        "bad": list(run.violations), "events": len(run.outcomes), "ticks": run.ticks, "recovered_s": slowest,
        "unbound": run.unbound,
    }  # fmt: skip


def job_of(what: str) -> Callable[[int], dict[str, Any]]:
    """The run of one seed."""
    return toys if what == "toys" else lambda seed: walk(what, seed)


def kept(results: Path | None) -> Iterator[dict[str, Any]]:
    """The lines of a results file; a torn one is left out."""
    if results is not None and results.exists():
        for text in results.read_text(encoding="utf-8").splitlines():
            try:
                yield json.loads(text)
            except ValueError:
                continue


def run(what: str, seeds: range, results: Path | None) -> list[dict[str, Any]]:
    """Run what is missing; return all lines."""
    lines = [line for line in kept(results) if line["what"] == what and line["seed"] in seeds]
    done = {line["seed"] for line in lines}
    job = job_of(what)
    for seed in seeds:
        if seed in done:
            continue
        began = time.process_time()
        line = {"what": what, "seed": seed, **job(seed), "cpu_s": round(time.process_time() - began, 3)}
        lines.append(line)
        if line["bad"]:
            print(f"  {what} seed {seed}: {'; '.join(line['bad'])}", flush=True)
        if results is not None:
            with results.open("a", encoding="utf-8") as stream:
                stream.write(f"\n{json.dumps(line)}\n")
    return lines


def row(what: str, lines: list[dict[str, Any]]) -> str:
    """What came of the seeds of one system."""
    bad = [line["seed"] for line in lines if line["bad"]]
    high = wilson(len(bad), len(lines))[1] if lines else 1.0
    slowest = max((line.get("recovered_s", 0.0) for line in lines), default=0.0)
    events, cpu = sum(line["events"] for line in lines), sum(line["cpu_s"] for line in lines)
    return (
        f"{what:<8} {len(lines):5} seeds {events:6} events {len(bad):4} bad (below {100 * high:.1f} %, 95 %)"
        f"  {cpu / max(1, len(lines)):.2f} s of processor time a seed  slowest recovery {slowest:.1f} s  {bad[:20]}"
    )


def main(arguments: list[str] | None = None) -> None:
    """Command line; without arguments all seeds."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", nargs="*", default=SEEDS, help="pairs of toys, ragno, bioloid or nao, and first:end")
    parser.add_argument("--results", type=Path, help="file to go on with, one line a seed")
    args = parser.parse_args(arguments)
    pairs = zip(args.what[::2], args.what[1::2], strict=True)
    rows = [row(what, run(what, seeds_of(seeds), args.results)) for what, seeds in pairs]
    print("\n".join(rows))


if __name__ == "__main__":
    import sys

    main(sys.argv[1:])
