"""Requests of a service in the course of a tick: in lockstep their answer depends on no limit of wall time."""

from collections.abc import Callable
from typing import Any

import pytest

from surefoot.bus.codec import encode
from surefoot.bus.frame import Frame, FramePart, pack
from surefoot.bus.inbox import Inbox
from surefoot.bus.interface import Life, Stamp
from surefoot.bus.memory import MemoryBus
from surefoot.errors import CallError
from surefoot.lockstep import patience
from surefoot.lockstep.binding import Bindings
from surefoot.lockstep.join import DRIVER
from surefoot.lockstep.links import Links
from surefoot.lockstep.patience import LOCKSTEP_ANSWER_S, TRY_S, Patience
from surefoot.schemas.hw import Tick
from surefoot.schemas.sim import PauseRequest
from surefoot.schemas.stability import RegionReply, RegionRequest
from surefoot.schemas.topics import HW_TICK, SIM_PAUSE, STABILITY_REGION
from tests.surefoot.expect import expect_error

REQUEST = RegionRequest(contacts=(), directions=16)
REPLY = RegionReply(status="infeasible", inner=(), outer=(), support=())


class Slow(MemoryBus):
    """A bus whose server fails some times with a code before it answers."""

    apart = True

    def __init__(self, code: str, failures: int) -> None:
        super().__init__()
        self.code, self.failures = code, failures
        self.limits: list[float | None] = []
        self.others: dict[str, RegionReply] = {}
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
        if instance in self.others:
            return self.others[instance]
        assert instance == "s"
        if timeout_s is not None and meanwhile is not None:
            meanwhile()
        self.limits.append(timeout_s)
        if len(self.limits) <= self.failures:
            raise CallError(self.code, "")
        return REPLY


def patient(bus: MemoryBus, beats: list[int], *, stopping: bool = False, sealed: bool = False) -> tuple[Links, Inbox]:
    bindings, inbox = Bindings(lambda service, instance: int(sealed)), Inbox()
    for service in ("simulator", "stability", DRIVER):
        bindings.on_life(Life(service, "s", True))
        bindings.bind(service, "s")
    return Links(bus, bindings, Patience(inbox, bindings, lambda: beats.append(1), lambda: stopping)), inbox


def links(bus: MemoryBus, beats: list[int]) -> Links:
    return patient(bus, beats)[0]


def tick(mode: str, *roster: str, number: int = 3, epoch: int = 1) -> Tick:
    fields = {"tick": number, "epoch": epoch, "source": "driver", "roster": roster, "roster_version": 1, "due": ()}
    return Tick.model_validate({**fields, "mode": mode})


@pytest.fixture(autouse=True)
def no_pause(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(patience, "AGAIN_S", 0.0)


@pytest.mark.parametrize("code", ["not_ready", "absent", "timeout"])
def test_in_lockstep_a_process_out_of_reach_or_behind_is_asked_until_it_answers(code: str) -> None:
    bus, beats = Slow(code, failures=3), list[int]()
    assert links(bus, beats).call(STABILITY_REGION, REQUEST, 1.0, tick("lockstep", "stability")) == REPLY
    assert bus.limits == [TRY_S] * 4, "not the second that the caller would wait"
    assert len(beats) >= 4, "it gives signs of life meanwhile"


def test_a_query_that_the_network_forgot_is_sent_again_before_patience_ends() -> None:
    assert TRY_S <= LOCKSTEP_ANSWER_S / 3


def test_the_driver_is_asked_again_though_it_is_on_no_roster() -> None:
    bus = Slow("absent", failures=3)
    bus.serve(SIM_PAUSE, lambda incoming: None, instance="s")
    asking, inbox = patient(bus, [])
    inbox.put(frame_of(tick("lockstep", "stability", number=4)))
    assert asking.call(SIM_PAUSE, PauseRequest(at_tick=9), None, tick("lockstep", "stability")) == REPLY
    assert len(bus.limits) == 4


def test_a_refusal_is_an_answer() -> None:
    bus = Slow("refused", failures=1)
    with expect_error(CallError, "refused"):
        links(bus, []).call(STABILITY_REGION, REQUEST, 1.0, tick("lockstep", "stability"))
    assert len(bus.limits) == 1


def test_patience_ends(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(patience, "LOCKSTEP_ANSWER_S", 0.0)
    with expect_error(CallError, "not_ready"):
        links(Slow("not_ready", 10**6), []).call(STABILITY_REGION, REQUEST, 1.0, tick("lockstep", "stability"))


def test_a_new_process_is_asked_whose_token_has_come_meanwhile() -> None:
    bus = Slow("absent", failures=10**6)
    asking, inbox = patient(bus, [])
    inbox.put(Life("stability", "s", False))
    inbox.put(Life("stability", "new", True))
    bus.serve(STABILITY_REGION, lambda incoming: None, instance="new")
    bus.others["new"] = REPLY
    assert asking.call(STABILITY_REGION, REQUEST, 1.0, tick("lockstep", "stability")) == REPLY
    assert len(inbox.tick.items) == 2, "the node gets them, too"


def frame_of(message: Tick, instance: str = "s") -> Frame:
    stamp = Stamp(message.tick, message.epoch, message.stamp_ns, message.seq)
    return Frame(DRIVER, {HW_TICK.key: HW_TICK}, *pack([FramePart(HW_TICK.key, encode(message)[0], stamp)], instance))


@pytest.mark.parametrize(
    ("newest", "why"),
    [
        (tick("lockstep", "stability", number=-1, epoch=2), "run 2 begins"),
        (tick("lockstep", "walker", number=4), "stability has left the roster"),
    ],
)
def test_the_wait_ends_when_nobody_needs_the_answer(newest: Tick, why: str) -> None:
    asking, inbox = patient(Slow("timeout", failures=10**6), [])
    inbox.put(frame_of(tick("lockstep", "stability", number=4)))
    inbox.put(frame_of(newest))
    inbox.put(frame_of(tick("lockstep", number=9, epoch=7), "stranger"))
    with expect_error(CallError, "absent", text=why):
        asking.call(STABILITY_REGION, REQUEST, 1.0, tick("lockstep", "stability"))


def test_a_forged_manifest_does_not_end_the_wait() -> None:
    asking, inbox = patient(Slow("timeout", failures=2), [], sealed=True)
    inbox.put(frame_of(tick("lockstep", "stability", number=-1, epoch=2)))
    assert asking.call(STABILITY_REGION, REQUEST, 1.0, tick("lockstep", "stability")) == REPLY


def test_a_damaged_frame_does_not_end_the_wait() -> None:
    asking, inbox = patient(Slow("timeout", failures=2), [])
    inbox.put(Frame(DRIVER, {HW_TICK.key: HW_TICK}, b"[{]", b"s;no index"))
    assert asking.call(STABILITY_REGION, REQUEST, 1.0, tick("lockstep", "stability")) == REPLY


def test_a_service_that_is_to_end_waits_for_nobody() -> None:
    asking, _ = patient(Slow("timeout", failures=10**6), [], stopping=True)
    with expect_error(CallError, "absent", text="the service ends"):
        asking.call(STABILITY_REGION, REQUEST, 1.0, tick("lockstep", "stability"))


@pytest.mark.parametrize("within", [tick("paced", "stability"), None])
def test_beside_lockstep_the_callers_limit_holds(within: Tick | None) -> None:
    bus, beats = Slow("not_ready", failures=1), list[int]()
    with expect_error(CallError, "not_ready"):
        links(bus, beats).call(STABILITY_REGION, REQUEST, 1.0, within)
    assert (bus.limits, beats) == ([1.0], [])


def test_nobody_waits_where_nothing_moves_meanwhile() -> None:
    bus = Slow("timeout", failures=10**6)
    bus.apart = False
    with expect_error(CallError, "timeout"):
        links(bus, []).call(STABILITY_REGION, REQUEST, 1.0, tick("lockstep", "stability"))


@pytest.mark.parametrize("mode", ["lockstep", "paced"])
def test_who_is_not_on_the_roster_is_not_asked(mode: str) -> None:
    bus = Slow("", failures=0)
    with expect_error(CallError, "absent", text="stability is not on the roster"):
        links(bus, []).call(STABILITY_REGION, REQUEST, 1.0, tick(mode, "walker"))
    assert bus.limits == []
