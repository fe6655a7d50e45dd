"""Replies to clients wait for their threads and not the other way round, a few large ones at most."""

import threading
from typing import Any, ClassVar, Self

import pytest

from surefoot.bus.replies import BYTES_PER_S, LARGE, MOST_SMALL, WAITING, Replies
from surefoot.bus.zenoh import ZenohIncoming
from surefoot.errors import Refusal
from surefoot.schemas.cmd import WalkReply
from surefoot.schemas.topics import CMD_WALK
from tests.surefoot.net import WAIT_S


def nothing() -> None:
    pass


def test_a_reply_that_is_not_taken_holds_nobody_and_few_wait_for_it() -> None:
    replies, began, go = Replies(), threading.Event(), threading.Event()
    sent: list[int] = []

    def stuck() -> None:
        began.set()
        go.wait(WAIT_S)

    assert replies.put(stuck, nothing, LARGE)
    assert began.wait(WAIT_S)
    taken = [replies.put(lambda k=k: sent.append(k), nothing, LARGE) for k in range(WAITING + 3)]
    assert taken == [True] * WAITING + [False] * 3
    assert sent == []
    small, done = threading.Event(), threading.Event()
    assert replies.put(small.set, nothing, LARGE - 1)  # small ones do not wait for large ones
    assert small.wait(WAIT_S)
    go.set()
    while not replies.put(done.set, nothing, LARGE):
        pass
    assert done.wait(WAIT_S)
    assert sent == list(range(WAITING))


def test_a_defect_in_one_reply_does_not_silence_the_next(capfd: pytest.CaptureFixture[str]) -> None:
    replies, done = Replies(), threading.Event()

    def broken() -> None:
        raise ValueError("no bytes")

    assert replies.put(broken, nothing, 1)
    assert replies.put(done.set, nothing, 1)
    assert done.wait(WAIT_S)
    assert "ValueError: no bytes" in capfd.readouterr().err


def test_links_are_left_free_between_two_replies(monkeypatch: pytest.MonkeyPatch) -> None:
    rests: list[float] = []
    over = threading.Event()
    monkeypatch.setattr("surefoot.bus.replies.sleep", rests.append)
    replies = Replies()
    assert replies.put(nothing, nothing, 640_000)
    assert replies.put(over.set, nothing, LARGE)
    assert over.wait(WAIT_S)
    assert rests[0] == pytest.approx(640_000 / BYTES_PER_S)


def test_queries_beyond_many_small_replies_are_closed_without_a_reply() -> None:
    replies, began, go, done = Replies(), threading.Event(), threading.Event(), threading.Event()
    ends: list[str] = []

    def stuck() -> None:
        began.set()
        go.wait(WAIT_S)

    assert replies.put(stuck, nothing, 1)
    assert began.wait(WAIT_S)
    for _ in range(MOST_SMALL + 2):
        assert replies.put(lambda: ends.append("sent"), lambda: ends.append("closed"), 1)
    assert replies.put(nothing, done.set, 1)
    go.set()
    assert done.wait(WAIT_S)
    assert ends == ["sent"] * MOST_SMALL + ["closed"] * 2


class Unread:
    """Query of a client whose link is full: whoever answers or closes it is blocked until `go` is set."""

    payload = attachment = encoding = None
    parameters: ClassVar[dict[str, str]] = {}

    def __init__(self, go: threading.Event) -> None:
        self.go, self.ends = go, list[str]()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.go.wait(WAIT_S)
        self.ends.append("closed")

    def reply(self, *_: object, **__: object) -> None:
        self.go.wait(WAIT_S)
        self.ends.append("replied")

    reply_err = reply


@pytest.mark.parametrize("end", ["reply", "refusal", "probe"])
def test_who_answers_a_client_that_does_not_read_is_not_blocked(end: str) -> None:
    replies, go = Replies(), threading.Event()
    asked: Any = Unread(go)
    incoming = ZenohIncoming(CMD_WALK, CMD_WALK.key, asked, "", replies)
    if end == "reply":
        incoming.reply(WalkReply(accepted=True, id=1))
    elif end == "refusal":
        incoming.fail(Refusal("busy", "not now"))
    else:
        incoming.accept_probe()
    assert asked.ends == []
    go.set()
    replies.finish(WAIT_S)
    assert asked.ends == ["replied", "closed"]
