"""Rows of `surefoot status`: services with their live numbers, and the state of simulated time."""

from typing import Any

from surefoot.schemas.status import SimStatus
from surefoot.schemas.system import Health
from surefoot.simtime import pace

NUMBERS = (
    "tick",
    "tick_p50_us",
    "tick_p99_us",
    "cpu_s",
    "rss_mb",
    "refused",
    "dropped",
    "late",
    "waiting_for",
    "trouble",
)
TIME = ("state", "rtf", "pace", "late", "held", "tick")


def health_row(health: Health) -> dict[str, Any]:
    """Return the health message of a service as a row of `surefoot status`."""
    return {"doing": health.state, **{name: getattr(health, name) for name in NUMBERS}}


def time_row(status: SimStatus) -> dict[str, Any]:
    """Return the state of simulated time as a row of `surefoot status`, in numbers and words."""
    return {**{name: getattr(status, name) for name in TIME}, "words": pace(status)}
