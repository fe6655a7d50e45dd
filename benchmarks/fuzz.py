"""Structure-aware fuzzing: whatever comes by wire or by file is taken, or refused in one sentence; no crash, no hang.

Messages are drawn from the JSON Schemas that are published, then damaged: fields left out, doubled, of another type, at
and beyond their limits, nested too deep, bytes flipped and cut. A finding is printed with its bytes.
"""

import json
import resource
import subprocess
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path
from random import Random

from benchmarks.bench import Bench, table
from benchmarks.fuzz_bodies import odd_bodies
from benchmarks.fuzz_files import damaged_files, formats
from benchmarks.fuzz_inputs import Drawer, Tally, attempt, drawn, spoil
from benchmarks.fuzz_models import judged
from benchmarks.machine import resident_mb
from surefoot.bus.codec import decode, encode, json_schema, read_header
from surefoot.bus.frame import Frame, FramePart, pack
from surefoot.bus.interface import Stamp
from surefoot.lab.runs.local import run_local
from surefoot.schemas.base import Bulk, BulkRequest, Wire
from surefoot.schemas.topics import QUERIES, TOPICS
from surefoot.services.supervisor.scenarios.scenario import parse_scenario
from tests.e2e.live import SERVICES, Live
from tests.processes import running

BENCH = Bench("fuzz")
HEADERS = 0.1
"""Share of the messages whose header is decoded as well, 0 to 1."""


def models() -> dict[str, type[Wire]]:
    """Return every model that travels: topics, requests and replies."""
    found = {topic.model.__name__: topic.model for topic in TOPICS}
    found |= {model.__name__: model for query in QUERIES for model in (query.request, query.reply)}
    return found


def read_again(model: type[Wire], data: bytes, attachment: bytes | None) -> None:
    """Decode and encode a message; what the decoder accepts must be finite and equal after a second decoding."""
    message = decode(model, data, attachment)
    again = decode(model, *encode(message))
    if again != message:
        raise AssertionError("another message after a second reading")


@BENCH.part("--count 3000")
def wire(*, count: int = 200_000, seed: int = 0) -> None:
    """Fuzz the decoders of every topic, request and reply, of headers, frames and batches.

    Args:
        count: number of inputs of all models together.
        seed: seed of the random inputs.
    """
    known, totals = models(), Tally()
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    began = time.process_time()
    for name, model in known.items():
        messages(totals, name, model, count // (len(known) + 1), seed)
    frames(totals, count // (len(known) + 1), seed)
    took = time.process_time() - began
    _report("wire", totals, took, memory)


def messages(tally: Tally, name: str, model: type[Wire], count: int, seed: int) -> None:
    """Decode messages of a model, whole or damaged, and now and then their headers alone."""
    random = Random(f"{seed} {name}")
    drawer, bulk = Drawer(json_schema(model), random), issubclass(model, Bulk | BulkRequest)
    for _ in range(count):
        data = drawn(drawer, random)
        parts = (random.randbytes(random.randint(0, 64)), data) if bulk else (data, None)
        attempt(tally, name, data, lambda parts=parts: read_again(model, *parts))
        if random.random() < HEADERS:
            attempt(tally, "header", data, lambda parts=parts: read_header(*parts))


def frames(tally: Tally, count: int, seed: int) -> None:
    """Decode frames and batches of every owner, whole or with a damaged index, payload or instance."""
    random = Random(f"{seed} frames")
    topics = {topic.key: topic for topic in TOPICS if "*" not in topic.key}
    drawers = {key: Drawer(json_schema(topic.model), random) for key, topic in topics.items()}
    for _ in range(count):
        keys = random.choices([*topics], k=random.randint(0, 4))
        odd = lambda: random.choice((0, 1, -1, 2**63, 10**30, random.randrange(1000)))  # noqa: E731
        parts = [FramePart(k, drawn(drawers[k], random), Stamp(odd(), odd(), odd(), odd())) for k in keys]
        payload, index = pack(parts, "abc")
        if random.random() < 0.7:
            payload, index = random.choice(((spoil(payload, random), index), (payload, spoil(index, random))))

        def read(payload: bytes = payload, index: bytes = index) -> None:
            for delivery in Frame("walker", topics, payload, index).deliveries():
                delivery.header()
                delivery.message()

        attempt(tally, "frame", index + b" | " + payload, read)


def _report(name: str, tally: Tally, took: float, memory_kb: int) -> None:
    grown = (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - memory_kb) / 1024
    header = ("inputs", "taken", "refused", "findings", "processor s", "inputs/s", "slowest ms", "memory + MB")
    row = (
        tally.inputs, tally.taken, tally.refused, len(tally.findings), took, tally.inputs / max(took, 1e-9),
        1e3 * tally.slowest_s, grown,
    )  # fmt: skip
    table(name, header, [row])
    kinds = Counter(finding.partition(" for ")[0] for finding in tally.findings)
    for kind, number in kinds.most_common(20):
        example = next(finding for finding in tally.findings if finding.startswith(kind))
        print(f"  {number} x {kind}\n      {example.partition(' for ')[2]}", flush=True)


@BENCH.part("--count 400")
def files(*, count: int = 20_000, seed: int = 0, only: str = "") -> None:
    """Fuzz the readers of every kind of file with damaged contents.

    Args:
        count: number of inputs of all kinds together.
        seed: seed of the damage.
        only: a kind of file; default: all.
    """
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    began, tallies = time.process_time(), dict[str, Tally]()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        kinds = [kind for kind in formats(folder) if only in kind.name]
        for kind in kinds:
            tallies[f"{kind.name} {kind.suffix}"] = tally = Tally()
            damaged_files(tally, kind, count // len(kinds), folder, seed)
    _report_kinds("files", tallies, time.process_time() - began, memory)


@BENCH.part("--count 100")
def bodies(*, count: int = 20_000, seed: int = 0) -> None:
    """Fuzz the parts of services that read arrays, with odd numbers in arrays of the size that their header states.

    Args:
        count: number of arrays of all kinds together.
        seed: seed of the arrays.
    """
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    began = time.process_time()
    tallies = odd_bodies(count, seed)
    _report_kinds("bodies", tallies, time.process_time() - began, memory)


def _report_kinds(name: str, tallies: dict[str, Tally], took: float, memory_kb: int) -> None:
    """Print a row for each kind of input, then their sum."""
    total, rows = Tally(), list[tuple[object, ...]]()
    for kind, t in tallies.items():
        rows.append((kind, t.inputs, t.taken, t.refused, len(t.findings), 1e3 * t.slowest_s))
        total.inputs, total.taken = total.inputs + t.inputs, total.taken + t.taken
        total.refused, total.findings = total.refused + t.refused, total.findings + t.findings
        total.slowest_s = max(total.slowest_s, t.slowest_s)
    table(f"kinds of {name}", ("kind", "inputs", "taken", "refused", "findings", "slowest ms"), rows)
    _report(name, total, took, memory_kb)


@BENCH.part("--count 40")
def decisions(*, count: int = 2000, seed: int = 0) -> None:
    """Load changed slip models and policies: each must be refused, or decide no worse than the simplest rule.

    The simplest rules are nominal landings and the hand-made controller.

    Args:
        count: files of both kinds together.
        seed: seed of the changes.
    """
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    with tempfile.TemporaryDirectory() as name:
        for what, tally, took in judged(count // 2, seed, Path(name)):
            _report(what, tally, took, memory)


WALK = """
description = "a hexapod walks while damaged messages come"
compose = "ragno"
max_duration_s = 3600.0
[world]
terrain = "flat"
[[step]]
when = "ready"
do = "walk"
distance = 0.1
[limits]
no_fall = true
"""
LAP = """
[[step]]
when = "walk_done"
do = "walk"
distance = 1.0
[[step]]
when = "walk_done"
do = "walk"
distance = -1.0
"""


@BENCH.part()
def live(*, count: int = 1_000_000, seed: int = 0, rate: float = 4000.0, laps: int = 4) -> None:
    """Send random inputs to a hexapod that walks in lockstep; its run must have the hash of a run without them.

    Args:
        count: number of inputs.
        seed: seed of the inputs.
        rate: inputs per s.
        laps: number of laps of the walk, 1 m and back; inputs sent after its end meet a run that has ended.
    """
    walk = parse_scenario(WALK + laps * LAP, Path("walk.toml"))
    with tempfile.TemporaryDirectory() as name, Live(Path(name)) as system:
        system.start(SERVICES)
        before = {service: resident_mb(process.pid) for service, process in system.processes.items()}
        words = (system.address, system.namespace, str(seed), str(count), str(rate))
        command = [sys.executable, "-m", "benchmarks.fuzz_live", *words]
        with running(command, stdout=subprocess.PIPE, text=True) as client:
            assert client.stdout is not None
            run = system.conduct(walk)
            early = client.poll() is None
            found = json.loads(client.stdout.read())
        rows: list[tuple[object, ...]] = []
        for service, process in system.processes.items():
            health, text = system.health(service), system.log(service).read_text(encoding="utf-8", errors="replace")
            bad = text.count("Traceback") + text.count("internal") + health.refused.get("internal", 0)
            grown, ended = resident_mb(process.pid) - before[service], process.poll() is not None
            refused, dropped = sum(health.refused.values()), sum(health.dropped.values())
            rows.append((service, refused, dropped, bad, ended, grown))
    table("processes", ("service", "refused", "dropped", "internal", "ended", "memory + MB"), rows)
    print(f"{sum(found['sent'].values())} inputs in {found['s']:.0f} s: {found['sent']}; answers {found['codes']}")
    same = "that" if run.run_hash == (alone := run_local(walk).run_hash) else "NOT that"
    when = "before" if early else "after"
    print(f"the walk ends {when} the inputs; its hash is {same} of a run without them")
    print(f"verdict: {'passed' if run.verdict.ok else run.verdict.problems}", flush=True)
    if run.run_hash != alone or not run.verdict.ok or any(row[3] or row[4] for row in rows):
        raise RuntimeError("the inputs changed the run, ended a process or caused an internal error")
