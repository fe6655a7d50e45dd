"""Processes of the operating system: start in an own group, know again, end politely, then firmly.

A process is known by its id and its start time, so that a later process under the same id is never taken for it, and
nothing is ever signalled that was not started from here.
"""

import os
import select
import signal
import subprocess
import sys
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import IO

from surefoot.lockstep.ending import ENDS
from surefoot.services.supervisor.processes.signs import starved_s

SERVICE_MODULE = "surefoot.lockstep.discover"
MAX_LOG_BYTES = 32 * 1024 * 1024  # a larger log is set aside as <name>.log.1 at the next start


@dataclass(frozen=True)
class Identity:
    """A process, distinguishable from every other one of this boot and of others.

    Attributes:
        pid: process id (of the group leader: its group has the same number).
        started: start time in clock ticks since boot, as the kernel tells it.
        boot: identity of the boot; start times of another boot mean nothing.
    """

    pid: int
    started: int
    boot: str

    def alive(self) -> bool:
        """Tell whether this very process still runs (a zombie does not)."""
        return identify(self.pid) == self

    def signal_group(self, number: signal.Signals) -> bool:
        """Signal the process and its children; False when it is gone or somebody else has its id.

        A supervisor that a script has started leads no group: it alone is signalled, and ends its own.
        """
        if not self.alive():
            return False
        try:
            if os.getpgid(self.pid) == self.pid:
                os.killpg(self.pid, number)
            else:
                os.kill(self.pid, number)
        except (ProcessLookupError, PermissionError):
            return False
        return True


def identify(pid: int) -> Identity | None:
    """Return the identity of a running process, None when there is none of that id."""
    try:
        stat = Path(f"/proc/{pid}/stat").read_text(encoding="ascii", errors="replace")
        boot = Path("/proc/sys/kernel/random/boot_id").read_text(encoding="ascii").strip()
    except OSError:
        return None
    fields = stat.rpartition(")")[2].split()  # the name before ')' may contain anything
    state, started = fields[0], int(fields[19])
    return None if state in ("Z", "X") else Identity(pid, started, boot)


class Child:
    """A process that this one started."""

    def __init__(self, name: str, command: Sequence[str], environment: Mapping[str, str], log: Path) -> None:
        """Start the process in a group of its own, with both outputs in `log`.

        Raises:
            OSError: when the program cannot be started.
        """
        self.name = name
        self.command = tuple(command)
        self.log = log
        resolved = resolve_command(command)
        with _open_log(log) as stream, _held_back(resolved):
            self._process = subprocess.Popen(
                resolved,
                env={**os.environ, **environment},
                stdin=subprocess.DEVNULL,
                stdout=stream,
                stderr=subprocess.STDOUT,
                start_new_session=True,
            )
        self.pid = self._process.pid
        self.identity = identify(self.pid)

    def poll(self) -> int | None:
        """Return the exit code, negative for a signal, None while it runs."""
        return self._process.poll()

    def starved_s(self) -> float:
        """Return the seconds its main thread has waited for a processor since its start."""
        return starved_s(self.pid)

    def terminate(self) -> None:
        """Ask the process and its children to end."""
        self._signal(signal.SIGTERM)

    def kill(self) -> None:
        """End the process and its children at once."""
        self._signal(signal.SIGKILL)

    def wait(self, timeout_s: float) -> int | None:
        """Wait for the end; None when it still runs after `timeout_s`."""
        try:
            return self._process.wait(timeout_s)
        except subprocess.TimeoutExpired:
            return None

    def _signal(self, number: signal.Signals) -> None:
        if self._process.poll() is not None:
            return  # reaped: the id may belong to somebody else by now
        try:
            os.killpg(self.pid, number)
        except ProcessLookupError:
            return

    def last_words(self, lines: int = 3) -> str:
        """Return the last lines of the log, for an error sentence."""
        try:
            text = self.log.read_text(encoding="utf-8", errors="replace")
        except OSError:
            return ""
        return "\n".join(text.rstrip().splitlines()[-lines:])


def resolve_command(command: Sequence[str]) -> list[str]:
    """Return the command with our own programs run by this very Python, whatever PATH says."""
    program, *arguments = command
    if program == "surefoot-service":
        return [sys.executable, "-m", SERVICE_MODULE, *arguments]
    if program == "surefoot":
        return [sys.executable, "-m", "surefoot.lab.cli.main", *arguments]
    if program in ("python", "python3"):
        return [sys.executable, *arguments]
    return [program, *arguments]


def end(identity: Identity, grace_s: float = 2.0) -> bool:
    """End a process that is not our child (of an earlier supervisor): SIGTERM, then SIGKILL after `grace_s`.

    Returns:
        True when it is gone, False when it could not be ended.
    """
    for number, patience_s in ((signal.SIGTERM, grace_s), (signal.SIGKILL, 1.0)):
        if not identity.signal_group(number):
            return not identity.alive()
        if _gone_within(identity, patience_s):
            return True
    return False


def _gone_within(identity: Identity, patience_s: float) -> bool:
    """Wait for the end of a process that is not our child, by its pidfd."""
    try:
        handle = os.pidfd_open(identity.pid)
    except (OSError, AttributeError):
        return not identity.alive()
    try:
        poller = select.poll()
        poller.register(handle, select.POLLIN)
        poller.poll(patience_s * 1000)
    finally:
        os.close(handle)
    return not identity.alive()


def busy_s(pids: Iterable[int]) -> float:
    """Return the processor time of processes, s; of those that are gone nothing."""
    ticks = 0
    for pid in pids:
        try:
            fields = Path(f"/proc/{pid}/stat").read_text(encoding="ascii", errors="replace").rpartition(")")[2].split()
        except OSError:
            continue
        ticks += int(fields[11]) + int(fields[12])
    return ticks / os.sysconf("SC_CLK_TCK")


@contextmanager
def _held_back(command: Sequence[str]) -> Iterator[None]:
    """Start a service with SIGTERM held back: it lets it through as soon as it can end with exit code 0."""
    numbers = ENDS if SERVICE_MODULE in command else ()
    before = signal.pthread_sigmask(signal.SIG_BLOCK, numbers)
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _open_log(path: Path) -> IO[bytes]:
    path.parent.mkdir(parents=True, exist_ok=True)
    if path.exists() and path.stat().st_size > MAX_LOG_BYTES:
        path.replace(path.with_name(f"{path.name}.1"))
    return path.open("ab")
