"""A system under load: busy processes, emergency stops, faults, restarts, floods, readers that never read.

Ratios are of measurements made directly one after the other, because the machine may be busy with other work.
"""

import json
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from random import Random
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.bench import Bench, of_children, table
from benchmarks.machine import ENTRY, SPIN, Machine, descriptors, resident_mb, up
from surefoot.lab.statistics import middle_and_ends
from surefoot.services.supervisor.processes.reconcile import STABLE_S
from surefoot.services.supervisor.service import Supervisor
from tests.e2e.live import SERVICES, Live, environment, wait_until
from tests.processes import GRACE_S, running, running_child

BENCH = Bench("soak")

BARE = """
import json, queue, sys, zenoh
came = queue.SimpleQueue()
config = zenoh.Config.from_json5(json.dumps({"mode": "client", "connect": {"endpoints": [sys.argv[1]]}}))
with zenoh.open(config) as session:
    reader = session.declare_subscriber(sys.argv[2] + "/sim/status", lambda s: came.put(s.payload.to_bytes()))
    while True:
        session.put(sys.argv[2] + "/cmd/estop", b'{"reason": "bare"}')
        try:
            if json.loads(came.get(timeout=0.1))["stopped"]:
                break
        except queue.Empty:
            continue
"""
"""Python program that stops a robot and waits for `sim/status`, with the bare Zenoh library."""


@contextmanager
def busy(count: int, nice: int = 0) -> Iterator[None]:
    """Keep `count` processes computing inside the context, with a nice value.

    Each has a session of its own, as each service has: Linux shares a processor among sessions first.
    """
    with ExitStack() as stack:
        for _ in range(count):
            spin = running([sys.executable, "-c", SPIN], start_new_session=True)
            _set_nice(stack.enter_context(spin).pid, nice)
        yield


def _set_nice(pid: int, nice: int) -> None:
    for thread in Path(f"/proc/{pid}/task").iterdir():
        os.setpriority(os.PRIO_PROCESS, int(thread.name), nice)


@contextmanager
def system(*words: str) -> Iterator[Machine]:
    """Start the hexapod's system in a temporary folder, yield a handle of it, and take it down at the end."""
    with tempfile.TemporaryDirectory() as folder, up(Path(folder), *words) as machine:
        yield machine


@BENCH.part("--seconds 3 --rtf 0")
def restarts(*, rtf: str = "1,0", seconds: float = 1800.0, nice: int = 0, processes: int = 24) -> None:
    """Print restarts and speed of `surefoot up ragno` while other processes compute.

    Args:
        rtf: real-time factors, comma-separated; 0 = as fast as it goes.
        seconds: wall time at each factor, s.
        nice: value of everything, system and busy processes, once the system is up: harder for both, kinder to others.
        processes: number of processes that compute.
    """
    rows: list[tuple[object, ...]] = []
    for pace in rtf.split(","):
        with system("--rtf", pace) as machine:
            for pid in machine.pids().values():
                _set_nice(pid, nice)
            paces: list[float] = []
            worst, found = 0, machine.status()
            with busy(processes, nice):
                began = time.monotonic()
                while time.monotonic() < began + seconds:
                    time.sleep(min(10.0, seconds / 10))
                    found = machine.status()
                    paces.append(found.get("time", {}).get("rtf", 0.0))
                    worst = max(worst, sum(row["restarts"] for row in found["services"]))
                spent, load = time.monotonic() - began, os.getloadavg()[0]
            words = found.get("time", {}).get("words")
            rows.append((f"rtf {pace}", worst, f"{spent:.0f} s", f"{load:.0f}", middle_and_ends(paces), words))
    header = ("run", "restarts", "in", "load", "pace", "status")
    table(f"{processes} busy processes, nice {nice}", header, rows)


def _timed(machine: Machine, commands: Sequence[str]) -> tuple[float, float, bool]:
    """Run a command; return its wall time, s, its processor time, s, and whether it succeeded."""
    codes: list[int] = []

    def run() -> None:
        done = subprocess.run(commands, env=machine.environment, capture_output=True, check=False)
        codes.append(done.returncode)

    spent, wall = of_children(run)
    return wall, spent, codes == [0]


@BENCH.part("--count 1")
def stops(*, count: int = 100) -> None:
    """Emergency stops without and beside four busy processes, in turns with a bare Zenoh client.

    Each is timed from the start of the process to its end; the client stops the robot and waits for `sim/status`.

    Args:
        count: stops of each kind.
    """
    with system() as machine:
        bare = [sys.executable, "-c", BARE, machine.address, machine.namespace]
        for processes in (0, 4):
            rows: dict[str, list[tuple[float, float, bool]]] = {"surefoot stop": [], "bare client": []}
            with busy(processes):
                for _ in range(count):
                    rows["surefoot stop"].append(_timed(machine, [*ENTRY, "stop"]))
                    rows["bare client"].append(_timed(machine, bare))
            ratios = [a[0] / b[0] for a, b in zip(*rows.values(), strict=True)]
            shown = [
                (name, f"{sum(row[2] for row in found)} of {count}", middle_and_ends([row[0] for row in found]),
                 middle_and_ends([row[1] for row in found])) for name, found in rows.items()
            ]  # fmt: skip
            load = os.getloadavg()[0]
            what = f"{processes} busy processes, load {load:.0f}: wall of neighbours {middle_and_ends(ratios)}"
            table(what, ("command", "confirmed", "wall s", "processor s"), shown)


@BENCH.part("--count 1")
def commands(*, count: int = 7) -> None:
    """Print the processor time of the help text and of commands that only observe a system, as `surefoot status`.

    Args:
        count: runs of each.
    """
    rows: list[tuple[object, ...]] = []
    with system() as machine:
        echo = ("topic", "echo", "state/velocity", "-n", "1")
        for words in (("--help",), ("call", "recorder/status"), echo, ("status",)):
            found = [_timed(machine, [*ENTRY, *words]) for _ in range(count)]
            good = f"{sum(row[2] for row in found)} of {count}"
            rows.append((f"surefoot {' '.join(words)}", good, middle_and_ends([row[1] for row in found])))
    table("commands", ("command", "succeeded", "processor s"), rows)


def _restarts_of(machine: Machine) -> int:
    return sum(row["restarts"] for row in machine.status()["services"])


@BENCH.part()
def faults(*, count: int = 5) -> None:
    """Times until a crash and a freeze are noticed, and restarts after a pause of 1 s.

    A crash is noticed by the network (its liveliness token is gone) and by the supervisor (the process is reaped).

    Args:
        count: faults of each kind.
    """
    with system() as machine, machine.session() as session:
        gone: dict[str, float] = {}

        def on_life(sample: Any) -> None:
            gone[str(sample.key_expr).split("/")[-2]] = time.monotonic()

        watching = session.liveliness().declare_subscriber(f"{machine.namespace}/alive/*/*", on_life)
        found: dict[str, list[float]] = {"crash": [], "crash, by the supervisor": [], "freeze": []}
        for number in range(2 * count):
            # two services, as the supervisor gives one up that ends eight times in a row
            what, sent, name = (("crash", signal.SIGKILL, "footholds"), ("freeze", signal.SIGSTOP, "stability"))[
                number % 2
            ]
            pid = machine.pids()[name]
            gone.pop(name, None)
            began = time.monotonic()
            os.kill(pid, sent)
            reaped = 0.0
            while (name not in gone or (not reaped and what == "crash")) and time.monotonic() - began < 30.0:
                reaped = reaped or (0.0 if Path(f"/proc/{pid}").exists() else time.monotonic())
                time.sleep(0.0005)
            if what == "crash":
                found["crash, by the supervisor"].append((reaped or began + 30.0) - began)
            found[what].append(gone.get(name, began + 30.0) - began)
            if sent == signal.SIGSTOP:
                os.kill(pid, signal.SIGCONT)
            machine.wait_until_healthy()
        rows = [(what, middle_and_ends([1e3 * s for s in times], 0)) for what, times in found.items()]
        table("noticed after", ("fault", "ms"), rows)
        before = _restarts_of(machine)
        pids = {name: pid for name, pid in machine.pids().items() if name != "supervisor"}
        for pid in pids.values():
            os.kill(pid, signal.SIGSTOP)
            time.sleep(1.0)
            os.kill(pid, signal.SIGCONT)
            time.sleep(1.0)
        machine.wait_until_healthy()
        print(f"pause of 1 s of each of {len(pids)}: {_restarts_of(machine) - before} restarts", flush=True)
        del watching


@BENCH.part()
def peers(*, count: int = 100, seconds: float = 1800.0) -> None:
    """Print the growth of processes in memory and descriptors while other processes are killed and restarted.

    Half of the services are killed in turn, then the other half; memory and descriptors are of those that live on.

    Args:
        count: restarts of each service.
        seconds: no round begins so long after the first.
    """
    with system() as machine:
        names = [name for name in machine.pids() if name != "supervisor"]
        for half in (names[::2], names[1::2]):
            # the first restart of all is not counted; then when each has been healthy again
            well = {name: machine.restart(name) for name in half}
            pids = {name: pid for name, pid in machine.pids().items() if name not in half}
            before = {name: (resident_mb(pid), descriptors(pid)) for name, pid in pids.items()}
            began, rounds = time.monotonic(), 0
            while rounds < count and time.monotonic() - began < seconds:
                rounds += 1
                for name in half:
                    time.sleep(max(0.0, well[name] + STABLE_S + 1.0 - time.monotonic()))  # else it is given up
                    well[name] = machine.restart(name)
            if {name: machine.pids().get(name) for name in pids} != pids:
                raise RuntimeError(f"others than {half} were restarted: {machine.status()['services']}")
            rows = [(name, resident_mb(pid) - before[name][0], descriptors(pid) - before[name][1])
                    for name, pid in pids.items()]  # fmt: skip
            what = f"{rounds} restarts of each of {', '.join(half)} in {time.monotonic() - began:.0f} s"
            table(what, ("process", "growth MB", "descriptors"), rows)


@BENCH.part("--seconds 40 --every 5 --settle 10")
def hours(
    *, seconds: float = 7200.0, every: float = 30.0, settle: float = 600.0, rtf: float = 1.0, kill: str = "estimator"
) -> None:
    """Slopes of memory and descriptors of a walking hexapod while services are killed in turn.

    Each slope is a least-squares line over the samples after the time to settle, with twice the standard error that
    the residuals of ten blocks give: neighbours of a sample are not independent.

    Args:
        seconds: in all.
        every: time between two kills, s.
        settle: time before the first sample that counts, s.
        rtf: real-time factor; 0 = as fast as it goes.
        kill: services, comma-separated; the other processes live on and are measured.
    """
    names = kill.split(",")
    with system("--rtf", str(rtf)) as machine:
        well = {name: time.monotonic() for name in names}
        pids = {name: pid for name, pid in machine.pids().items() if name not in names}
        samples: list[tuple[float, dict[str, tuple[float, int]]]] = []
        began, rounds, refused = time.monotonic(), 0, 0
        while time.monotonic() < began + seconds:
            order = {"action": "walk", "distance": 0.3} if rounds % 2 else {"action": "turn", "angle": 0.5}
            refused += machine.surefoot("call", "cmd/walk", json.dumps(order)).returncode != 0
            name = names[rounds % len(names)]
            time.sleep(max(every, well[name] + STABLE_S + 1.0 - time.monotonic()))  # else it is given up
            well[name] = machine.restart(name)
            rounds += 1
            if {who: machine.pids().get(who) for who in pids} != pids:
                break
            found = {who: (resident_mb(pid), descriptors(pid)) for who, pid in pids.items()}
            samples.append((time.monotonic() - began, found))
        spent, report = time.monotonic() - began, machine.status()
        others = {who for who, pid in pids.items() if machine.pids().get(who) != pid}
        for who in others:
            print(machine.surefoot("logs", who).stdout[-4000:], machine.surefoot("logs", "supervisor").stdout[-4000:])
    late = [item for item in samples if item[0] >= settle] or samples
    times = np.array([when for when, _ in late]) / 3600.0
    rows: list[tuple[object, ...]] = []
    for who in pids:
        memory, held = np.array([found[who] for _, found in late], dtype=float).T
        slope, margin = _slope(times, memory)
        count, spread = _slope(times, held)
        rows.append((who, memory[0], f"{slope:+.2f} +- {margin:.2f}", held[0], f"{count:+.2f} +- {spread:.2f}"))
    what = f"rtf {rtf:g}, {spent:.0f} s, {rounds} kills of {kill}, {refused} orders refused, {report.get('time')}"
    table(what, ("process", "MB at first", "MB/h", "descriptors", "descriptors/h"), rows)
    if others:
        raise RuntimeError(f"others than {kill} were restarted: {sorted(others)}: {report['services']}")


def _slope(x: NDArray[np.float64], y: NDArray[np.float64], blocks: int = 10) -> tuple[float, float]:
    """Return the least-squares slope of y over x, (n,) each, and twice its standard error by blocks of residuals."""
    centred = x - x.mean()
    slope = float(np.sum(centred * y) / np.sum(centred * centred))
    parts = np.array_split(centred * (y - y.mean() - slope * centred), blocks)
    wrong = float(np.sqrt(sum(float(part.sum()) ** 2 for part in parts)))
    return slope, 2.0 * wrong / float(np.sum(centred * centred))


@BENCH.part()
def terminated(*, count: int = 200, seed: int = 0) -> None:
    """SIGTERM to services at random moments of their starts, from the first instant until after they are ready.

    Even ones are started as the supervisor starts them: exit code 0 at any moment. Odd ones as a shell does: before the
    first of our code runs the signal ends them (143 in a shell). Nothing of them may be left: no process of their
    group, no token, no file but the log.

    Args:
        count: starts.
        seed: seed of the moments.
    """
    random, took = Random(seed), dict[str, float]()
    ends, codes, left = dict[str, list[float]](), Counter[tuple[str, int | None]](), list[str]()
    with tempfile.TemporaryDirectory() as name, Live(Path(name)) as live:
        for service in SERVICES:
            began = time.monotonic()
            live.start((service,))
            took[service] = time.monotonic() - began
        own = {Supervisor.name}
        live.stop(signal.SIGTERM)
        wait_until(lambda: set(live.alive) <= own, GRACE_S, "all tokens are gone")
        for number in range(count):
            service, folder = SERVICES[number % len(SERVICES)], live.folder / str(number)
            folder.mkdir()
            how = ("supervisor", "shell")[number // len(SERVICES) % 2]
            words = (sys.executable, "-m", "surefoot.lockstep.discover", service)
            words += ("--connect", live.address, "--namespace", live.namespace)
            with ExitStack() as stack:
                child: Any
                if how == "supervisor":
                    child = stack.enter_context(running_child(service, words, environment(folder), folder / "log"))
                else:
                    log, options = stack.enter_context((folder / "log").open("wb")), environment(folder)
                    command = running(words, env=options, stdout=log, stderr=log, start_new_session=True)
                    child = stack.enter_context(command)
                code, seconds = _ended(child, random.uniform(0.0, 1.2 * took[service]))
                if not _is_gone(child.pid):
                    left.append(f"a process of {service} {number}")
            ends.setdefault(how, []).append(seconds)
            codes[how, code] += 1
            left += [str(path.relative_to(live.folder)) for path in folder.rglob("*") if path.name != "log"]
        wait_until(lambda: set(live.alive) <= own, GRACE_S, "no token is left")
    rows = [(how, len(found), f"{sum(s < 2.0 for s in found)}", middle_and_ends(found, 3),
             ", ".join(f"{n} x {code}" for (by, code), n in sorted(codes.items(), key=str) if by == how))
            for how, found in ends.items()]  # fmt: skip
    table(f"starts of {min(took.values()):.1f} to {max(took.values()):.1f} s, load {os.getloadavg()[0]:.0f}",
          ("started as by", "starts", "within 2 s", "SIGTERM to exit, s", "exit codes"), rows)  # fmt: skip
    print(f"left behind: {', '.join(left) or 'nothing'}", flush=True)
    allowed = {("supervisor", 0), ("shell", 0), ("shell", -signal.SIGTERM)}
    if left or not set(codes) <= allowed or max(max(found) for found in ends.values()) > 2.0:
        raise RuntimeError("an end was late, had another exit code, or left something")


def _is_gone(group: int) -> bool:
    """Return True if no process of a group is left within 2 s; programs that a library runs end by themselves."""
    with suppress(ProcessLookupError):
        for _ in range(100):
            os.killpg(group, 0)
            time.sleep(0.02)
        return False
    return True


def _ended(process: Any, moment: float) -> tuple[int | None, float]:
    """Send SIGTERM to a process after some seconds; return its exit code and the time to its end, s."""
    time.sleep(moment)
    began = time.monotonic()
    process.terminate()
    try:
        code = process.wait(GRACE_S)
    except subprocess.TimeoutExpired:
        code = None
    return code, time.monotonic() - began
