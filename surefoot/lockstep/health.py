"""Health message of a service: state, computing times, memory, and the inputs it waits for."""

import os
import resource
from collections import Counter, deque
from pathlib import Path
from typing import Any, Literal, Protocol

from surefoot.bus.inbox import Inbox
from surefoot.kernels.compiling import COMPILING
from surefoot.lockstep.ages import Ages
from surefoot.lockstep.config import config_hash
from surefoot.lockstep.join import Join
from surefoot.lockstep.service import Service
from surefoot.logline import sendable
from surefoot.schemas.system import Health, JoinRequest
from surefoot.version import VERSION


class Patient(Protocol):
    """Attributes of a node that its health message reports."""

    service: Service[Any]
    name: str
    instance: str
    state: str
    epoch: int
    join: Join
    tick_us: deque[float]
    refused: Counter[str]
    inbox: Inbox
    ages: Ages


def kernels(state: str) -> Literal["warm", "compiling", "none"]:
    """Return the state of the kernels of a service in `state`: loaded (warm), being compiled, or none."""
    if COMPILING.busy or state == "compiling":
        return "compiling"
    return "warm" if COMPILING.used and state != "starting" else "none"


def memory_mb() -> float:
    """Return the resident memory of this process now, in units of 2**20 bytes.

    The peak of getrusage is not used, as a process inherits the peak of the process that started it.
    """
    pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 2**20


def health_of(node: Patient, waiting_for: tuple[str, ...]) -> Health:
    """Return the health message of a service; ``waiting_for``: keys of the inputs and queries it lacks."""
    times = sorted(node.tick_us)
    usage = resource.getrusage(resource.RUSAGE_SELF)
    return Health(
        source=node.name, service=node.name, instance=node.instance, pid=os.getpid(),
        tick=node.join.last, epoch=max(0, node.epoch),
        state=node.state,  # pyright: ignore[reportArgumentType] - one of the literal's names
        kernels=kernels(node.state),
        tick_p50_us=times[len(times) // 2] if times else 0.0,
        tick_p99_us=times[min(len(times) - 1, len(times) * 99 // 100)] if times else 0.0,
        cpu_s=usage.ru_utime + usage.ru_stime, rss_mb=memory_mb(),
        refused=dict(node.refused), dropped=node.inbox.dropped(), version=VERSION,
        config_hash=config_hash(node.service.config), waiting_for=waiting_for,
        late=dict(node.ages.late), silences=dict(node.ages.longest), trouble=sendable(node.service.trouble),
    )  # fmt: skip


def join_request(node: Patient) -> JoinRequest:
    """Return the request of a service to join the run, by which the driver puts it on its roster."""
    configuration = config_hash(node.service.config)
    return JoinRequest(service=node.name, instance=node.instance, version=VERSION, config_hash=configuration)
