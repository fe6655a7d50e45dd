"""Live view beside a command that starts a system."""

import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from signal import SIGTERM
from typing import Annotated

import typer

View = Annotated[bool, typer.Option("--view", help="Show it in a browser: prints the address of the live view.")]
START_S = 900
"""Wall time until the system answers, whose kernels may have to be compiled."""


@contextmanager
def viewer(connect: str, namespace: str, robot: str, *, wanted: bool) -> Iterator[None]:
    """Run `surefoot view` as a process of its own, so that it takes no time from the system; end it after.

    Args:
        connect: endpoint of the router, which need not be there yet.
        namespace: prefix of the keys.
        robot: name or folder.
        wanted: False = do nothing.
    """
    if not wanted:
        yield
        return
    command = [sys.executable, "-m", "surefoot.lab.cli.main", "view", "--wait", str(START_S)]
    command += ["--connect", connect, "--namespace", namespace, "--robot", robot]
    with subprocess.Popen(command, stdout=sys.stderr) as view:  # the output is that of the command
        try:
            yield
        finally:
            view.send_signal(SIGTERM)
