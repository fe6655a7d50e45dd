"""A process that cannot start a thread or copy a request for lack of memory goes on."""

import threading
from types import SimpleNamespace
from typing import Any

import pytest

from surefoot.bus.mesh import Mesh
from surefoot.bus.replies import Replies
from surefoot.bus.sizes import MAX_BULK_BYTES, MAX_JSON_BYTES
from surefoot.bus.zenoh import ZenohIncoming
from surefoot.errors import Refusal
from surefoot.schemas.base import BulkRequest
from surefoot.schemas.topics import CMD_WALK, QUERIES
from tests.surefoot.net import WAIT_S


@pytest.fixture
def no_threads(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Threads that could not be started; the first start fails."""
    failed, start = list[str](), threading.Thread.start

    def fails_once(thread: threading.Thread) -> None:
        if failed:
            start(thread)
            return
        failed.append(thread.name)
        raise RuntimeError("can't start new thread")

    monkeypatch.setattr(threading.Thread, "start", fails_once)
    return failed


def test_replies_are_sent_by_a_thread_that_starts_later(no_threads: list[str]) -> None:
    replies, first, second = Replies(), threading.Event(), threading.Event()
    assert replies.put(first.set, lambda: None, 1)
    assert no_threads == ["replies"]
    replies.finish(0.0)
    assert replies.put(second.set, lambda: None, 1)
    assert first.wait(WAIT_S)
    assert second.wait(WAIT_S)


def test_links_are_checked_at_the_next_look_and_the_end_is_in_order(no_threads: list[str]) -> None:
    checked = threading.Event()

    def visible() -> set[str]:
        checked.set()
        return {"a"}

    mesh = Mesh(lambda: {"a"}, visible, set, lambda over: None)
    assert mesh.look() == []
    assert no_threads == ["mesh"]
    mesh.settle()
    assert mesh.look() == []
    assert checked.wait(WAIT_S)
    mesh.close()


class Payload:
    """Payload of so many bytes, of which no copy can be made."""

    def __init__(self, size: int) -> None:
        self.size = size

    def __len__(self) -> int:
        return self.size

    def to_bytes(self) -> bytes:
        raise MemoryError


def test_a_request_larger_than_any_legal_one_is_refused_before_it_is_copied() -> None:
    bulk = next(query for query in QUERIES if issubclass(query.request, BulkRequest))
    attachment = SimpleNamespace(to_bytes=lambda: b"{}")
    for query, given, most in (
        (CMD_WALK, None, MAX_JSON_BYTES),
        (CMD_WALK, attachment, MAX_JSON_BYTES),
        (bulk, None, MAX_JSON_BYTES),
        (bulk, attachment, MAX_BULK_BYTES),
    ):

        def of(size: int, query: Any = query, given: Any = given) -> ZenohIncoming:
            asked: Any = SimpleNamespace(payload=Payload(size), encoding=None, attachment=given)
            return ZenohIncoming(query, query.key, asked, "")

        with pytest.raises(Refusal) as caught:
            of(most + 1).request()
        assert caught.value.code == "too_large"
        with pytest.raises(MemoryError):
            of(most).request()
