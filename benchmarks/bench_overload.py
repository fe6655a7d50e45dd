"""A system beside busy processes: restarts, pace, emergency stops, faults; and what the commands cost.

`python -m benchmarks.bench_overload [restarts[:rtf]] [stops] [faults] [commands]`, all parts when none is named.

- restarts: `surefoot up ragno` at `rtf` 1 and 0 (as fast as it goes) beside twelve processes that compute, for
  SUREFOOT_OVERLOAD_S seconds (1800 when not set): restarts, and the pace that is left. With SUREFOOT_OVERLOAD_NICE
  everything, system and busy processes, has that nice value once the system is up: harder for both, kinder to others.
- stops: emergency stops beside four busy processes, each from the start of the process to its end, in turns with a bare
  Zenoh client that stops the robot and waits for `sim/status`.
- faults: how soon a service that crashes, freezes or pauses for 1 s is noticed.
- commands: processor time of `call`, `topic echo` and `status`.
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

from benchmarks.machine import ENTRY, SPIN, Machine, up
from tests.processes import running

BUSY = 12
STOPS, STOP_BUSY = 100, 4
FAULTS = 5
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


def stops() -> None:
    """Print the times of emergency stops and of the bare client's."""
    with tempfile.TemporaryDirectory() as folder, up(Path(folder)) as machine:
        bare = [sys.executable, "-c", BARE, machine.address, machine.namespace]
        for count in (0, STOP_BUSY):
            rows: dict[str, list[tuple[float, float, bool]]] = {"surefoot stop": [], "bare client": []}
            with busy(count):
                for _ in range(STOPS):
                    rows["surefoot stop"].append(_timed(machine, [*ENTRY, "stop"]))
                    rows["bare client"].append(_timed(machine, bare))
            ratios = [a[0] / b[0] for a, b in zip(*rows.values(), strict=True)]
            print(f"{count} busy processes, load {os.getloadavg()[0]:.0f}: wall of neighbours {_spread(ratios)}")
            for name, found in rows.items():
                wall, spent = [row[0] for row in found], [row[1] for row in found]
                print(
                    f"  {name}: {sum(row[2] for row in found)} of {STOPS} confirmed, wall {_spread(wall, ' s')}, "
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
        found: dict[str, list[float]] = {"crash": [], "freeze": []}
        for number in range(2 * FAULTS):
            what, sent = (("crash", signal.SIGKILL), ("freeze", signal.SIGSTOP))[number % 2]
            pid = machine.pids()["footholds"]
            gone.pop("footholds", None)
            began = time.monotonic()
            os.kill(pid, sent)
            while "footholds" not in gone and time.monotonic() - began < 30.0:
                time.sleep(0.0005)
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
    parts = {"restarts": restarts, "stops": stops, "faults": faults, "commands": commands}
    for part in sys.argv[1:] or parts:
        name, _, option = part.partition(":")
        parts[name](*([option] if option else []))


if __name__ == "__main__":
    main()
