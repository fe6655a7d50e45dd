"""Shared parts of commands that show a system in a browser: the system, the address, the duration, a view process."""

import os
import subprocess
import sys
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from signal import SIGTERM
from typing import TYPE_CHECKING, Annotated, NamedTuple

import typer

from .completion import robots
from .connect import joined
from .output import notify, state, write, write_json

if TYPE_CHECKING:
    from surefoot.client import Client
    from surefoot.robot.description import Robot

    from .running import RunningSystem

View = Annotated[bool, typer.Option("--view", help="Show it in a browser: prints the address of the live view.")]
Duration = Annotated[float, typer.Option(min=0.0, help="End after so many s of wall time, 0 = Ctrl-C.")]
Shape = Annotated[
    str | None,
    typer.Option("--robot", help="Robot description: a name, or a folder [the driver's].", autocompletion=robots),
]
START_S = 900
"""Longest wall time to wait until a started system answers, s; its kernels may have to be compiled."""
KNOCK_S = 0.2
"""Wall time between two checks of whether a system answers, s."""
SSH_WORDS = 4
"""Number of words in the variable SSH_CONNECTION of a session: address and port of the client, then of this machine."""


class ShownSystem(NamedTuple):
    """Running system shown in a browser: its address, a client connected to it, and its robot."""

    system: "RunningSystem"
    client: "Client"
    robot: "Robot"


@contextmanager
def seen(connect: str | None, namespace: str | None, robot: str | None, wait_s: float = 0.0) -> Iterator[ShownSystem]:
    """Connect to a running system as soon as it answers; yield its address, a client and its robot.

    Args:
        connect: endpoint of the system's router; None = the system on this machine.
        namespace: prefix of the system's keys; None = as the system was started.
        robot: name or folder of the robot; None = that with which the system was started.
        wait_s: longest wait for an answer, s.

    Raises:
        BusError: no system answers.
        SurefootError: the system's robot is not known on this machine.
    """
    from ..view.newest import robot_behind
    from .running import only_one, systems
    from .stopping import answers

    end = time.monotonic() + wait_s
    while True:
        system = only_one(systems(connect, namespace), "--namespace or --connect")
        if answers(system.connect) or time.monotonic() >= end:
            break
        time.sleep(KNOCK_S)
    with joined(system.connect, system.namespace) as client:
        yield ShownSystem(system, client, robot_behind(client, robot or system.robot, remark))


def show_place(name: str, url: str, port: int, more: Mapping[str, str]) -> None:
    """Write the address of a browser view, and in an SSH session the command of a tunnel to its port."""
    hint = tunnel(port, os.environ)
    if state.json:
        write_json({"url": url, "tunnel": hint, **more})
        return
    if hint:
        write(f"on your own machine: {hint}")
    for title, text in {name: url, **more}.items():
        write(f"{title}: {text}")


def tunnel(port: int, environ: Mapping[str, str]) -> str:
    """Return the `ssh` command by which the client of this SSH session reaches a port here; empty without SSH."""
    connection = environ.get("SSH_CONNECTION", "").split()
    if len(connection) != SSH_WORDS:
        return ""
    return f"ssh -N -L {port}:127.0.0.1:{port} {environ.get('USER', 'user')}@{connection[2]}"


def until(duration_s: float) -> None:
    """Wait for Ctrl-C, or for `duration_s` s of wall time; 0 = no time limit."""
    end = time.monotonic() + duration_s if duration_s > 0.0 else float("inf")
    while (left := end - time.monotonic()) > 0.0:
        time.sleep(min(0.5, left))


def remark(text: str) -> None:
    """Write a line for people, not for programs, to standard error."""
    notify(f"surefoot: {text}")


@contextmanager
def viewer(connect: str, namespace: str, robot: str, *, wanted: bool) -> Iterator[None]:
    """Run `surefoot view` in a process of its own during the context, so that it takes no time from the system.

    Args:
        connect: endpoint of the router, which need not be there yet.
        namespace: prefix of the keys.
        robot: name or folder of the robot.
        wanted: True: start the process; False: do nothing.
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
