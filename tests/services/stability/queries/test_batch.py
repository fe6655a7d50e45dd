"""`stability/batch`: ten thousand sets in one question, as JSON or as raw numbers, while the robot walks on."""

import json
import threading
import time
from concurrent.futures import Future
from typing import Any

import numpy as np
import pytest

from surefoot.background import MOST_WAITING
from surefoot.bus.codec import decode, encode
from surefoot.bus.memory import MemoryBus, MemoryIncoming
from surefoot.errors import Refusal
from surefoot.lockstep.node import Node
from surefoot.schemas import topics
from surefoot.schemas.hw import Tick
from surefoot.schemas.stability import CheckRequest, StabilityStatus
from surefoot.schemas.whatif import MAX_SETS, BatchReply, BatchRequest
from surefoot.services.stability import workers as module
from surefoot.services.stability.config import StabilityConfig
from surefoot.services.stability.regions import many
from surefoot.services.stability.regions.many import STATUSES, batch, pack
from surefoot.services.stability.service import SERVICE, Stability
from tests.services.stability.sets import SQUARE, UP, feasible_sets
from tests.services.stability.test_service import samples
from tests.surefoot.net import WAIT_S, Net

CALL_S = 120.0  # s wall; takes seconds

FLOOR = [{"position": p, "normal": UP, "mu": 0.5} for p in SQUARE]
BAD = FLOOR[0] | {"normal": (0, 0, 0)}


def raw(count: int) -> tuple[BatchRequest, Any]:
    """A raw request of many uneven stances, and what it should be answered."""
    some = feasible_sets(80, 40, (3, 7))
    sets = [some[k % len(some)] for k in range(count)]
    com = np.array([1.0, 2.0]) + np.random.default_rng(81).uniform(-0.2, 0.2, (count, 2))
    position, normal, mu = (np.concatenate([getattr(s, f) for s in sets]) for f in ("position", "normal", "mu"))
    counts = [len(s) for s in sets]
    data = com.astype("<f8").tobytes() + np.column_stack((position, normal, mu)).astype("<f8").tobytes()
    return BatchRequest(counts=tuple(counts), data=data), batch(pack(position, normal, mu, counts, com))


def matches(reply: BatchReply, expected: Any) -> None:
    assert [r.status for r in reply.results] == [STATUSES[s] for s in expected.status]
    got = np.array([np.nan if r.margin is None else r.margin for r in reply.results])
    assert got.tobytes() == expected.margin.tobytes()
    assert [r.stable for r in reply.results] == expected.stable.tolist()


@pytest.fixture
def node() -> Node:
    """The service on a bus of its own."""
    made = Node(SERVICE(StabilityConfig()), MemoryBus())
    made.start()
    return made


def test_json_and_raw_numbers_get_the_same_answer(node: Node) -> None:
    sets = [
        {"contacts": FLOOR, "com": [0.02, 0.05]},
        {"contacts": [], "com": [0, 0]},
        {"contacts": FLOOR[:1], "com": [0, 0]},
    ]
    handler = node.service.handlers[topics.STABILITY_BATCH.key]

    def answer(data: bytes, header: bytes | None = None) -> BatchReply:
        reply = handler(decode(BatchRequest, data, header))
        return reply.result(WAIT_S) if isinstance(reply, Future) else reply  # one that takes long is answered later

    plain = answer(json.dumps({"sets": sets}).encode())
    numbers = [0.02, 0.05, 0, 0, 0, 0]
    for contact in (*FLOOR, FLOOR[0]):
        numbers += [*contact["position"], *contact["normal"], contact["mu"]]  # type: ignore[misc]
    header = json.dumps({"counts": [4, 0, 1]}).encode()
    assert answer(np.array(numbers, dtype="<f8").tobytes(), header) == plain
    assert [r.status for r in plain.results] == ["ok", "infeasible", "point"]
    assert plain.results[0].margin == pytest.approx(0.05)


def test_unlimited_friction_travels_as_infinity(node: Node) -> None:
    wall = [-1.0, 0.0, 0.0, 1.0, 0.0, 0.0, np.inf]
    request = BatchRequest(counts=(1,), data=np.array([0.0, 0.0, *wall]).astype("<f8").tobytes())
    reply = node.service.handlers[topics.STABILITY_BATCH.key](request)
    assert (reply.results[0].status, reply.results[0].margin) == ("point", -1.0)


@pytest.mark.parametrize(
    ("fields", "code", "field"),
    [
        ({"counts": (1,), "data": b"1234"}, "shape", "data"),
        ({"data": b"12345678"}, "missing", "counts"),
        ({"counts": (0,), "sets": ({"contacts": [], "com": (0, 0)},)}, "unsupported", "sets"),
        ({"counts": (0,), "data": np.array([np.nan, 0.0]).tobytes()}, "not_finite", "sets.0.com"),
        ({"counts": (1,), "data": np.zeros(9).tobytes()}, "zero_normal", "sets.0.contacts.0.normal"),
        ({"sets": ({"contacts": [FLOOR[0], BAD], "com": (0, 0)},)}, "zero_normal", "sets.0.contacts.1.normal"),
    ],
)  # fmt: skip
def test_refused(node: Node, fields: dict[str, Any], code: str, field: str) -> None:
    with pytest.raises(Refusal) as refused:
        node.service.handlers[topics.STABILITY_BATCH.key](BatchRequest.model_validate(fields))
    assert (refused.value.code, refused.value.field) == (code, field)


def test_limits_of_the_schema() -> None:
    with pytest.raises(Refusal) as refused:
        decode(BatchRequest, json.dumps({"counts": [0] * (MAX_SETS + 1)}).encode())
    assert refused.value.field == "counts"
    with pytest.raises(Refusal) as refused:
        decode(BatchRequest, b'{"counts": [65]}')
    assert refused.value.field == "counts.0"


def test_ten_thousand_sets_while_ticks_and_queries_go_on(node: Node) -> None:
    request, expected = raw(MAX_SETS)
    large, bus = MemoryIncoming(topics.STABILITY_BATCH, request), node.bus
    said: list[StabilityStatus] = []
    bus.subscribe(topics.STATE_STABILITY, lambda delivery: said.append(delivery.message()))  # type: ignore[arg-type]
    publish = {topic.key: bus.publisher(topic) for topic in (topics.HW_TICK, topics.HW_JOINTS, topics.HW_CONTACTS)}
    node.handle(large)
    check = CheckRequest.model_validate({"contacts": FLOOR, "com": (0.0, 0.0)})
    meanwhile = 0
    while large.answer is None and large.error is None:
        small = MemoryIncoming(topics.STABILITY_CHECK, check)
        node.handle(small)
        assert small.answer is not None
        if meanwhile < 20:
            tick_all(node, publish, meanwhile)
        meanwhile += large.answer is None
        node.pump()
    assert large.error is None
    assert isinstance(large.answer, BatchReply)
    matches(large.answer, expected)
    assert meanwhile > 3
    assert len(said) >= 2
    assert len(encode(large.answer)[0]) < 1 << 20


def tick_all(node: Node, publish: dict[str, Any], number: int) -> None:
    given = samples(number * topics.TICK_NS)
    for key in ("joints", "contacts"):
        message = given[key].relabelled(number * topics.TICK_NS, number, 1, number, "driver")
        publish[f"hw/{key}"].put(message)
    due = ("hw/joints", "hw/contacts")
    tick = Tick(
        tick=number, stamp_ns=number * topics.TICK_NS, roster=("stability",), roster_version=1, due=due, mode="lockstep"
    )
    publish["hw/tick"].put(tick.relabelled(number * topics.TICK_NS, number, 1, number, "driver"))
    node.pump()


def test_too_many_large_batches_are_refused(node: Node, monkeypatch: pytest.MonkeyPatch) -> None:
    go = threading.Event()
    monkeypatch.setattr(module, "batch_reply", lambda request: go.wait(WAIT_S) and BatchReply(results=()))
    service = node.service
    assert isinstance(service, Stability)
    request = raw(module.AT_ONCE + 1)[0]
    waiting = [service.workers.batch(request) for _ in range(MOST_WAITING)]
    with pytest.raises(Refusal) as refused:
        service.workers.batch(request)
    assert refused.value.code == "busy"
    go.set()
    for answer in waiting:
        assert not isinstance(answer, BatchReply)
        assert answer.result(WAIT_S) == BatchReply(results=())
    assert isinstance(service.workers.batch(request), type(waiting[0]))


def test_over_zenoh() -> None:
    """Raw numbers in, JSON out, through the client's own call; the service's thread is never held up."""
    net = Net()
    try:
        made = Node(SERVICE(StabilityConfig()), net.open())
        made.start()
        thread = threading.Thread(target=made.run, daemon=True)
        thread.start()
        try:
            request, expected = raw(MAX_SETS)
            asker, other = net.open("client"), net.open("client")
            check = CheckRequest.model_validate({"contacts": FLOOR, "com": (0.0, 0.0)})
            until = time.monotonic() + WAIT_S
            for one, wanted in ((other, topics.STABILITY_CHECK), (asker, topics.STABILITY_BATCH)):
                while not one.probe(wanted):
                    assert time.monotonic() < until, f"not found within {WAIT_S:g} s: {wanted.key}"
            answers: list[BatchReply] = []
            caller = threading.Thread(
                target=lambda: answers.append(asker.call(topics.STABILITY_BATCH, request, CALL_S)), daemon=True
            )
            caller.start()
            checks = 0
            while caller.is_alive():
                assert other.call(topics.STABILITY_CHECK, check, CALL_S).margin == pytest.approx(0.1)
                checks += 1
            caller.join()
            matches(answers[0], expected)
            assert checks > 1
        finally:
            made.stop()
            thread.join(WAIT_S)
    finally:
        net.close()


def test_the_first_small_batch_waits_for_its_kernel_aside(monkeypatch: pytest.MonkeyPatch) -> None:
    """Whoever compiles for seconds between two ticks stops the robot."""
    service = Stability(StabilityConfig())
    service.on_start()
    request = raw(1)[0]
    monkeypatch.setattr(many, "loaded", lambda: False)
    later = service.handlers["stability/batch"](request)
    assert isinstance(later, Future)
    monkeypatch.setattr(many, "loaded", lambda: True)
    now = service.handlers["stability/batch"](request)
    assert now == later.result(timeout=300.0)
    service.on_stop()
