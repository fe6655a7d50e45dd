"""Queries of a node: each request gets a reply, a typed error at worst."""

import threading
from concurrent.futures import Future
from typing import Any

import pytest

from surefoot.bus.codec import decode
from surefoot.bus.memory import MemoryBus, MemoryIncoming
from surefoot.errors import CallError, Refusal
from surefoot.lockstep import answers
from surefoot.lockstep.answers import Answers
from surefoot.schemas import topics
from surefoot.schemas.cmd import WalkCommand, WalkReply
from surefoot.schemas.footholds import AssessRequest, SelectReply, SelectRequest
from surefoot.schemas.stability import RegionReply, RegionRequest
from surefoot.schemas.system import Health, HealthRequest
from surefoot.schemas.topics import Query
from tests.surefoot.expect import expect_error
from tests.surefoot.lockstep.node_bench import MEGABYTE, SELECT, Bench


class Asked(MemoryIncoming):
    """A query whose request comes as bytes."""

    def __init__(self, query: Query[Any, Any], payload: bytes, encoding: str = "") -> None:
        super().__init__(query, None)
        self.probe = False
        self._payload, self._encoding = payload, encoding

    def request(self) -> Any:
        return decode(self.query.request, self._payload, None, self._encoding)


@pytest.mark.parametrize(
    ("payload", "encoding", "code", "field"),
    [
        (b"{", "", "malformed", None),
        (b"[]", "", "invalid", None),
        (b"{}", "", "invalid", "contacts"),
        (b'{"contacts":[],"friction":1}', "", "invalid", "friction"),
        (b'{"contacts":[{"position":[0,0,0],"normal":[0,0,1],"mu":-1}]}', "", "invalid", "contacts.0.mu"),
        (b'{"contacts":[{"position":[0,0,NaN],"normal":[0,0,1],"mu":1}]}', "", "invalid", "contacts.0.position.2"),
        (b'{"contacts":"' + b"x" * 10 * MEGABYTE + b'"}', "", "too_large", None),
        (b'{"contacts":[]}', "application/json;surefoot/RegionRequest/2.0", "schema", None),
        (b'{"contacts":[]}', "application/json;surefoot/CheckRequest/1.0", "schema", None),
    ],
    ids=["cut", "list", "missing", "unknown", "negative", "nan", "10 MB", "major", "name"],
)
def test_bad_request_gets_a_typed_error(
    bench: Bench, payload: bytes, encoding: str, code: str, field: str | None
) -> None:
    asked = Asked(topics.STABILITY_REGION, payload, encoding)
    bench.node.handle(asked)
    assert asked.error is not None
    reply = asked.error.reply()
    assert (reply.code, reply.field) == (code, field)
    assert len(reply.message) < 400
    assert bench.node.refused == {code: 1}
    again = Asked(topics.STABILITY_REGION, b'{"contacts":[]}')
    bench.node.handle(again)
    assert isinstance(again.answer, RegionReply)


@pytest.mark.parametrize(
    ("query", "payload", "field"),
    [
        (topics.CMD_WALK, b'{"action": "stand", "at_tick": 100000000000000000000}', "at_tick"),
        (topics.SIM_STEP, b'{"ticks": 1000000001}', "ticks"),
        (topics.SIM_PAUSE, b'{"at_tick": 1000000001}', "at_tick"),
    ],
    ids=["walk", "step", "pause"],
)
def test_a_tick_that_no_run_reaches_is_refused(query: Query[Any, Any], payload: bytes, field: str) -> None:
    refused: list[str] = []
    gate = Answers(lambda late: None, lambda code, text: refused.append(code))
    asked = Asked(query, payload)
    assert gate.request(asked) is None
    assert asked.error is not None
    assert (asked.error.reply().code, asked.error.reply().field, refused) == ("range", field, ["range"])
    allowed = Asked(
        query, payload.replace(b"100000000000000000000", b"1000000000").replace(b"1000000001", b"1000000000")
    )
    assert gate.request(allowed) is not None


def test_a_handler_that_fails_answers_internal_and_the_node_lives(bench: Bench) -> None:
    def broken(request: RegionRequest) -> RegionReply:
        raise ZeroDivisionError("no feet")

    bench.subject.answer = broken
    with expect_error(CallError, "internal", text="no feet"):
        bench.bus.call(topics.STABILITY_REGION, RegionRequest(contacts=()), instance=bench.node.instance)
    assert bench.node.refused == {"internal": 1}
    bench.both(0)
    assert bench.subject.ticks == [0]


def test_a_handler_that_refuses_is_heard_under_its_own_code(bench: Bench) -> None:
    def refuses(request: RegionRequest) -> RegionReply:
        raise Refusal("refused", "not today", "contacts")

    bench.subject.answer = refuses
    with pytest.raises(CallError) as caught:
        bench.bus.call(topics.STABILITY_REGION, RegionRequest(contacts=()), instance=bench.node.instance)
    assert (caught.value.code, caught.value.message, caught.value.field) == ("refused", "not today", "contacts")
    assert bench.node.refused == {"refused": 1}


def test_an_answer_from_another_thread_comes_when_it_is_there(bench: Bench) -> None:
    """Meanwhile ticks and other queries go on; what the thread raises is answered like any other error."""
    work: list[Future[RegionReply]] = [Future(), Future(), Future()]
    pending = iter(work)
    bench.subject.answer = lambda request: next(pending)
    late = [MemoryIncoming(topics.STABILITY_REGION, RegionRequest(contacts=())) for _ in work]
    for incoming in late:
        bench.node.handle(incoming)
    bench.both(0)
    assert bench.subject.ticks == [0]
    assert bench.bus.call(topics.HEALTH_GET.of("estimator"), HealthRequest()).health.service == "estimator"
    assert [incoming.answer for incoming in late] == [None] * 3
    reply = RegionReply(status="infeasible", inner=(), outer=(), support=())
    work[1].set_exception(Refusal("refused", "not today", "contacts"))
    work[2].set_exception(ZeroDivisionError("no feet"))
    worker = threading.Thread(target=work[0].set_result, args=(reply,))
    worker.start()
    while bench.node.pump_once():  # waits for what is being worked out, then has nothing left to do
        pass
    assert late[0].answer is reply
    assert [incoming.error.code for incoming in late[1:] if incoming.error is not None] == ["refused", "internal"]
    worker.join()


def test_a_request_for_a_tick_waits_until_it_is_consumed(bench: Bench) -> None:
    bench.both(0)
    asked = MemoryIncoming(topics.FOOTHOLDS_SELECT, SelectRequest.model_validate({"tick": 1, "epoch": 1, **SELECT}))
    bench.node.handle(asked)
    assert asked.answer is None
    bench.both(1)
    assert isinstance(asked.answer, SelectReply)
    assert asked.answer.map_version == 2
    at_once = MemoryIncoming(topics.FOOTHOLDS_SELECT, SelectRequest.model_validate({"tick": 1, **SELECT}))
    bench.node.handle(at_once)
    assert at_once.answer is not None


def test_the_same_request_of_a_tick_is_handled_once(bench: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    """Its first answer was lost on the way; a new tick or another request is handled."""
    bench.both(0)
    handled: list[Any] = []
    original = bench.node.service.handlers[topics.FOOTHOLDS_SELECT.key]
    monkeypatch.setitem(
        bench.node.service.handlers,
        topics.FOOTHOLDS_SELECT.key,
        lambda request: (handled.append(request), original(request))[1],
    )

    def ask(participant: bool = True, **fields: Any) -> Any:
        request = SelectRequest.model_validate({**SELECT, **fields})
        asked = MemoryIncoming(topics.FOOTHOLDS_SELECT, request, participant=participant)
        bench.node.handle(asked)
        return asked.answer

    assert ask(tick=0, epoch=1) == ask(tick=0, epoch=1) is not None
    assert len(handled) == 1
    assert ask(False, tick=0, epoch=1) == ask(False, tick=0, epoch=1) is not None
    assert len(handled) == 3, "a client that asks again wants to know what holds now"
    bench.both(1)
    for fields in ({"tick": 1, "epoch": 1}, {"tick": 0, "epoch": 1}, {}, {}):
        assert ask(**fields) is not None
    assert len(handled) == 6, "what was answered of tick 0 is answered the same"


def test_the_same_order_for_a_tick_is_carried_out_once() -> None:
    """Its first answer was lost on the way; one that names no tick, or of a client, is another order."""
    found, made = Answers(lambda late: None, lambda reason, detail: None), list[int]()

    def order(participant: bool, at_tick: int | None) -> Any:
        request = WalkCommand(action="walk", distance=0.1, at_tick=at_tick)
        asked = MemoryIncoming(topics.CMD_WALK, request, participant=participant)
        found.settle(asked, lambda: (made.append(1), WalkReply(accepted=True, id=len(made)))[1], request)
        return asked.answer

    first = order(True, 50)
    assert order(True, 50) == first
    assert len(made) == 1
    order(True, 55)  # of another process, before the first repeats once more
    assert order(True, 50) == first
    assert made.pop() == 1
    for participant, at_tick in ((True, 60), (True, None), (True, None), (False, 60), (False, 60)):
        order(participant, at_tick)
    assert len(made) == 6


def test_an_answer_of_the_last_run_is_not_given_again() -> None:
    """A new driver counts its epochs from 1 again, and the same walk sends the same requests."""
    found = Answers(lambda late: None, lambda reason, detail: None)
    request = SelectRequest.model_validate({"tick": 0, "epoch": 1, **SELECT})
    made: list[int] = []

    def make() -> Any:
        made.append(1)
        return SelectReply.model_construct()

    for runs in (1, 2):
        for _ in range(2):
            found.settle(MemoryIncoming(topics.FOOTHOLDS_SELECT, request, participant=True), make, request)
        assert len(made) == runs
        found.begin()


def test_a_request_for_a_tick_that_does_not_come_is_not_ready(bench: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    bench.both(0)
    asked = MemoryIncoming(topics.FOOTHOLDS_SELECT, SelectRequest.model_validate({"tick": 10**6, "epoch": 1, **SELECT}))
    bench.node.handle(asked)
    bench.node.timers()
    assert asked.error is None
    monkeypatch.setattr(answers, "NOT_READY_S", 0.0)
    bench.node.timers()
    assert asked.error is not None
    assert asked.error.code == "not_ready"


def test_probe_is_answered_without_a_request(bench: Bench) -> None:
    asked: list[object] = []
    bench.subject.answer = asked.append  # type: ignore[assignment]
    incoming = MemoryIncoming(topics.STABILITY_REGION, None)
    bench.node.handle(incoming)
    assert incoming.answer is None
    assert incoming.error is None
    assert asked == []


def test_nobody_there_and_nobody_answers() -> None:
    bus = MemoryBus()
    with expect_error(CallError, "absent"):
        bus.call(topics.STABILITY_REGION, RegionRequest(contacts=()))
    bus.serve(topics.STABILITY_REGION, lambda incoming: None, instance="s")
    bus.announce("stability", "s")
    with expect_error(CallError, "timeout"):
        bus.call(topics.STABILITY_REGION, RegionRequest(contacts=()))


def test_a_call_within_a_tick_goes_only_to_the_roster(bench: Bench) -> None:
    request = AssessRequest.model_construct()
    with expect_error(CallError, "absent"):
        bench.node.call(topics.FOOTHOLDS_ASSESS, request, None)
    with pytest.raises(ValueError, match="does not declare"):
        bench.node.call(topics.STABILITY_REGION, RegionRequest(contacts=()), None)


def test_health_is_asked_like_any_query_and_counts_refusals_by_name(bench: Bench) -> None:
    bench.raw(topics.HW_IMU, b"{")
    health: Health = bench.bus.call(topics.HEALTH_GET.of("estimator"), topics.HEALTH_GET.request()).health
    assert health.refused == {"malformed": 1}
    assert health.instance == bench.node.instance
    assert health.state == "joining"
