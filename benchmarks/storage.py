"""Disks that fail while a robot walks: full, read-only, slow, torn by a crash, and a clock that goes back.

`python -m benchmarks storage [cases] --seeds 0:100`. Each case is a run in a process of its own, with a recording, the
walker's memory and a model that is written in the middle of it.
"""

import ctypes
import json
import os
import resource
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import traceback
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cache, partial
from pathlib import Path
from random import Random
from typing import Any

from benchmarks.bench import Bench, table
from surefoot import bags
from surefoot.bus.interface import Delivery
from surefoot.errors import SurefootError
from surefoot.lab.runs.local import run_local
from surefoot.lab.studies import seeds_of
from surefoot.lockstep.local import LocalSystem
from surefoot.record import chunks
from surefoot.schemas.topics import HW_TICK
from surefoot.services.footholds.models.files import encode, load, save, shipped
from surefoot.services.footholds.models.learned import LearnedModel
from surefoot.services.supervisor.scenarios.scenario import Scenario, parse_scenario
from surefoot.services.walker.memory import MemoryFile

BENCH = Bench("storage")

WALK = """
description = "Ragno walks three steps"
max_duration_s = 12.0
seed = 5
[[step]]
when = "ready"
do = "walk"
distance = 0.08
[limits]
no_fall = true
"""
KINDS = ("full", "read_only", "slow", "torn", "clock_back")
SLOW_S = 0.02
"""Wall time that each write to a slow disk takes, s; a recording makes some hundred writes."""
LIMIT_S = 300
"""Wall time after which a case is ended, s."""
LEARN_TICK = 60
"""Control tick in which the slip model is written."""


@dataclass
class Case:
    """Fault of storage drawn by a seed, and its outcome.

    Attributes:
        seed: seed of the case.
        kind: kind of the fault.
        tick: control tick in which it happens.
        amount: bytes that a full disk holds, or s by which the clock goes back; of other kinds unused.
        problems: what is wrong.
        sentences: what was logged or returned about the disk.
    """

    seed: int
    kind: str
    tick: int
    amount: float
    problems: list[str] = field(default_factory=list[str])
    sentences: list[str] = field(default_factory=list[str])


def drawn(seed: int) -> Case:
    """Return the storage fault of a seed: its kind by the seed in turn, its tick and amount at random."""
    draw, kind = Random(seed), KINDS[seed % len(KINDS)]
    amount = {"full": 10 ** draw.uniform(2.0, 5.5), "clock_back": 10 ** draw.uniform(0.0, 7.5)}.get(kind, draw.random())
    return Case(seed, kind, draw.randrange(10, 300), amount)


def at_tick(system: LocalSystem, tick: int, act: Callable[[], None]) -> None:
    """Call `act` once, when the driver of a system publishes a control tick."""
    left = [act]

    def look(delivery: Delivery) -> None:
        if left and delivery.header().tick >= tick:
            left.pop()()

    system.bus.subscribe(HW_TICK, look)


def two_models() -> tuple[LearnedModel, LearnedModel]:
    """Return the slip model in the file before a case, and the one that is written to it during the case."""
    path = shipped("ragno")
    assert path is not None
    old = load(path)
    return old, replace(old, provenance=(*old.provenance, "new"))


# -- the process of a case ---------------------------------------------------------------------------------------------


def run_case(case: Case, folder: Path, scenario: Scenario, model: LearnedModel) -> dict[str, Any]:
    """Run the scenario with the fault of a case on files in a folder; return hash and verdict."""
    learned: list[str] = []

    def learn() -> None:
        try:
            save(model, folder / "model.json")
        except SurefootError as error:
            learned.append(str(error))

    def meddle(system: LocalSystem) -> None:
        at_tick(system, LEARN_TICK, learn)
        if case.kind == "clock_back":
            at_tick(system, case.tick, lambda: set_back(case.amount))
        if case.kind == "torn":
            at_tick(system, case.tick, lambda: os.kill(os.getpid(), signal.SIGKILL))

    if case.kind == "full":
        signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
        resource.setrlimit(resource.RLIMIT_FSIZE, (int(case.amount), int(case.amount)))
    if case.kind == "read_only":
        make_read_only(folder)
    if case.kind == "slow":
        write = chunks.ChunkWriter._write  # pyright: ignore[reportPrivateUsage]
        chunks.ChunkWriter._write = lambda self, data: (time.sleep(SLOW_S), write(self, data))[1]  # pyright: ignore
    run = run_local(scenario, recording=folder / "run.mcap", meddle=meddle)
    return {"hash": run.run_hash, "ok": run.verdict.ok, "learned": learned}


def set_back(seconds: float) -> None:
    """Set the clock of this process back by `seconds` s."""
    now, now_ns = time.time, time.time_ns
    time.time = lambda: now() - seconds
    time.time_ns = lambda: now_ns() - int(seconds * 1e9)


def make_read_only(folder: Path) -> None:
    """Make a folder read-only: by its mode, for root by a mount that this process alone sees."""
    if os.geteuid() != 0:
        folder.chmod(0o555)
        return
    if ctypes.CDLL(None).unshare(0x00020000) != 0:  # CLONE_NEWNS
        raise OSError("this kernel allows no mounts of a process's own")
    place = str(folder)
    for words in (["--make-rprivate", "/"], ["--bind", place, place], ["-o", "remount,ro,bind", place]):
        subprocess.run(["mount", *words], check=True)


def forked(work: Callable[[], dict[str, Any]]) -> tuple[int, str, str]:
    """Run a function in a child process; return its exit code, output and errors."""
    pipes = [os.pipe(), os.pipe()]
    child = os.fork()
    if child == 0:
        code = 70
        try:
            os.dup2(pipes[0][1], 1)
            os.dup2(pipes[1][1], 2)
            sys.stdout, sys.stderr = os.fdopen(1, "w"), os.fdopen(2, "w")  # not those of a test
            signal.alarm(LIMIT_S)
            print(json.dumps(work()), flush=True)
            code = 0
        except BaseException:
            traceback.print_exc()
        finally:
            sys.stderr.flush()
            os._exit(code)
    texts: list[str] = []
    for begin, end in pipes:  # both are short: neither fills while the other is read
        os.close(end)
        with os.fdopen(begin) as stream:
            texts.append(stream.read())
    return os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]), texts[0], texts[1]


# -- what is left ------------------------------------------------------------------------------------------------------


def tear(path: Path, draw: Random) -> None:
    """Damage a file as a crash does: keep its beginning only, or its size with zeros at the end."""
    data = path.read_bytes()
    at = draw.randrange(len(data) + 1)
    path.write_bytes(data[:at] + (bytes(len(data) - at) if draw.random() < 0.5 else b""))


def read_recording(path: Path, *, whole: bool, sentences: list[str]) -> str:
    """Return what is wrong with a recording; empty = all of its sound part can be read."""
    if not path.exists():
        return "" if sentences else "no recording, and no sentence about it"
    try:
        found = bags.check(path)
        if whole:
            return "" if found.whole else f"not whole: {found.problems[0]}"
        if found.messages:
            bags.why(path)
        else:
            sentences.append(f"nothing can be read: {'; '.join(found.problems)}")
    except SurefootError as error:
        sentences.append(str(error))
    return ""


def judge_case(
    case: Case, folder: Path, ended: tuple[int, str, str], expected: str, models: tuple[LearnedModel, ...]
) -> None:
    """Add to a case what is wrong with the files and the output that it has left."""
    code, out, err = ended
    problems, lines = case.problems, [line for line in err.splitlines() if line]
    case.sentences += [line for line in lines if " recorder " in line or " walker " in line]
    if "Traceback" in err or "Exception ignored" in err:
        problems.append(f"a traceback: {lines[-1]}")
    if code != (-signal.SIGKILL if case.kind == "torn" else 0):
        problems.append(f"exit code {code}")
    elif code == 0:
        result = json.loads(out)
        case.sentences += result["learned"]
        if result["hash"] != expected or not result["ok"]:
            problems.append("another run")
    if case.kind == "torn":
        draw = Random(case.seed)
        for name in ("run.mcap", "walker.json"):
            if (folder / name).exists():
                tear(folder / name, draw)
        memory = MemoryFile(str(folder / "walker.json"))
        memory.recall(1, 10_000)
        case.sentences += [memory.problem] if memory.problem else []
    wrong = read_recording(folder / "run.mcap", whole=case.kind in ("slow", "clock_back"), sentences=case.sentences)
    problems += [wrong] if wrong else []
    if case.kind in ("full", "read_only") and not case.sentences:
        problems.append("no sentence about the disk")
    if encode(load(folder / "model.json")) not in (encode(each) for each in models):
        problems.append("the model is neither the old nor the new one")
    problems += [f"more than a line: {text!r}" for text in case.sentences if "\n" in text]


@cache
def reference() -> tuple[Scenario, str, tuple[LearnedModel, LearnedModel]]:
    """Return the scenario, its hash on a disk that works, and the models before and after."""
    scenario = parse_scenario(WALK, Path("walk.toml"))
    return scenario, run_local(scenario).run_hash, two_models()


def try_case(case: Case, scenario: Scenario, expected: str, models: tuple[LearnedModel, LearnedModel]) -> None:
    """Run a case of a storage fault in a folder of its own, and store in it what is wrong afterwards."""
    folder = Path(tempfile.mkdtemp(prefix="storage-"))
    try:
        here = replace(scenario, config={"walker": {"memory": str(folder / "walker.json")}})
        save(models[0], folder / "model.json")
        judge_case(case, folder, forked(partial(run_case, case, folder, here, models[1])), expected, models)
    finally:
        folder.chmod(0o755)
        shutil.rmtree(folder)


@BENCH.part("--seeds 0:5")
def cases(*, seeds: str = "0:100") -> None:
    """Runs on failing disks: the run is the same, what is sound can be read, and one sentence states what failed.

    Goal: 100 of 100.
    """
    rows, right = Counter[tuple[str, str]](), 0
    for seed in seeds_of(seeds):
        case = drawn(seed)
        try_case(case, *reference())
        right += not case.problems
        rows[case.kind, "right" if not case.problems else "; ".join(case.problems)[:90]] += 1
        rows[case.kind, "with a sentence"] += bool(case.sentences)
    found = [(*what, count) for what, count in sorted(rows.items())]
    table(f"{right} of {len(seeds_of(seeds))} right", ("fault", "result", "cases"), found)
