"""Start of services by forks of one process that has imported them."""

import ctypes
import os
import signal
import subprocess
import sys
import threading
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from multiprocessing import Pipe
from pathlib import Path
from typing import Self

from surefoot.lockstep.discover import own_service_names
from surefoot.lockstep.ending import ENDS
from surefoot.lockstep.forking import ROOM, Fork

from .compose import ComposeService
from .identity import await_end

SERVICE = "surefoot-service"
"""Program that starts a service."""
SERVER_MODULE = "surefoot.lockstep.forking"
OWN = "SUREFOOT_"
"""Prefix of the variables that a service reads when it runs; others may change what a package does on its import."""
ON_IMPORT = "SUREFOOT_KERNELS"
"""Variable with this prefix that is read on import all the same."""
ANSWER_S = 10.0
"""Wall time after which a fork that does not come is given up, s; it takes some milliseconds."""
LAST_S = 2.0
"""Wall time after which a server that does not end by itself is killed, s."""
PR_SET_CHILD_SUBREAPER = 36
"""Number of the option of `prctl` by which a process inherits the orphans among its descendants."""


class Forked:
    """Process of a service that was forked, a child of this process since its own parent has ended."""

    def __init__(self, pid: int) -> None:
        self.pid = pid
        self._code: int | None = None
        self._lock = threading.Lock()  # the id is free for others as soon as one thread has the exit code

    def poll(self) -> int | None:
        """Return the exit code, negative for a signal, None while it runs."""
        with self._lock:
            if self._code is None:
                with suppress(ChildProcessError):
                    pid, status = os.waitpid(self.pid, os.WNOHANG)
                    self._code = os.waitstatus_to_exitcode(status) if pid else None
            return self._code

    def wait(self, timeout: float) -> int:
        """Return the exit code once the process ends (raises subprocess.TimeoutExpired: it still runs)."""
        if self.poll() is None:
            await_end((self.pid,), timeout)
        code = self.poll()
        if code is None:
            raise subprocess.TimeoutExpired(str(self.pid), timeout)
        return code


class ForkServer:
    """Process that has imported the services of a system and starts them by forks; a context manager.

    A service that it cannot start, or cannot start any more because it was killed, begins in a process of its own.
    """

    def __init__(self, services: Iterable[str], environment: Mapping[str, str] | None = None) -> None:
        """Start the process; it imports `services` meanwhile, with variables on top of those here (raises OSError)."""
        self.services = frozenset(services)
        self._on_import = read_on_import(environment or {})
        self._lock = threading.Lock()
        self._requests, theirs = Pipe()
        words = [str(theirs.fileno()), ",".join(sorted(self.services)), " " * ROOM]
        with theirs, held_back():  # its forks begin with the signals that it was started with
            self._process = subprocess.Popen(
                [sys.executable, "-m", SERVER_MODULE, *words],
                env={**os.environ, **self._on_import},
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                pass_fds=(theirs.fileno(),),
                start_new_session=True,
            )
        self._ready = False

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    @property
    def pid(self) -> int:
        """Process id of the server."""
        return self._process.pid

    def close(self) -> None:
        """End the server; the services that it has started go on."""
        self._requests.close()  # it ends by itself, once a fork that was requested has begun
        try:
            self._process.wait(LAST_S if self._ready else 0.0)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()

    def ready(self, patience_s: float = 0.0) -> bool:
        """Return True once the services are imported, or if the server has ended."""
        if not self._ready:
            with suppress(EOFError, OSError):
                if not self._requests.poll(patience_s):
                    return False
                self._requests.recv()
            self._ready = True
        return True

    def serves(self, words: Sequence[str], environment: Mapping[str, str]) -> bool:
        """Return True if a service of these words and additional variables may be a fork."""
        return bool(words) and words[0] in self.services and read_on_import(environment) == self._on_import

    def start(
        self, command: Sequence[str], words: Sequence[str], environment: Mapping[str, str], log: Path
    ) -> Forked | None:
        """Start a service.

        Args:
            command: command line that the process shows.
            words: name of the service and its arguments.
            environment: variables on top of those of this process.
            log: file of both outputs.

        Returns:
            The process, None when the server does not answer.
        """
        request = Fork(tuple(command), tuple(words), {**os.environ, **environment}, str(log.resolve()))
        with self._lock, suppress(EOFError, OSError), _inheriting():
            if self.ready(ANSWER_S):
                self._requests.send(request)
                if not self._requests.poll(ANSWER_S):
                    self._process.kill()  # no process whose id is not known begins after this
                    self._process.wait()
                return Forked(self._requests.recv())
        return None


@contextmanager
def held_back() -> Iterator[None]:
    """Block SIGTERM and SIGINT while a service is started; it unblocks them as soon as it can end with exit code 0."""
    before = signal.pthread_sigmask(signal.SIG_BLOCK, ENDS)
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


@contextmanager
def _inheriting() -> Iterator[None]:
    """Let this process become the parent of descendants whose own parent ends."""
    library = ctypes.CDLL(None)
    library.prctl(PR_SET_CHILD_SUBREAPER, 1, 0, 0, 0)
    try:
        yield
    finally:
        library.prctl(PR_SET_CHILD_SUBREAPER, 0, 0, 0, 0)


def read_on_import(environment: Mapping[str, str]) -> dict[str, str]:
    """Return those of some variables that may change what is imported: for these a service needs its own process."""
    return {name: text for name, text in environment.items() if not name.startswith(OWN) or name == ON_IMPORT}


def fork_server(services: Iterable[ComposeService]) -> ForkServer | None:
    """Return a server for surefoot's own services among those of a system, None where they are fewer than two.

    Services with the variables of the first one are forks; one with another number of threads, for example, is not.
    """
    names = set(own_service_names()) if sys.platform == "linux" else set[str]()
    ours = [one for one in services if one.command[0] == SERVICE and set(one.command[1:2]) & names]
    if len(ours) < 2:
        return None
    with suppress(OSError):
        return ForkServer({one.command[1] for one in ours}, ours[0].environment)
    return None
