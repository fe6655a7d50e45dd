"""Connection of a command to the running system."""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from surefoot.client import Client


@contextmanager
def client(connect: str | None = None, namespace: str | None = None) -> Iterator["Client"]:
    """Connect to a system (that of the arguments, else the one on this machine, else the default); yield a client.

    Raises:
        BusError: no system answers there.
    """
    with joined(*endpoint(connect, namespace)) as robot:
        yield robot


@contextmanager
def joined(where: str, prefix: str, patience_ms: int | None = None) -> Iterator["Client"]:
    """Connect to the system at an endpoint and yield a client (raises BusError: no system answers).

    `where`: Zenoh endpoint; `prefix`: prefix of the system's keys; `patience_ms`: longest wait for its router, ms.
    """
    from surefoot.bus.zenoh import ZenohBus, client_options
    from surefoot.client import Client

    _knock(where)
    options = client_options(where, prefix, *([] if patience_ms is None else [patience_ms]))
    with Client(ZenohBus(options)) as robot:
        yield robot


def endpoint(connect: str | None = None, namespace: str | None = None) -> tuple[str, str]:
    """Return (endpoint, key prefix): the arguments, else those of the system on this machine, else the defaults.

    Raises:
        ConfigError: the given text is no endpoint, or several systems run and none was named.
    """
    from .running import only_one, systems

    found = only_one(systems(connect, namespace), "--namespace or --connect")
    return found.connect, found.namespace


def _knock(where: str) -> None:
    """Raise an error at once if no router listens at the endpoint `where`, instead of after Zenoh's time limit."""
    from surefoot.errors import BusError

    from .running import RunningSystem
    from .stopping import answers

    if not answers(where):
        what = RunningSystem("", where, "").orphans() or "start one with `surefoot up`, or name another with --connect"
        raise BusError("absent", f"no system answers at {where}; {what}")
