"""Processes that tests start: each is ended whatever happens, by SIGTERM and by SIGKILL at last."""

import resource
import signal
import subprocess
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from surefoot.services.supervisor.processes.identity import end as end_identity
from surefoot.services.supervisor.processes.process import Child
from surefoot.services.supervisor.processes.rundir import run_folders

GRACE_S = 30.0  # s wall between SIGTERM and SIGKILL, and for the end after SIGKILL
LIMIT_S = 240.0  # s wall for a command that ends by itself; all take seconds


@contextmanager
def interruptible() -> Iterator[None]:
    """Let processes that are started inside begin with the default action of SIGINT.

    A background job of a non-interactive shell ignores SIGINT, and its children inherit that. A handler is not
    inherited: a child begins with the default action instead. For the main thread, which alone may set handlers.
    """
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)


@contextmanager
def full_disk(size: int) -> Iterator[Callable[[int | None], None]]:
    """Let no file of this process, not of its children, grow beyond `size` bytes inside.

    Yields a function that sets another size; None is the limit before. To be left before a test ends: pytest writes
    the outcome of a test while its fixtures are still in force, to a file perhaps.
    """
    before, hard = resource.getrlimit(resource.RLIMIT_FSIZE)

    def limit(size: int | None) -> None:
        resource.setrlimit(resource.RLIMIT_FSIZE, (before if size is None else size, hard))

    limit(size)
    try:
        yield limit
    finally:
        limit(None)


def end_process(process: subprocess.Popen[Any]) -> None:
    """End a process by SIGTERM, by SIGKILL when it still runs after `GRACE_S`."""
    if process.poll() is None:
        process.terminate()
        try:
            process.wait(GRACE_S)
        except subprocess.TimeoutExpired:
            process.kill()
    process.wait(GRACE_S)
    for stream in (process.stdin, process.stdout, process.stderr):
        if stream is not None:
            stream.close()


def start_process(command: Sequence[Any], **options: Any) -> subprocess.Popen[Any]:
    """Start a process that SIGINT interrupts, from the main thread; the caller ends it by `end_process`."""
    with interruptible():
        return subprocess.Popen(command, **options)


@contextmanager
def running(command: Sequence[Any], **options: Any) -> Iterator[subprocess.Popen[Any]]:
    """Start a process that SIGINT interrupts, and end it on leaving."""
    process = start_process(command, **options)
    try:
        yield process
    finally:
        end_process(process)


def run_process(
    command: Sequence[Any], *, timeout: float = LIMIT_S, check: bool = False, capture_output: bool = False,
    **options: Any,
) -> subprocess.CompletedProcess[Any]:  # fmt: skip
    """Run a process to its end, as `subprocess.run` does, but by SIGTERM first when it takes too long.

    Raises:
        subprocess.TimeoutExpired: when it still runs after `timeout`.
        subprocess.CalledProcessError: with `check`, when its exit code is not 0.
    """
    if capture_output:
        options |= {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
    with running(command, **options) as process:
        out, err = process.communicate(timeout=timeout)
    done = subprocess.CompletedProcess(command, process.returncode, out, err)
    if check:
        done.check_returncode()
    return done


@contextmanager
def running_child(*arguments: Any) -> Iterator[Child]:
    """Start a `Child` of the supervisor, and end it on leaving."""
    made = Child(*arguments)
    try:
        yield made
    finally:
        made.terminate()
        if made.wait(GRACE_S) is None:
            made.kill()
            made.wait(GRACE_S)


def end_systems(home: Path) -> None:
    """End all supervisors and services that are recorded in the run folders of a state folder."""
    for folder in run_folders(home):
        found = folder.supervisor()
        for identity in (*(() if found is None else (found,)), *folder.processes().values()):
            end_identity(identity, GRACE_S)
