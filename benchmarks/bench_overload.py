"""A system beside busy processes: restarts, pace, emergency stops, faults; and what the commands cost.

`python -m benchmarks.bench_overload [restarts[:rtf]] [stops[:N]] [faults] [commands] [peers[:N]]`, all parts when none
is named.

- restarts: `surefoot up ragno` at `rtf` 1 and 0 (as fast as it goes) beside twelve processes that compute, for
  SUREFOOT_OVERLOAD_S seconds (1800 when not set): restarts, and the pace that is left. With SUREFOOT_OVERLOAD_NICE
  everything, system and busy processes, has that nice value once the system is up: harder for both, kinder to others.
- stops: N (100) emergency stops without and beside four busy processes, each from the start of the process to its end,
  in turns with a bare Zenoh client that stops the robot and waits for `sim/status`.
- faults: how soon a service that crashes, freezes or pauses for 1 s is noticed.
  A crash is noticed by the network (its liveliness token is gone) and by the supervisor (the process is reaped).
- commands: processor time of `call`, `topic echo` and `status`.
- peers: half of the services are killed in turn, each N (100) times, then the other half: by how much the memory and
  the descriptors of those that live on grow meanwhile. No round begins SUREFOOT_PEERS_S seconds (1800) after the first.
"""

import os
import resource
import signal
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

from benchmarks.machine import ENTRY, SPIN, Machine, descriptors, resident_mb, up
from surefoot.services.supervisor.processes.reconcile import STABLE_S
from tests.processes import running

BUSY = 12
STOPS, STOP_BUSY = 100, 4
FAULTS = 5
PEERS, PEERS_S = 100, float(os.environ.get("SUREFOOT_PEERS_S", "1800"))
COMMANDS = 7
DURATION_S = float(os.environ.get("SUREFOOT_OVERLOAD_S", "1800"))
NICE = int(os.environ.get("SUREFOOT_OVERLOAD_NICE", "0"))
BARE = """
import json, queue, sys, zenoh
heard = queue.SimpleQueue()
config = zenoh.Config.from_json5(json.dumps({"mode": "client", "connect": {"endpoints": [sys.argv[1]]}}))
with zenoh.open(config) as session:
    reader = session.declare_subscriber(sys.argv[2] + "/sim/status", lambda s: heard.put(s.payload.to_bytes()))
    while True:
        session.put(sys.argv[2] + "/cmd/estop", b'{"reason": "bare"}')
        try:
            if json.loads(heard.get(timeout=0.1))["stopped"]:
                break
        except queue.Empty:
            continue
"""


@contextmanager
def busy(count: int) -> Iterator[None]:
    """Run processes that compute."""
    with ExitStack() as stack:
        for _ in range(count):
            process = stack.enter_context(running([sys.executable, "-c", SPIN]))
            _set_nice(process.pid)
        yield


def _set_nice(pid: int) -> None:
    for thread in Path(f"/proc/{pid}/task").iterdir():
        os.setpriority(os.PRIO_PROCESS, int(thread.name), NICE)


def restarts(rtf: str = "") -> None:
    """Print restarts and pace at one real-time factor, or at 1 and 0."""
    for pace in (rtf,) if rtf else ("1", "0"):
        with tempfile.TemporaryDirectory() as folder, up(Path(folder), "--rtf", pace) as machine:
            _restarts(machine, pace)


def _restarts(machine: Machine, rtf: str) -> None:
    for pid in machine.pids().values():
        _set_nice(pid)
    paces: list[float] = []
    worst, found = 0, machine.status()
    with busy(BUSY):
        began = time.monotonic()
        end = began + DURATION_S
        while time.monotonic() < end:
            time.sleep(min(10.0, DURATION_S / 10))
            found = machine.status()
            paces.append(found.get("time", {}).get("rtf", 0.0))
            worst = max(worst, sum(row["restarts"] for row in found["services"]))
        spent = time.monotonic() - began
    print(
        f"rtf {rtf}, {BUSY} busy processes, nice {NICE}, load {os.getloadavg()[0]:.0f}, {spent:.0f} s: "
        f"{worst} restarts; pace {_spread(paces)}; {found.get('time', {}).get('words')}",
        flush=True,
    )


def _spread(values: list[float], unit: str = "") -> str:
    return f"median {statistics.median(values):.3f}{unit} ({min(values):.3f} to {max(values):.3f})"


def _timed(machine: Machine, command: list[str]) -> tuple[float, float, bool]:
    """Run a command; return wall time, s, processor time, s, and whether it went well."""
    before, began = resource.getrusage(resource.RUSAGE_CHILDREN), time.monotonic()
    code = subprocess.run(command, env=machine.environment, capture_output=True, check=False).returncode
    wall, after = time.monotonic() - began, resource.getrusage(resource.RUSAGE_CHILDREN)
    return wall, after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime, code == 0


def stops(number: str = "") -> None:
    """Print the times of emergency stops and of the bare client's."""
    most = int(number or STOPS)
    with tempfile.TemporaryDirectory() as folder, up(Path(folder)) as machine:
        bare = [sys.executable, "-c", BARE, machine.address, machine.namespace]
        for count in (0, STOP_BUSY):
            rows: dict[str, list[tuple[float, float, bool]]] = {"surefoot stop": [], "bare client": []}
            with busy(count):
                for _ in range(most):
                    rows["surefoot stop"].append(_timed(machine, [*ENTRY, "stop"]))
                    rows["bare client"].append(_timed(machine, bare))
            ratios = [a[0] / b[0] for a, b in zip(*rows.values(), strict=True)]
            print(f"{count} busy processes, load {os.getloadavg()[0]:.0f}: wall of neighbours {_spread(ratios)}")
            for name, found in rows.items():
                wall, spent = [row[0] for row in found], [row[1] for row in found]
                print(
                    f"  {name}: {sum(row[2] for row in found)} of {most} confirmed, wall {_spread(wall, ' s')}, "
                    f"processor {_spread(spent, ' s')}",
                    flush=True,
                )


def commands() -> None:
    """Print the processor time of the commands that look at a system."""
    with tempfile.TemporaryDirectory() as folder, up(Path(folder)) as machine:
        for words in (("call", "recorder/status"), ("topic", "echo", "state/velocity", "-n", "1"), ("status",)):
            rows = [_timed(machine, [*ENTRY, *words]) for _ in range(COMMANDS)]
            well, spent = sum(row[2] for row in rows), _spread([row[1] for row in rows], " s")
            print(f"surefoot {' '.join(words)}: {well} of {COMMANDS} well, processor {spent}", flush=True)


def faults() -> None:
    """Print how soon a crash and a freeze are noticed, and what a pause of 1 s costs."""
    with tempfile.TemporaryDirectory() as folder, up(Path(folder)) as machine, machine.session() as session:
        gone: dict[str, float] = {}

        def on_life(sample: object) -> None:
            gone[str(sample.key_expr).split("/")[-2]] = time.monotonic()  # type: ignore[attr-defined]

        watching = session.liveliness().declare_subscriber(f"{machine.namespace}/alive/*/*", on_life)
        found: dict[str, list[float]] = {"crash": [], "crash, by the supervisor": [], "freeze": []}
        for number in range(2 * FAULTS):
            what, sent = (("crash", signal.SIGKILL), ("freeze", signal.SIGSTOP))[number % 2]
            pid = machine.pids()["footholds"]
            gone.pop("footholds", None)
            began = time.monotonic()
            os.kill(pid, sent)
            reaped = 0.0
            while ("footholds" not in gone or (not reaped and what == "crash")) and time.monotonic() - began < 30.0:
                reaped = reaped or (0.0 if Path(f"/proc/{pid}").exists() else time.monotonic())
                time.sleep(0.0005)
            if what == "crash":
                found["crash, by the supervisor"].append((reaped or began + 30.0) - began)
            found[what].append(gone.get("footholds", began + 30.0) - began)
            if sent == signal.SIGSTOP:
                os.kill(pid, signal.SIGCONT)
            _well(machine)
        for what, times in found.items():
            shown = ", ".join(f"{1e3 * seconds:.0f}" for seconds in times)
            print(f"{what}: noticed after {1e3 * statistics.median(times):.0f} ms median ({shown})", flush=True)
        before = {row["service"]: row["restarts"] for row in machine.status()["services"]}
        for name, pid in machine.pids().items():
            if name != "supervisor":
                os.kill(pid, signal.SIGSTOP)
                time.sleep(1.0)
                os.kill(pid, signal.SIGCONT)
                time.sleep(1.0)
        _well(machine)
        after = {row["service"]: row["restarts"] for row in machine.status()["services"]}
        print(
            f"pause of 1 s of each of {len(after)}: {sum(after.values()) - sum(before.values())} restarts", flush=True
        )
        del watching


def peers(number: str = "") -> None:
    """Print by how much processes grow while others are killed and started again."""
    count = int(number or PEERS)
    with tempfile.TemporaryDirectory() as folder, up(Path(folder)) as machine:
        names = [name for name in machine.pids() if name != "supervisor"]
        for half in (names[::2], names[1::2]):
            well: dict[str, float] = {}  # since when each has been well again
            for name in half:  # what the first restart of all brings is not counted
                _restart(machine, name)
                well[name] = time.monotonic()
            pids = {name: pid for name, pid in machine.pids().items() if name not in half}
            before = {name: (resident_mb(pid), descriptors(pid)) for name, pid in pids.items()}
            began, rounds = time.monotonic(), 0
            while rounds < count and time.monotonic() - began < PEERS_S:
                rounds += 1
                for name in half:
                    time.sleep(max(0.0, well[name] + STABLE_S + 1.0 - time.monotonic()))  # else it is given up
                    _restart(machine, name)
                    well[name] = time.monotonic()
            if {name: machine.pids().get(name) for name in pids} != pids:
                raise RuntimeError(f"others than {half} were restarted: {machine.status()['services']}")
            spent = time.monotonic() - began
            print(f"{rounds} restarts of each of {', '.join(half)} in {spent:.0f} s; the others", flush=True)
            for name, pid in pids.items():
                memory, handles = resident_mb(pid) - before[name][0], descriptors(pid) - before[name][1]
                print(f"  {name:<12} {memory:+6.1f} MB {handles:+d} descriptors", flush=True)


def _restart(machine: Machine, name: str) -> None:
    """Kill a service and wait until it is there again."""
    pid = machine.pids()[name]
    os.kill(pid, signal.SIGKILL)
    deadline = time.monotonic() + 60.0
    while machine.pids().get(name, pid) == pid:
        if time.monotonic() > deadline:
            raise RuntimeError(f"{name} is not started again: {machine.status()['services']}")
        time.sleep(0.05)
    _well(machine)


def _well(machine: Machine) -> None:
    """Wait until every service is healthy and visible again."""
    deadline = time.monotonic() + 300.0
    while True:
        rows = machine.status()["services"]
        if all(row["state"] == "healthy" and not row["detail"] for row in rows):
            return
        if time.monotonic() > deadline:
            raise RuntimeError(f"not healthy again: {rows}")
        time.sleep(0.5)


def main() -> None:
    """Run the parts named on the command line, or all."""
    parts = {"restarts": restarts, "stops": stops, "faults": faults, "commands": commands, "peers": peers}
    for part in sys.argv[1:] or parts:
        name, _, option = part.partition(":")
        if name not in parts:
            sys.exit(f"no part {name!r}; there are {', '.join(parts)}")
        whole = name in ("stops", "peers")
        if option and not (option.isdigit() if whole else name == "restarts" and option.replace(".", "", 1).isdigit()):
            sys.exit(f"got {part!r}; allowed are {', '.join(parts)}, restarts:RTF, stops:N and peers:N")
        parts[name](*([option] if option else []))


if __name__ == "__main__":
    main()
