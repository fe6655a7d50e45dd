"""Finding the running system that a command addresses."""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from surefoot.client import Client


@contextmanager
def client(connect: str | None = None, namespace: str | None = None) -> Iterator["Client"]:
    """Join the system as a client: the one named, else the one that runs here, else the default endpoint.

    Raises:
        BusError: no system answers there.
    """
    from surefoot.bus.zenoh import ZenohBus, ZenohOptions
    from surefoot.client import Client

    where, prefix = endpoint(connect, namespace)
    _knock(where)
    with Client(ZenohBus(ZenohOptions(mode="client", connect=(where,), namespace=prefix))) as robot:
        yield robot


def endpoint(connect: str | None = None, namespace: str | None = None) -> tuple[str, str]:
    """Return (endpoint, namespace): as given, else of the system that runs here, else where one would listen.

    Raises:
        ConfigError: the value given is no endpoint, or several systems run and none was named.
    """
    from .running import only_one, systems

    found = only_one(systems(connect, namespace), "--namespace or --connect")
    return found.connect, found.namespace


def _knock(where: str) -> None:
    """Fail at once when no process listens, instead of after Zenoh's patience."""
    from surefoot.errors import BusError

    from .running import RunningSystem
    from .stopping import answers

    if not answers(where):
        what = RunningSystem("", where, "").orphans() or "start one with `surefoot up`, or name another with --connect"
        raise BusError("absent", f"no system answers at {where}; {what}")
