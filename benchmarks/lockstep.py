"""Wall time of the demo walk with services as processes over Zenoh, compared with all services in one process."""

import json
import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from benchmarks.bench import Bench, goal, table
from surefoot.bus.codec import decode, encode
from surefoot.lab.runs.local import run_local
from surefoot.lockstep.launch import spare_collector
from surefoot.lockstep.node import Node
from surefoot.record.recording import read_recording
from surefoot.services.simulator.world import PhysicsWorld
from surefoot.services.supervisor.scenarios.scenario import find_scenario, load_scenario
from tests.ports import free_address

BENCH = Bench("lockstep")

SCENARIO = "rough-terrain"


def zenoh_run(folder: Path, *flags: str, listen: str = "", shared: bool = False) -> dict[str, Any]:
    """Return the result of `surefoot run` of the demo over Zenoh, as on the command line."""
    command = [sys.executable, "-m", "surefoot.lab.cli.main", "run", SCENARIO, "--seed", "0", "--json", *flags]
    environment = dict(os.environ, SUREFOOT_LISTEN=listen or free_address(), XDG_STATE_HOME=str(folder / "state"))
    environment["SUREFOOT_SHARED_MEMORY"] = str(int(shared))
    done = subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, check=False)
    if not done.stdout.strip().startswith("{"):
        raise RuntimeError(f"{' '.join(command)} printed no JSON: {done.stderr[-2000:]}")
    return json.loads(done.stdout)


def local_run(strict: bool) -> dict[str, Any]:
    """Return the result of a run of all services in one process, which is started for it."""
    code = (
        "import json; from surefoot.services.supervisor.scenarios.scenario import *;"
        "from surefoot.lab.runs.local import run_local;"
        "from surefoot.lockstep.launch import spare_collector; spare_collector();"
        f"r = run_local(load_scenario(find_scenario({SCENARIO!r})), 0, strict={strict});"
        "print(json.dumps({'values': {'real_time_factor': r.rtf}, 'message_hash': r.run_hash, 'recording': ''}))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    return json.loads(done.stdout.splitlines()[-1])


VARIANTS: tuple[tuple[str, Callable[[Path], dict[str, Any]]], ...] = (
    ("one process delay", lambda folder: local_run(strict=False)),
    ("zenoh delay", lambda folder: zenoh_run(folder)),
    ("zenoh delay, no recording", lambda folder: zenoh_run(folder, "--no-record")),
    ("zenoh delay, shared memory", lambda folder: zenoh_run(folder, shared=True)),
    ("zenoh strict, shared memory", lambda folder: zenoh_run(folder, "--strict", shared=True)),
    ("zenoh strict", lambda folder: zenoh_run(folder, "--strict")),
    ("one process strict", lambda folder: local_run(strict=True)),
)
"""Variants of a run by name, executed in this order in even rounds and in reverse in odd ones; neighbours are
compared."""


@BENCH.part()
def rounds(rounds: int = 5, /) -> None:
    """Compare the rough-terrain demo over Zenoh with the same services in one process, and print the parts of a tick.

    All services of compose/ragno.yaml as processes on tcp loopback, seed 0, the machine otherwise idle. Each round runs
    every variant once; ratios compare neighbours of a round, for a machine's speed changes with its neighbours. Goals
    for the real-time factor over that of the same services in one process: >= 0.65 with the default one-tick actuation
    delay, >= 0.45 strict; with shared memory >= 0.85 and >= 0.70. Goal over that without recording: >= 0.90.

    Args:
        rounds: number of runs of each variant.
    """
    rtf: dict[str, list[float]] = {name: [] for name, _ in VARIANTS}
    hashes: dict[str, set[str]] = {"delay": set(), "strict": set()}
    with tempfile.TemporaryDirectory() as name:
        folder, recording = Path(name), ""
        for i in range(rounds):
            for variant, run in VARIANTS[:: 1 if i % 2 == 0 else -1]:
                result = run(folder)
                rtf[variant].append(result["values"]["real_time_factor"])
                hashes["strict" if "strict" in variant else "delay"].add(result["message_hash"])
                recording = str(folder / result["recording"]) if result["recording"] else recording
        median = {key: statistics.median(values) for key, values in rtf.items()}
        rows = [(key, median[key], ", ".join(f"{v:.2f}" for v in values)) for key, values in rtf.items()]
        table(f"real-time factor, {SCENARIO}, seed 0, {rounds} rounds", ("variant", "median", "all"), rows)
        for ours, base, least in (
            ("zenoh delay", "one process delay", 0.65), ("zenoh strict", "one process strict", 0.45),
            ("zenoh delay", "zenoh delay, no recording", 0.90),
            ("zenoh delay, shared memory", "one process delay", 0.85),
            ("zenoh strict, shared memory", "one process strict", 0.70),
        ):  # fmt: skip
            ratios = [a / b for a, b in zip(rtf[ours], rtf[base], strict=True)]
            goal(f"{ours} / {base}, median of neighbours", statistics.median(ratios), ">=", least)
        for variant, found in hashes.items():
            print(f"hash {variant}: {'identical in all runs, zenoh and one process' if len(found) == 1 else found}")
        breakdown(Path(recording), 1e6 * 0.01 / median["zenoh delay"], 1e6 * 0.01 / median["zenoh strict"])


@contextmanager
def timed(owner: Any, method: str, book: Callable[[Any, float], None]) -> Iterator[None]:
    """Call `book` with the processor time, s, of every call of a method of `owner` inside the context."""
    original = getattr(owner, method)

    def wrapper(self: Any, *args: Any) -> Any:
        began = time.thread_time()
        result = original(self, *args)
        book(self, time.thread_time() - began)
        return result

    setattr(owner, method, wrapper)
    try:
        yield
    finally:
        setattr(owner, method, original)


def breakdown(recording: Path, delay_us: float, strict_us: float) -> None:
    """Print CPU times of a tick: each service, physics and the codec; transport is the rest."""
    spare_collector()  # as every service does
    spent: dict[str, float] = {}

    def book_node(node: Any, seconds: float) -> None:
        spent[node.name] = spent.get(node.name, 0.0) + seconds

    def book_physics(world: Any, seconds: float) -> None:
        spent["physics"] = spent.get("physics", 0.0) + seconds

    with timed(Node, "pump_once", book_node), timed(PhysicsWorld, "step_tick", book_physics):
        run = run_local(load_scenario(find_scenario(SCENARIO)), 0)
    per = {name: 1e6 * seconds / run.ticks for name, seconds in spent.items()}
    per["simulator"] -= per["physics"]
    coded = codec_us(recording) / run.ticks
    path = per["physics"] + per["simulator"] + per["estimator"] + per["walker"]
    rows = sorted(per.items(), key=lambda item: -item[1])
    rows += [("codec (each message, once)", coded), ("wall, zenoh delay", delay_us), ("wall, zenoh strict", strict_us)]
    rows += [("strict path without transport", path), ("transport and wake-ups", strict_us - path)]
    table("a tick, CPU us (services by the in-memory run; a call counts with its caller)", ("part", "us"), rows)


def codec_us(recording: Path) -> float:
    """Return the time to encode and decode every message of a recording once, us."""
    total = 0.0
    for item in read_recording(recording):
        if item.model is None:
            continue
        raw = item.raw()
        began = time.perf_counter()
        encode(decode(item.model, *raw))
        total += time.perf_counter() - began
    return 1e6 * total
