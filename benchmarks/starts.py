"""Starts of the whole system: services in random order, equal run hashes, and start without compiled kernels."""

import os
import random
import signal
import statistics
import subprocess
import sys
import tempfile
import time
import zipfile
from pathlib import Path

from benchmarks.bench import Bench, of_children, table, words_of
from benchmarks.machine import children, proportional_mb
from surefoot.lab.runs.local import run_local
from surefoot.record.recording import read_recording
from surefoot.services.supervisor.processes.process import busy_s
from surefoot.services.supervisor.processes.rundir import RunFolder
from surefoot.services.supervisor.scenarios.scenario import find_scenario, load_scenario
from tests.e2e.live import RUN_S, SERVICES, Live, wait_until
from tests.e2e.test_live import declared
from tests.ports import free_address

BENCH = Bench("starts")

HERE = Path(__file__).resolve().parents[1]
TICKS = 15
SCENARIO = "rough-terrain"
REGION = "from surefoot import stability as s; s.region(s.contacts([[.1, .1, 0], [.1, -.1, 0], [-.1, 0, 0]]))"
FIRST_CALLS = {
    "import numba": ("-c", "import numba"), "region": ("-c", REGION),
    "surefoot estimate": ("-m", "surefoot.lab.cli.entry", "estimate", "stand.mcap"),
}  # fmt: skip


def shuffled(number: int) -> list[str]:
    """Return the services in the order in which the start with this number starts them."""
    return random.Random(number).sample(SERVICES, len(SERVICES))


def start_once(folder: Path, number: int) -> tuple[float, int, list[str]]:
    """Return the time from first process to last tick of a short run, s, ticks sent again, and what was wrong."""
    wrong: list[str] = []
    again = 0
    with Live(folder, record=True) as live:
        began = time.monotonic()
        live.start(shuffled(number))
        live.reset(seed=number, max_ticks=TICKS)
        wait_until(lambda: live.supervisor.ended.is_set(), RUN_S, f"start {number} ends")
        seconds = time.monotonic() - began
        last = live.supervisor.ticks - 1
        for name in SERVICES:
            wait_until(lambda name=name: live.health(name).tick == last, RUN_S, f"{name} did the last tick")
            health = live.health(name)
            refused = {reason: n for reason, n in health.refused.items() if not reason.startswith("join_")}
            again += refused.pop("resent_ticks", 0)
            if refused:
                wrong.append(f"{name} refused {refused}")
    assert live.bag is not None
    first: dict[str, int] = {}
    for recorded in read_recording(live.bag):
        if recorded.model is not None:
            first.setdefault(recorded.key, recorded.message().seq)
    wrong += [f"{key} begins with seq {seq}" for key, seq in first.items() if seq != 0]
    wrong += [f"{key} was not received" for key in sorted(declared() - set(first))]
    return seconds, again, wrong


@BENCH.part()
def shuffled_starts(starts: int = 100, /) -> None:
    """Starts of the whole system over Zenoh in random order: no first message lost.

    Each start: a new router, one process per service in an order drawn by the number of the start, all links proved, a
    run of a few ticks. A service does tick 0 only with every input that is due in it, so a service that reached the
    last tick received seq 0 of every topic it declares; nothing may have been refused on the way. The recording shows
    seq 0 of every declared topic once more, from outside the services. Ticks that were sent again after 0.25 s of
    silence are counted apart: a busy machine is silent, too.

    Args:
        starts: number of starts.
    """
    subprocess.run([sys.executable, "-m", "surefoot.lab.cli.main", "warm"], check=True, stdout=subprocess.DEVNULL)
    times: list[float] = []
    faulty = repeated = 0
    for number in range(starts):
        with tempfile.TemporaryDirectory() as name:
            seconds, again, wrong = start_once(Path(name), number)
        times.append(seconds)
        faulty += bool(wrong)
        repeated += again > 0
        for text in wrong:
            print(f"  start {number} ({' '.join(shuffled(number))}): {text}")
    print(
        f"{starts} starts in random order: {starts - faulty} with seq 0 of every declared topic in every service; "
        f"first process to tick {TICKS - 1}: median {statistics.median(times):.2f} s, longest {max(times):.2f} s; "
        f"in {repeated} starts ticks were sent again"
    )


@BENCH.part()
def hashes(runs: int = 5, /) -> None:
    """Run the demo several times, its processes started in random order: all hashes must be equal for a seed.

    Args:
        runs: number of runs of the demo.
    """
    scenario = load_scenario(find_scenario(SCENARIO))
    found: list[str] = []
    for number in range(runs):
        with tempfile.TemporaryDirectory() as name, Live(Path(name)) as live:
            live.start(shuffled(1000 + number))
            found.append(live.conduct(scenario).run_hash)
    print(f"{SCENARIO}, {runs} Zenoh runs in shuffled start order: {len(set(found))} hash, {found[0][:16]}")
    same = run_local(scenario).run_hash == found[0]
    print(f"  in-memory bus: {'the same' if same else 'ANOTHER'}")
    other = run_local(scenario, scenario.seed + 1).run_hash
    print(f"  seed {scenario.seed + 1}: {'another, ' + other[:16] if other != found[0] else 'THE SAME'}")


def cold(checkout: Path, words: tuple[str, ...]) -> tuple[float, float]:
    """Return processor and wall seconds of `surefoot warm --force` and `words`, without anything compiled before."""
    with tempfile.TemporaryDirectory() as empty:
        environment = os.environ | {"NUMBA_CACHE_DIR": f"{empty}/numba", "XDG_CACHE_HOME": f"{empty}/cache"}
        command = [checkout / ".venv/bin/surefoot", "warm", "--force", *words]
        return of_children(
            lambda: subprocess.run(command, cwd=checkout, env=environment, check=True, capture_output=True)
        )


@BENCH.part()
def warm(*, against: str = "", rounds: int = 1) -> None:
    """Processor time of a cold `surefoot warm`, beside that of other checkouts, in turn, with empty caches.

    Args:
        against: folders of other checkouts, comma-separated, each set up with a .venv of its own.
        rounds: number of measurements of each checkout.
    """
    cases = [(Path(name).resolve(), ()) for name in words_of(against)] + [(HERE, ()), (HERE, ("--all",))]
    took: dict[tuple[Path, tuple[str, ...]], list[tuple[float, float]]] = {case: [] for case in cases}
    for _ in range(rounds):
        for case in cases:
            took[case].append(cold(*case))
    rows = [(f"{path} {' '.join(words)}", *(statistics.median(pair[i] for pair in pairs) for i in (0, 1)))
            for (path, words), pairs in took.items()]  # fmt: skip
    table("cold kernels", ("checkout", "processor s", "wall s"), rows)


def back(folder: RunFolder, pid: int) -> bool:
    """Return True once the estimator of a system is healthy in another process than `pid`."""
    return any(
        row["service"] == "estimator" and row["state"] == "healthy" and row["pid"] != pid for row in folder.read_rows()
    )


def up_once(checkout: Path) -> tuple[float, float, float, float]:
    """Return wall and processor seconds of `surefoot up ragno` of a checkout, MB it holds, and s of a restart."""
    with tempfile.TemporaryDirectory() as name:
        own = {"XDG_STATE_HOME": name, "SUREFOOT_LISTEN": free_address(), "PYTHONPATH": str(checkout)}

        def surefoot(*words: str) -> bytes:
            command = [sys.executable, "-m", "surefoot.lab.cli.main", *words]
            return subprocess.run(command, cwd=checkout, env=os.environ | own, check=True, capture_output=True).stdout

        folder = RunFolder("ragno", Path(name) / "surefoot")
        began = time.monotonic()
        surefoot("up", "ragno", "-d")
        wall = time.monotonic() - began
        try:
            leader = folder.supervisor()
            assert leader is not None
            pids = [leader.pid, *children(leader.pid)]
            busy, held = busy_s(pids), sum(proportional_mb(pid) for pid in pids)
            pid = folder.processes()["estimator"].pid
            os.kill(pid, signal.SIGKILL)
            killed = time.monotonic()
            while not back(folder, pid):
                time.sleep(0.02)
            return wall, busy, held, time.monotonic() - killed
        finally:
            surefoot("down", "ragno")


@BENCH.part()
def systems(*, against: str = "", rounds: int = 3) -> None:
    """Start the system of Ragno in processes, beside other checkouts, in turn: time, processor, memory, a restart.

    Processor time is that of the supervisor and its children when `surefoot up` returns. Memory is proportional: a page
    that n processes share counts 1/n in each. The restart is that of the estimator after SIGKILL, until it is healthy.

    Args:
        against: folders of other checkouts, comma-separated; they use this interpreter and its packages.
        rounds: number of starts of each checkout.
    """
    places = [*(Path(name).resolve() for name in words_of(against)), HERE]
    took: dict[Path, list[tuple[float, ...]]] = {place: [] for place in places}
    for _ in range(rounds):
        for place in places:
            took[place].append(up_once(place))
    table(
        "up ragno",
        ("checkout", "wall s", "processor s", "MB", "restart s"),
        [(place, *(statistics.median(column) for column in zip(*found, strict=True))) for place, found in took.items()],
    )


def installed(folder: Path) -> Path:
    """Build a wheel with the kernels of Ragno, unpack it and compile its bytecode as pip does; return the place."""
    build = [sys.executable, str(HERE / "scripts" / "build_wheel.py"), str(folder), "--systems", "ragno"]
    subprocess.run(build, check=True, capture_output=True)
    (wheel,) = folder.glob("*.whl")
    with zipfile.ZipFile(wheel) as packed:
        packed.extractall(folder / "site")
    subprocess.run([sys.executable, "-m", "compileall", "-q", str(folder / "site")], check=True)
    return folder / "site"


@BENCH.part()
def first_calls(runs: int = 5, /) -> None:
    """Print the processor time of first calls from an installed wheel with compiled kernels, caches empty each time.

    Args:
        runs: number of runs of each call.
    """
    with tempfile.TemporaryDirectory() as name:
        folder, took = Path(name), dict[str, list[float]]()
        site = installed(folder)
        run_local(load_scenario(find_scenario("stand")), recording=folder / "stand.mcap")
        for number in range(runs):
            environment = os.environ | {"PYTHONPATH": str(site), "XDG_CACHE_HOME": str(folder / f"cache{number}")}
            for what, words in FIRST_CALLS.items():
                took.setdefault(what, []).append(
                    of_children(lambda w=words, e=environment: subprocess.run(
                        [sys.executable, *w], cwd=folder, env=e, check=False, capture_output=True
                    ))[0]
                )  # fmt: skip
    table("first calls", ("call", "processor s, median", "least"),
          [(what, statistics.median(seconds), min(seconds)) for what, seconds in took.items()])  # fmt: skip


@BENCH.part()
def report(runs: int = 3, /) -> None:
    """Print size and processor time of the report of the demo, with its replay, from a recording.

    Args:
        runs: number of reports.
    """
    with tempfile.TemporaryDirectory() as name:
        recording, page = Path(name) / "run.mcap", Path(name) / "report.html"
        run_local(load_scenario(find_scenario(SCENARIO)), recording=recording)
        words = [sys.executable, "-m", "surefoot.lab.cli.entry", "report", str(recording), "--out", str(page)]
        took = [of_children(lambda: subprocess.run(words, check=True, capture_output=True))[0] for _ in range(runs)]
        table("report of the demo", ("MB", "processor s, median", "least"),
              [(1e-6 * page.stat().st_size, statistics.median(took), min(took))])  # fmt: skip
