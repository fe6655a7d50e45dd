"""Large replies: they wait for their thread and not the other way round, a few at most, and a defect silences none."""

import threading

import pytest

from surefoot.bus.replies import BYTES_PER_S, WAITING, Replies
from tests.surefoot.net import WAIT_S


def test_a_reply_that_is_not_taken_holds_nobody_and_few_wait_for_it() -> None:
    replies, began, go = Replies(), threading.Event(), threading.Event()
    sent: list[int] = []

    def stuck() -> None:
        began.set()
        go.wait(WAIT_S)

    assert replies.put(stuck, 1)
    assert began.wait(WAIT_S)
    taken = [replies.put(lambda k=k: sent.append(k), 1) for k in range(WAITING + 3)]
    assert taken == [True] * WAITING + [False] * 3
    assert sent == []
    done = threading.Event()
    go.set()
    while not replies.put(done.set, 1):
        pass
    assert done.wait(WAIT_S)
    assert sent == list(range(WAITING))


def test_a_defect_in_one_reply_does_not_silence_the_next(capfd: pytest.CaptureFixture[str]) -> None:
    replies, done = Replies(), threading.Event()

    def broken() -> None:
        raise ValueError("no bytes")

    assert replies.put(broken, 1)
    assert replies.put(done.set, 1)
    assert done.wait(WAIT_S)
    assert "ValueError: no bytes" in capfd.readouterr().err


def test_links_are_left_free_between_two_replies(monkeypatch: pytest.MonkeyPatch) -> None:
    rests: list[float] = []
    over = threading.Event()
    monkeypatch.setattr("surefoot.bus.replies.sleep", rests.append)
    replies = Replies()
    assert replies.put(lambda: None, 640_000)
    assert replies.put(over.set, 1)
    assert over.wait(WAIT_S)
    assert rests[0] == pytest.approx(640_000 / BYTES_PER_S)
