"""Messages of the runtime itself: lockstep, health, logs, the supervisor's status."""

from typing import Annotated, ClassVar, Literal

from pydantic import Field

from .base import Message, Reply, Request, Wire


class Done(Message):
    """Report of a service that it has finished a tick; ``tick`` -1: all its links are tested, ready to start."""

    instance: str = Field(description="identity of the process: a late done of a dead one must not count")
    ready: bool = Field(default=False, description="true in the answer to PRIME")


class JoinRequest(Request):
    """Asks the driver to put a service on the roster at a tick boundary."""

    service: str = Field(max_length=64, description="name of the service")
    instance: str = Field(max_length=64, description="identity of the process")
    version: str = Field(default="", max_length=64, description="version of the distribution")
    config_hash: str = Field(default="", max_length=64, description="sha256 of the effective configuration")


class JoinReply(Reply):
    """Reply to a service that asks to join: if accepted, the driver tests its links, then puts it on the roster."""

    accepted: bool = Field(description="false: for the reason in `reason`")
    reason: str = Field(default="", description="in words")


class Health(Message):
    """Health of a service, published each second of wall time; ``health/<service>`` is also a queryable."""

    schema_version: ClassVar[str] = "2.3"
    service: str = Field(description="name of the service")
    instance: str = Field(description="identity of the process")
    state: Literal["starting", "compiling", "joining", "ready", "running", "stopping"] = Field(
        description="ready: every link is proved; running: ticks are coming"
    )
    pid: int = Field(ge=0, description="process id")
    kernels: Literal["warm", "compiling", "none"] = Field(default="none", description="state of compiled kernels")
    tick_p50_us: float = Field(default=0, ge=0, description="median time in a tick, us")
    tick_p99_us: float = Field(default=0, ge=0, description="99th percentile of it, us")
    cpu_s: float = Field(default=0, ge=0, description="CPU time of the process, s")
    rss_mb: float = Field(default=0, ge=0, description="memory, MB")
    refused: dict[str, int] = Field(default_factory=dict, description="refusals by reason since start")
    dropped: dict[str, int] = Field(
        default_factory=dict, description="messages and queries for which there was no room by key, at least so many"
    )
    version: str = Field(default="", description="version of the distribution")
    config_hash: str = Field(default="", description="sha256 of the effective configuration")
    late: dict[str, float] = Field(
        default_factory=dict, description="inputs without a new sample for longer than their limit, and their age, s"
    )
    silences: dict[str, float] = Field(
        default_factory=dict, description="inputs that were late in this epoch, and their greatest age, s"
    )
    waiting_for: tuple[str, ...] = Field(default=(), description="links not yet proved, or inputs of the tick awaited")
    trouble: str = Field(default="", description="what the service cannot do although it runs, in words")


class HealthRequest(Request):
    """Asks a service for its health."""


class HealthReply(Reply):
    """Reply of a service to a health request: its present health."""

    schema_version: ClassVar[str] = "2.3"
    health: Health = Field(description="as published on health/<service>")


class ServiceParameter(Wire):
    """Parameter of a service's configuration: name, value, default, and whether it may be changed while it runs."""

    name: str = Field(description="name, as in the configuration file")
    value: str = Field(description="present value, as JSON")
    default: str = Field(description="default, as JSON")
    live: bool = Field(description="may be changed while the service runs")
    meaning: str = Field(description="unit and meaning")


class ConfigRequest(Request):
    """Asks a service for its configuration."""


class ConfigReply(Reply):
    """Reply of a service to a configuration request: its parameters."""

    parameters: tuple[ServiceParameter, ...] = Field(description="all of them, after the change if one was asked for")
    config_hash: str = Field(description="sha256 of the effective configuration")


class ConfigureRequest(Request):
    """Changes live parameters of a service between two ticks, all or none; a restart brings the old ones back."""

    values: dict[str, Annotated[str, Field(max_length=4096)]] = Field(
        max_length=64, description="new values by name of the parameter, written as in the environment: 0.5, true, imu"
    )


class LogRecord(Message):
    """Line of a service's log, as published on ``log/<service>``."""

    level: Literal["debug", "info", "warning", "error"] = Field(description="severity")
    text: str = Field(max_length=4096, description="the line")


class RecorderRequest(Request):
    """Asks the recorder for its file and the hash so far."""


class RecorderReply(Reply):
    """Reply of the recorder: file and state of the present recording."""

    schema_version: ClassVar[str] = "1.1"
    path: str = Field(description="file that is written")
    epoch: int = Field(ge=0, description="epoch of the recording")
    tick: int = Field(ge=-1, description="last tick on disk")
    messages: int = Field(ge=0, description="messages written")
    finished: bool = Field(description="the last tick of the run is on disk and the file is closed")
    run_hash: str = Field(default="", description="sha256 over all deterministic topics, once finished")
    trouble: str = Field(default="", description="why nothing more is written in this run, in words")


class SaveRequest(Request):
    """Asks a recorder with ``ring_s`` to write the last seconds into a file."""

    reason: str = Field(
        default="request", pattern="^[a-z0-9_]{1,32}$", description="part of the file's name: small letters, digits, _"
    )


class SaveReply(Reply):
    """File that the recorder has written on request."""

    path: str = Field(description="file on the machine of the recorder")
    messages: int = Field(ge=0, description="messages in it")


class ServiceStatus(Message):
    """State of one service in the supervisor's status."""

    service: str = Field(description="name of the service")
    state: str = Field(description="stopped, starting, healthy, unhealthy, backoff, failed")
    pid: int | None = Field(default=None, description="process id while it lives")
    restarts: int = Field(default=0, ge=0, description="restarts since up")
    detail: str = Field(default="", description="in words")


class SupervisorStatus(Message):
    """Services as the supervisor sees them, and the state of the run."""

    system: str = Field(description="name of the compose file's system")
    services: tuple[ServiceStatus, ...] = Field(description="one row per service")
    scenario: str | None = Field(default=None, description="name of the running scenario")
    detail: str = Field(default="", description="in words")
