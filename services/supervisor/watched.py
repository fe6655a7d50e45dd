"""Interface between the supervisor service and the processes of the system that it watches."""

from typing import Protocol

from surefoot.schemas.system import ServiceStatus


class Watched(Protocol):
    """Interface of the running processes of a system that the supervisor watches."""

    name: str

    def heard(self, service: str, pid: int, *, well: bool) -> None:
        """Record a heartbeat of a service's process; `well`: it is ready for work."""

    def ticked(self, owner: str) -> None:
        """Record that a message of the service `owner` came in a tick."""

    def signal_kill(self, service: str) -> None:
        """Kill the process of a service at once (SIGKILL)."""

    def rows(self) -> tuple[ServiceStatus, ...]:
        """Return the state of every service."""
        ...
