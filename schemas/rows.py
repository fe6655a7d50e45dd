"""Rows of the table of topics and queries: delivery, rate and owner of a key, typed by the model it carries."""

from dataclasses import dataclass, field, replace
from enum import Enum
from functools import cached_property
from importlib import import_module
from typing import Generic, NamedTuple, TypeVar

from .base import Message, Request, Wire

M = TypeVar("M", bound=Message)
Req = TypeVar("Req", bound=Request)
Rep = TypeVar("Rep", bound=Wire)
Wired = TypeVar("Wired", bound=Wire)

TICK_NS = 10_000_000
"""Length of a control tick, ns."""
TICK_S = TICK_NS / 1e9
"""Length of a control tick, s."""
TICK_HZ = 1e9 / TICK_NS
"""Rate of control ticks, Hz."""
MOST_TICKS = 10**9
"""Number of control ticks that no run reaches (115 days); a request that names a larger one is refused."""


class ModelPlace(NamedTuple):
    """Place where a model of messages is defined; its file is imported when a row first needs the model."""

    file: str
    name: str


class ModelPlaces:
    """Access to the models of a file in `schemas/` as attributes of type `ModelPlace`, without its import."""

    def __init__(self, file: str) -> None:
        self._file = file

    def __getattr__(self, name: str) -> ModelPlace:
        """Return the place of the model whose name is that of the attribute."""
        return ModelPlace(self._file, name)


def _imported(model: type[Wired]) -> type[Wired]:
    place: object = model
    return getattr(import_module(f"{__package__}.{place.file}"), place.name) if isinstance(place, ModelPlace) else model


class Kind(Enum):
    """Delivery of a topic, which the bus maps to Zenoh's quality of service."""

    SAMPLE = "sample"  # hw/*: released by the driver, listed in the tick's manifest
    STATE = "state"  # periodic output of a function service
    COMMAND = "command"  # to the driver
    LATCHED = "latched"  # one value per epoch or version
    LOCKSTEP = "lockstep"  # the protocol's own
    STATUS = "status"  # wall-clock, for people
    ALARM = "alarm"  # must arrive, at once, from any participant


@dataclass(frozen=True)
class Topic(Generic[M]):
    """Row of the table of topics: key, model of the messages, kind of delivery, owner, rate."""

    key: str
    carries: type[M]
    """Model of the messages, or the place where it is defined, which `model` resolves."""
    kind: Kind
    owner: str
    """Name of the publishing service; ``driver`` is the simulator or a hardware driver; ``*`` = every service publishes
    its own."""
    rate_hz: float = TICK_HZ
    """Messages per second of simulated time, of wall time for a STATUS topic; 0 = published on events, without a
    period."""
    own_rate: str = ""
    """Place where a robot may state another rate, in words; empty = the rate is the same for every robot."""
    observers_only: bool = False
    """True if the topic is published after the tick's frame and in batches: recorder and supervisor may read it,
    services that act may not. False: any service may read it."""
    deterministic: bool = True
    """True if the topic is recorded and part of the run hash (same seed, same bytes), False if it is not in the
    hash."""
    period_ns: int = field(init=False, default=0)
    """Simulated time between two messages, ns; 0 = the topic is published on events, or its rate is in wall time."""
    period_ticks: int = field(init=False, default=0)
    """Control ticks between two messages; 0 = a SAMPLE topic, which the driver releases, or no period in simulated
    time."""
    wall_period_s: float = field(init=False, default=0.0)
    """Wall time between two messages of a STATUS topic, s; 0 = published on events, or a topic of another kind."""

    @cached_property
    def model(self) -> type[M]:
        """Model of the topic's messages."""
        return _imported(self.carries)

    def __post_init__(self) -> None:
        if self.rate_hz == 0.0:
            return
        if self.kind is Kind.STATUS:
            object.__setattr__(self, "wall_period_s", 1.0 / self.rate_hz)
            return
        object.__setattr__(self, "period_ns", round(1e9 / self.rate_hz))
        if self.kind is not Kind.SAMPLE:
            ticks, rest = divmod(self.period_ns, TICK_NS)
            if rest:
                raise ValueError(f"topic {self.key!r} must come every n-th tick of 10 ms, got {self.rate_hz:g} Hz")
            object.__setattr__(self, "period_ticks", ticks)

    def of(self, service: str) -> "Topic[M]":
        """Return the topic of one ``service`` from the row of a family of topics, whose key ends in ``/*``."""
        if not self.key.endswith("/*"):
            raise ValueError(f"topic {self.key!r} is not a family; families end in '/*'")
        return replace(self, key=f"{self.key[:-1]}{service}", owner=service)

    @property
    def framed(self) -> bool:
        """True if messages of the topic travel to participants in the frame that their owner publishes once a tick."""
        return self.kind in (Kind.SAMPLE, Kind.STATE, Kind.COMMAND) or self.key == TICK_KEY

    @property
    def signed(self) -> bool:
        """True if messages of the topic name the process that published them, so that those of others are refused."""
        return self.framed or self.kind is Kind.LATCHED

    def due(self, tick: int) -> bool:
        """Return whether a topic with a period in ticks carries a message in ``tick``."""
        return self.period_ticks > 0 and tick % self.period_ticks == 0


TICK_KEY = "hw/tick"
"""Key of the topic with the manifest of a tick, the only LOCKSTEP topic that is part of a frame."""


@dataclass(frozen=True)
class Query(Generic[Req, Rep]):
    """Row of the table of queries: key, models of request and reply, owner."""

    key: str
    takes: type[Req]
    """Model of the requests, or its place (file and name of the model), which `request` imports."""
    returns: type[Rep]
    """Model of the replies, or its place (file and name of the model), which `reply` imports."""
    owner: str
    timeout_s: float = 5.0
    """Default time after which a caller gives up waiting for the reply, s of wall time."""
    acts: bool = False
    """True if the query changes state: it then refuses an empty request, because a wildcard `get` sends one to every
    key. False: it only reads, and an empty request asks for its defaults."""

    @cached_property
    def request(self) -> type[Req]:
        """Model of the query's requests."""
        return _imported(self.takes)

    @cached_property
    def reply(self) -> type[Rep]:
        """Model of the query's replies."""
        return _imported(self.returns)

    def of(self, service: str) -> "Query[Req, Rep]":
        """Return the query of one ``service`` from the row of a family of queries, whose key ends in ``/*``."""
        if not self.key.endswith("/*"):
            raise ValueError(f"query {self.key!r} is not a family; families end in '/*'")
        return replace(self, key=f"{self.key[:-1]}{service}", owner=service)
