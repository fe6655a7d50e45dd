"""Running system that a benchmark measures: command line, processes, memory, and arrival of ticks at an observer."""

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from itertools import pairwise
from pathlib import Path
from typing import Any

import zenoh

from surefoot.services.supervisor.processes.rundir import RunFolder
from tests.ports import free_address
from tests.processes import end_systems

ENTRY = [sys.executable, "-m", "surefoot.lab.cli.entry"]
SPIN = "while True: sum(range(10000))"


class Machine:
    """Command line of `surefoot` with a state folder and a port of its own."""

    def __init__(self, folder: Path, system: str = "ragno") -> None:
        self.folder, self.system, self.address = folder, system, free_address()
        self.namespace = f"surefoot/{system}"
        self.environment = {**os.environ, "XDG_STATE_HOME": str(folder), "SUREFOOT_LISTEN": self.address}

    def surefoot(self, *words: str) -> subprocess.CompletedProcess[str]:
        """Run a `surefoot` command with the state folder and port of this machine; return its result."""
        return subprocess.run([*ENTRY, *words], env=self.environment, capture_output=True, text=True, check=False)

    def status(self) -> dict[str, Any]:
        """Return the report of `surefoot status` on the system."""
        return json.loads(self.surefoot("status", "--json").stdout)[self.system]

    def pids(self) -> dict[str, int]:
        """Return the process id of each service by name; that of the supervisor is under `supervisor`."""
        found = {row["service"]: row["pid"] for row in self.status()["services"] if row["pid"]}
        keeper = RunFolder(self.system, self.folder / "surefoot").supervisor()
        assert keeper is not None
        return {**found, "supervisor": keeper.pid}

    def restart(self, name: str) -> float:
        """Kill a service, wait until all are healthy again, and return the time then, s of the monotonic clock."""
        pid = self.pids()[name]
        os.kill(pid, signal.SIGKILL)
        deadline = time.monotonic() + 60.0
        while self.pids().get(name, pid) == pid:
            if time.monotonic() > deadline:
                raise RuntimeError(f"{name} is not started again: {self.status()['services']}")
            time.sleep(0.5)
        self.wait_until_healthy()
        return time.monotonic()

    def wait_until_healthy(self) -> None:
        """Wait until every service is healthy and visible."""
        deadline = time.monotonic() + 300.0
        while True:
            rows = self.status()["services"]
            if all(row["state"] == "healthy" and not row["detail"] for row in rows):
                return
            if time.monotonic() > deadline:
                raise RuntimeError(f"not healthy again: {rows}")
            time.sleep(1.0)

    @contextmanager
    def session(self) -> Iterator[zenoh.Session]:
        """Yield a session that has joined the system's network as a client."""
        settings = {"mode": "client", "connect": {"endpoints": [self.address]}}
        with zenoh.open(zenoh.Config.from_json5(json.dumps(settings))) as session:
            yield session


@contextmanager
def up(folder: Path, *words: str, system: str = "ragno") -> Iterator[Machine]:
    """Start a system, yield a handle of it, and take it down at the end of the context.

    `folder`: for its state; `words`: further options of `surefoot up`.
    """
    machine = Machine(folder, system)
    try:
        done = machine.surefoot("up", system, "-d", *words)
        assert done.returncode == 0, done.stderr
        yield machine
        machine.surefoot("down")
    finally:
        end_systems(folder / "surefoot")


class Ticks:
    """Ticks of a system, and when each reached an observer, s of the monotonic clock."""

    def __init__(self, session: zenoh.Session, namespace: str) -> None:
        self.seen: list[tuple[int, float]] = []
        self._subscriber = session.declare_subscriber(f"{namespace}/hw/tick", self._on_tick)

    def _on_tick(self, sample: zenoh.Sample) -> None:
        payload = sample.payload.to_bytes()
        if payload:
            self.seen.append((json.loads(payload)["tick"], time.monotonic()))

    def between(self, begin: float, end: float) -> list[tuple[int, float]]:
        """Return the ticks that arrived in a span, and their times; `begin`, `end`: s of the monotonic clock."""
        return [item for item in list(self.seen) if begin <= item[1] < end]

    def rate(self, begin: float, end: float) -> float:
        """Return simulated ticks per s of wall time in a span; `begin`, `end`: s of the monotonic clock."""
        found = self.between(begin, end)
        return (found[-1][0] - found[0][0]) / (found[-1][1] - found[0][1]) if len(found) > 1 else 0.0

    def gaps(self, begin: float, end: float) -> list[float]:
        """Return the sorted times between neighbouring ticks in a span of the monotonic clock, s."""
        times = [when for _, when in self.between(begin, end)]
        return sorted(b - a for a, b in pairwise(times))


def resident_mb(pid: int, *, peak: bool = False) -> float:
    """Return the resident memory of a process, MB; ``peak``: the largest since `forget_peak`."""
    field = "VmHWM" if peak else "VmRSS"
    text = Path(f"/proc/{pid}/status").read_text()
    return int(next(line for line in text.splitlines() if line.startswith(field)).split()[1]) / 1024.0


def children(pid: int) -> list[int]:
    """Return the ids of the child processes of a process."""
    threads = Path(f"/proc/{pid}/task").glob("*/children")
    return [int(child) for thread in threads for child in thread.read_text().split()]


def proportional_mb(pid: int) -> float:
    """Return the memory of a process, MB, in which a page that n processes share counts 1/n."""
    text = Path(f"/proc/{pid}/smaps_rollup").read_text()
    return int(next(line for line in text.splitlines() if line.startswith("Pss:")).split()[1]) / 1024.0


def forget_peak(pid: int) -> None:
    """Reset the peak memory of a process."""
    Path(f"/proc/{pid}/clear_refs").write_text("5")


def descriptors(pid: int) -> int:
    """Return the number of file descriptors that a process holds open."""
    return len(list(Path(f"/proc/{pid}/fd").iterdir()))
