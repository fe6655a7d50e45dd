"""Child processes of the supervisor, each in a process group of its own and with a log file."""

import os
import signal
import subprocess
import sys
from collections.abc import Iterable, Mapping, Sequence
from contextlib import nullcontext, suppress
from pathlib import Path
from typing import IO

from .forks import SERVICE, Forked, ForkServer, held_back
from .identity import identify
from .logs import tail

SERVICE_MODULE = "surefoot.lockstep.discover"
MAX_LOG_BYTES = 32 * 1024 * 1024  # a larger log is set aside as <name>.log.1 at the next start


class Child:
    """Child process, of a service or of a supervisor in the background, with its log."""

    def __init__(
        self,
        name: str,
        command: Sequence[str],
        environment: Mapping[str, str],
        log: Path,
        forks: ForkServer | None = None,
    ) -> None:
        """Start the process in a group of its own, with both outputs in `log`; a service by a fork where possible.

        Raises:
            OSError: when the program cannot be started.
        """
        self.name = name
        self.command = tuple(command)
        self.log = log
        resolved = resolve_command(command)
        with _open_log(log) as stream:
            self._process = _forked(command, environment, log, forks) or _begun(resolved, environment, stream)
        self.pid = self._process.pid
        self.identity = identify(self.pid)

    def poll(self) -> int | None:
        """Return the exit code, negative for a signal, None while it runs."""
        return self._process.poll()

    def starved_s(self) -> float:
        """Return the seconds for which threads of the child and of this process have waited for a processor.

        A heartbeat passes several threads of both processes, most of them of the network library.
        """
        return starved_s(self.pid) + starved_s(os.getpid())

    def terminate(self) -> None:
        """Send SIGTERM to the process and its children."""
        self._signal(signal.SIGTERM)

    def kill(self) -> None:
        """Send SIGKILL to the process and its children."""
        self._signal(signal.SIGKILL)

    def wait(self, timeout_s: float) -> int | None:
        """Wait for the end of the process; return its exit code, None when it still runs after `timeout_s`."""
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
        """Return the last `lines` lines of the process's log, for an error message."""
        return "\n".join(tail(self.log, lines)).rstrip()


def _forked(
    command: Sequence[str], environment: Mapping[str, str], log: Path, forks: ForkServer | None
) -> Forked | None:
    if forks is None or command[0] != SERVICE or not forks.serves(command[1:], environment):
        return None
    return forks.start(resolve_command(command), command[1:], environment, log)


def _begun(command: Sequence[str], environment: Mapping[str, str], log: IO[bytes]) -> subprocess.Popen[bytes]:
    with held_back() if SERVICE_MODULE in command else nullcontext():
        return subprocess.Popen(
            command,
            env={**os.environ, **environment},
            stdin=subprocess.DEVNULL,
            stdout=log,
            stderr=subprocess.STDOUT,
            start_new_session=True,
        )


def resolve_command(command: Sequence[str]) -> list[str]:
    """Return the command, this project's programs and `python` replaced by those of the present interpreter."""
    program, *arguments = command
    if program == SERVICE:
        return [sys.executable, "-m", SERVICE_MODULE, *arguments]
    if program == "surefoot":
        return [sys.executable, "-m", "surefoot.lab.cli.main", *arguments]
    if program in ("python", "python3"):
        return [sys.executable, *arguments]
    return [program, *arguments]


def starved_s(pid: int) -> float:
    """Return the seconds that a process's threads have waited for a processor; 0 where the kernel does not count."""
    waited = 0
    with suppress(OSError):  # the process has ended
        for thread in Path(f"/proc/{pid}/task").glob("*/schedstat"):
            with suppress(OSError, ValueError, IndexError):  # the thread has ended
                waited += int(thread.read_text(encoding="ascii").split()[1])
    return waited * 1e-9


def busy_s(pids: Iterable[int]) -> float:
    """Return the processor time that processes have used in sum, s; those that have ended do not count."""
    ticks = 0
    for pid in pids:
        try:
            fields = Path(f"/proc/{pid}/stat").read_text(encoding="ascii", errors="replace").rpartition(")")[2].split()
        except OSError:
            continue
        ticks += int(fields[11]) + int(fields[12])
    return ticks / os.sysconf("SC_CLK_TCK")


def _open_log(path: Path) -> IO[bytes]:
    path.parent.mkdir(parents=True, exist_ok=True)
    if path.exists() and path.stat().st_size > MAX_LOG_BYTES:
        path.replace(path.with_name(f"{path.name}.1"))
    return path.open("ab")
