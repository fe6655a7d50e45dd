"""Finding the running system a command speaks to."""

import os
import re
import socket
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from surefoot.client import Client


@contextmanager
def client(connect: str | None = None, namespace: str | None = None) -> Iterator["Client"]:
    """Join the system as a client: the one named, else the one that runs here, else the default endpoint.

    Raises:
        BusError: nobody answers there.
    """
    from surefoot.bus.zenoh import ZenohBus, ZenohOptions
    from surefoot.client import Client

    where, prefix = endpoint(connect, namespace)
    _knock(where)
    with Client(ZenohBus(ZenohOptions(mode="client", connect=(where,), namespace=prefix))) as robot:
        yield robot


def endpoint(connect: str | None = None, namespace: str | None = None) -> tuple[str, str]:
    """Return (endpoint, namespace): as told, else of the system that runs here, else where one would listen.

    Raises:
        ConfigError: what was told is no endpoint.
    """
    from surefoot.bus.endpoint import checked, from_environment, to_listen
    from surefoot.services.supervisor.processes.rundir import run_folders

    connect = checked("--connect", connect) if connect else from_environment(("SUREFOOT_CONNECT",))
    namespace = namespace or os.environ.get("SUREFOOT_NAMESPACE")
    running = [found for folder in run_folders() if (found := folder.endpoint()) is not None]
    for found in running:
        if connect in (None, found.connect) and namespace in (None, found.namespace):
            return found.connect, found.namespace
    robot = os.path.basename(os.path.normpath(os.environ.get("SUREFOOT_ROBOT", "ragno")))  # a name, or a folder
    return connect or to_listen(), namespace or f"surefoot/{robot}"


def _knock(where: str) -> None:
    """Fail at once when nobody listens, instead of after Zenoh's patience."""
    from surefoot.errors import BusError
    from surefoot.services.supervisor.processes.rundir import run_folders

    match = re.fullmatch(r"tcp/(\[?)([^\]]+)\]?:(\d+)", where)
    if match is None:
        return
    try:
        socket.create_connection((match.group(2), int(match.group(3))), timeout=2.0).close()
    except OSError:
        left = [folder.orphaned for folder in run_folders() if folder.orphans()]
        what = left[0] if left else "start one with `surefoot up`, or name another with --connect"
        message = f"no system answers at {where}; {what}"
        raise BusError("absent", message) from None
