"""Process that has imported the services of a system and starts each of them by a fork of itself.

A service that begins in a new interpreter imports for 0.3 to 0.9 s of processor time, most of it the same packages as
its neighbours. This process imports once, with one thread, and opens nothing: no session, no file, no random numbers.
It ends when its supervisor closes the connection, or is gone.
"""

import ctypes
import gc
import importlib
import os
import sys
import traceback
from collections.abc import Mapping, Sequence
from contextlib import suppress
from multiprocessing.connection import Connection
from pathlib import Path
from typing import NamedTuple, NoReturn

from surefoot.bus.codec import encoding_of
from surefoot.schemas.topics import TOPICS

from .discover import main as run_service

ROOM = 1024
"""Length of the text that a forked process may show as its command line, bytes."""
LATER = ("surefoot.bus.zenoh", "surefoot.lockstep.launch", "surefoot.lockstep.local")
"""Modules that every service imports while it starts."""
KERNELS = "surefoot.kernels.jit"
"""Module that is loaded if one of the services has compiled kernels."""


class Fork(NamedTuple):
    """Request to start a service.

    Attributes:
        command: command line that the process shows, for `ps` and the like.
        words: name of the service and its arguments.
        environment: all environment variables of the process.
        log: path of the file to which both outputs are appended.
    """

    command: Sequence[str]
    words: Sequence[str]
    environment: Mapping[str, str]
    log: str


def main() -> None:
    """Import the services of the command line, then fork one for each request of the connection, until it closes.

    The command line has the descriptor of the connection and the names of the services. The process sends None when
    it is ready, then the process id for each `Fork`.
    """
    with Connection(int(sys.argv[1])) as requests:
        gc.disable()  # nothing that is imported becomes garbage
        _prepare(sys.argv[2].split(","))
        gc.freeze()  # a collection in a fork would copy every page with an object
        with suppress(EOFError, OSError):
            requests.send(None)
            while True:
                request: Fork = requests.recv()
                _fork(request, requests)


def _prepare(services: Sequence[str]) -> None:
    """Import services, and build what each of them builds before its first message."""
    for name in (*(f"surefoot.services.{service}.service" for service in services), *LATER):
        with suppress(Exception):  # the service imports it again, and its log has the error
            importlib.import_module(name)
    if KERNELS in sys.modules:
        sys.modules[KERNELS].load_tables()
    for topic in TOPICS:
        encoding_of(topic.model)


def _fork(request: Fork, requests: Connection) -> None:
    """Fork a service and send its process id; its parent ends at once, so that the supervisor inherits the process.

    The process waits until its id is sent. If this one ends before, as when the supervisor has lost patience, it ends.
    """
    born, bears = os.pipe()
    goes, lets_go = os.pipe()
    parent = os.fork()
    if parent == 0:
        if os.fork():
            os._exit(0)
        os.setsid()
        os.write(bears, str(os.getpid()).encode())  # from now on a signal to its group reaches it
        for end in (born, bears, lets_go):
            os.close(end)
        requests.close()
        if os.read(goes, 1):
            os.close(goes)
            _become(request)
        os._exit(0)
    os.close(bears)
    os.close(goes)
    with open(born, "rb") as answer, open(lets_go, "wb", buffering=0) as gate:
        pid = int(answer.read())
        os.waitpid(parent, 0)
        requests.send(pid)
        gate.write(b".")


def _become(request: Fork) -> NoReturn:
    """Turn this process, just forked, into that of a service; it ends with the service's exit code."""
    code = 1
    try:
        log = os.open(request.log, os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o644)
        os.dup2(log, 1)
        os.dup2(log, 2)
        os.close(log)
        os.environ.clear()
        os.environ.update(request.environment)
        sys.argv[:] = ["surefoot-service", *request.words]
        _show(request.command)
        run_service([*request.words])
        code = 0
    except SystemExit as end:
        code = end.code if isinstance(end.code, int) else 0
    except BaseException:
        traceback.print_exc()
    finally:
        with suppress(OSError, ValueError):
            sys.stdout.flush()
            sys.stderr.flush()
        os._exit(code)


def _show(command: Sequence[str]) -> None:
    """Replace the command line that the system shows for this process, in the memory where the kernel reads it."""
    with suppress(OSError, ValueError, IndexError):
        fields = Path("/proc/self/stat").read_text(encoding="ascii", errors="replace").rpartition(")")[2].split()
        begin, end = int(fields[45]), int(fields[46])
        text = b"\0".join(word.encode(errors="replace") for word in command)[: end - begin - 1]
        if 0 < begin < end:
            ctypes.memmove(begin, text.ljust(end - begin, b"\0"), end - begin)


if __name__ == "__main__":
    main()
