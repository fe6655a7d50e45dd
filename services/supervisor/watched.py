"""The system around the supervisor, as far as the supervisor needs it."""

from typing import Protocol

from surefoot.schemas.system import ServiceStatus


class Watched(Protocol):
    """Processes of a system, which the supervisor watches."""

    name: str

    def heard(self, service: str, pid: int, *, well: bool) -> None:
        """Note a heartbeat of a service's process."""

    def ticked(self, owner: str) -> None:
        """Note that what a service publishes came in a tick."""

    def signal_kill(self, service: str) -> None:
        """End a service without warning."""

    def rows(self) -> tuple[ServiceStatus, ...]:
        """Return the state of every service."""
        ...
