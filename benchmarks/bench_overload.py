"""A system beside twelve busy processes: false restarts, the pace that is left, and how long an emergency stop takes.

For `rtf` 1 and 0 (as fast as it goes): `surefoot up ragno`, twelve processes that compute, and for SUREFOOT_OVERLOAD_S
seconds (1800 when not set) the restarts are counted. Then twenty emergency stops, each from the start of the process
to its end, beside a bare Zenoh client that stops the robot and waits for `sim/status`.
"""

import json
import os
import resource
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

from tests.ports import free_address
from tests.processes import end_systems, running

BUSY = 12
STOPS = 20
DURATION_S = float(os.environ.get("SUREFOOT_OVERLOAD_S", "1800"))
SPIN = "while True: sum(range(10000))"
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


class Machine:
    """The command line with a state folder and a port of its own."""

    def __init__(self, folder: Path) -> None:
        self.folder, self.address = folder, free_address()
        self.environment = {**os.environ, "XDG_STATE_HOME": str(folder), "SUREFOOT_LISTEN": self.address}

    def surefoot(self, *words: str) -> subprocess.CompletedProcess[str]:
        """Run a command."""
        command = [sys.executable, "-m", "surefoot.lab.cli.entry", *words]
        return subprocess.run(command, env=self.environment, capture_output=True, text=True, check=False)

    def status(self) -> dict[str, Any]:
        """What `surefoot status` shows of the system."""
        return json.loads(self.surefoot("status", "--json").stdout)["ragno"]


@contextmanager
def up(folder: Path, rtf: str) -> Iterator[Machine]:
    """A system that is up."""
    machine = Machine(folder)
    try:
        done = machine.surefoot("up", "ragno", "-d", "--rtf", rtf)
        assert done.returncode == 0, done.stderr
        yield machine
        machine.surefoot("down", "ragno")
    finally:
        end_systems(folder / "surefoot")


def stops(machine: Machine, command: list[str]) -> tuple[list[float], float, int]:
    """Wall times of emergency stops, s; processor time of one, s; how many were confirmed."""
    times: list[float] = []
    confirmed = 0
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    for _ in range(STOPS):
        began = time.monotonic()
        code = subprocess.run(command, env=machine.environment, capture_output=True, check=False).returncode
        times.append(time.monotonic() - began)
        confirmed += code == 0
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    spent = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return times, spent / STOPS, confirmed


def main() -> None:
    """Print the figures."""
    for rtf in ("1", "0"):
        with tempfile.TemporaryDirectory() as folder, up(Path(folder), rtf) as machine, ExitStack() as stack:
            for _ in range(BUSY):
                stack.enter_context(running([sys.executable, "-c", SPIN]))
            paces: list[float] = []
            end = time.monotonic() + DURATION_S
            while time.monotonic() < end:
                paces.append(machine.status().get("time", {}).get("rtf", 0.0))
                time.sleep(min(5.0, DURATION_S / 10))
            found = machine.status()
            restarts = sum(row["restarts"] for row in found["services"])
            print(
                f"rtf {rtf}, {BUSY} busy processes, {DURATION_S:g} s: {restarts} restarts, real-time factor median "
                f"{statistics.median(paces):.2f}, least {min(paces):.2f}; {found['time']['words']}"
            )
            ours = [sys.executable, "-m", "surefoot.lab.cli.entry", "stop"]
            bare = [sys.executable, "-c", BARE, machine.address, "surefoot/ragno"]
            for name, command in (("surefoot stop", ours), ("bare client", bare)):
                times, spent, confirmed = stops(machine, command)
                print(
                    f"{name}: {confirmed} of {STOPS} confirmed, median {statistics.median(times):.3f} s, "
                    f"worst {max(times):.3f} s, {spent:.3f} s of processor time"
                )


if __name__ == "__main__":
    main()
