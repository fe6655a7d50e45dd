"""Requests of a service in the course of a tick: in lockstep their answer depends on no limit of wall time."""

from collections.abc import Callable
from typing import Any

import pytest

from surefoot.bus.interface import Life
from surefoot.bus.memory import MemoryBus
from surefoot.errors import CallError
from surefoot.lockstep import links as runtime
from surefoot.lockstep.binding import Bindings
from surefoot.lockstep.links import PATIENCE_S, Links
from surefoot.schemas.hw import Tick
from surefoot.schemas.stability import RegionReply, RegionRequest
from surefoot.schemas.topics import STABILITY_REGION
from tests.surefoot.expect import expect_error

REQUEST = RegionRequest(contacts=(), directions=16)
REPLY = RegionReply(status="infeasible", inner=(), outer=(), support=())


class Slow(MemoryBus):
    """A bus whose server fails some times with a code before it answers."""

    def __init__(self, code: str, failures: int) -> None:
        super().__init__()
        self.code, self.failures = code, failures
        self.limits: list[float | None] = []
        self.serve(STABILITY_REGION, lambda incoming: None, instance="s")

    def call(
        self,
        query: Any,
        request: Any,
        timeout_s: float | None = None,
        *,
        instance: str = "",
        meanwhile: Callable[[], Any] | None = None,
    ) -> Any:
        assert instance == "s"
        if timeout_s is not None and meanwhile is not None:
            meanwhile()
        self.limits.append(timeout_s)
        if len(self.limits) <= self.failures:
            raise CallError(self.code, "")
        return REPLY


def links(bus: MemoryBus, beats: list[int]) -> Links:
    bindings = Bindings()
    bindings.on_life(Life("stability", "s", True))
    return Links(bus, bindings, lambda: beats.append(1))


def tick(mode: str, *roster: str) -> Tick:
    return Tick(tick=3, epoch=1, source="driver", roster=roster, roster_version=1, due=(), mode=mode, seed=0)  # pyright: ignore[reportArgumentType]


def test_in_lockstep_one_that_lacks_the_tick_is_asked_until_it_has_it() -> None:
    bus, beats = Slow("not_ready", failures=3), list[int]()
    assert links(bus, beats).call(STABILITY_REGION, REQUEST, 1.0, tick("lockstep", "stability")) == REPLY
    assert bus.limits == [PATIENCE_S] * 4, "not the second that the caller would wait"
    assert len(beats) == 4, "it gives signs of life meanwhile"


@pytest.mark.parametrize("code", ["timeout", "absent", "refused"])
def test_an_error_that_waiting_does_not_mend_is_raised_at_once(code: str) -> None:
    bus = Slow(code, failures=1)
    with expect_error(CallError, code):
        links(bus, []).call(STABILITY_REGION, REQUEST, 1.0, tick("lockstep", "stability"))
    assert len(bus.limits) == 1


def test_patience_ends(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(runtime, "PATIENCE_S", 0.0)
    bus = Slow("not_ready", failures=10**6)
    with expect_error(CallError, "not_ready"):
        links(bus, []).call(STABILITY_REGION, REQUEST, 1.0, tick("lockstep", "stability"))


@pytest.mark.parametrize("within", [tick("paced", "stability"), None])
def test_beside_lockstep_the_callers_limit_holds(within: Tick | None) -> None:
    bus, beats = Slow("not_ready", failures=1), list[int]()
    with expect_error(CallError, "not_ready"):
        links(bus, beats).call(STABILITY_REGION, REQUEST, 1.0, within)
    assert (bus.limits, beats) == ([1.0], [])


@pytest.mark.parametrize("mode", ["lockstep", "paced"])
def test_who_is_not_on_the_roster_is_not_asked(mode: str) -> None:
    bus = Slow("", failures=0)
    with expect_error(CallError, "absent", text="stability is not on the roster"):
        links(bus, []).call(STABILITY_REGION, REQUEST, 1.0, tick(mode, "walker"))
    assert bus.limits == []
