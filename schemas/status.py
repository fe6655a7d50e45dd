"""State of simulated time, as every driver publishes and answers it."""

from typing import ClassVar, Literal

from pydantic import Field

from .base import Message, Request


class SimStatus(Message):
    """State of the simulation: each second of wall time, each second of simulated time, and at once when it changes."""

    schema_version: ClassVar[str] = "1.3"
    state: Literal["idle", "joining", "running", "paused", "holding", "ended"] = Field(description="of the lockstep")
    rtf: float = Field(ge=0, description="simulated over wall time since the last status (not reproducible)")
    ticks: int = Field(ge=0, description="control ticks since the epoch began")
    comparable: bool = Field(description="false after a time-out, a restart, or a degraded tick")
    missing: tuple[str, ...] = Field(default=(), description="services awaited")
    detail: str = Field(default="", description="in words")
    stopped: str = Field(default="", description="reason of the emergency stop in force; empty = none is")
    failed: str = Field(default="", description="why the physics of this run means nothing any more; empty = it does")
    mode: Literal["lockstep", "paced"] = Field(default="lockstep", description="how time runs")
    pace: float = Field(default=0, ge=0, description="real-time factor that is asked for, 0 = as fast as it goes")
    late: bool = Field(
        default=False, description="true: since the last status paced time could not keep its pace; rtf is what it had"
    )
    held: str = Field(default="", description="why the joints are held instead of commanded; empty = they are not")


class StatusRequest(Request):
    """Asks the driver for the state of simulated time and of the run."""
