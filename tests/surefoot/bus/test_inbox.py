"""An inbox wakes its node for what it awaits, and loses nothing."""

import threading
from collections.abc import Callable, Sequence
from functools import partial
from queue import Empty
from typing import Any

import pytest

from surefoot.bus.frame import Frame
from surefoot.bus.inbox import FEW, SMALL_BYTES, Inbox, Lane
from surefoot.bus.interface import Delivery, Raw
from surefoot.lockstep.join import Delayed, Join
from surefoot.schemas.base import Header
from surefoot.schemas.hw import Tick
from surefoot.schemas.topics import HEALTH, HW_IMU, HW_TICK, LOG, STATE_GAIT, STATE_VELOCITY, Topic
from tests.surefoot.lockstep.node_bench import IMU

LONG_S = 80.0


def frame(owner: str) -> Frame:
    return Frame(owner, {}, b"[]", b"")


def got_by_a_sleeper(inbox: Inbox, awaited: set[str], puts: Sequence[Callable[[], object]]) -> bool:
    """Return whether a reader that sleeps is woken by the last of what is put, and by none before."""
    asleep, woken = threading.Event(), threading.Event()

    def read() -> None:
        asleep.set()
        inbox.get(LONG_S, awaited)
        woken.set()

    thread = threading.Thread(target=read, daemon=True)
    thread.start()
    asleep.wait(LONG_S)
    while inbox._awaited is not awaited:  # pyright: ignore[reportPrivateUsage] - it is about to sleep
        pass
    for put in puts[:-1]:
        put()
        assert not woken.wait(0.02)
    puts[-1]()
    return woken.wait(LONG_S / 2.0)  # sooner than the reader would wake by itself


@pytest.mark.parametrize(
    ("awaited", "owners"), [({"driver", "estimator"}, ["driver", "driver", "estimator"]), (set(), ["walker"])]
)
def test_reader_sleeps_until_the_last_awaited_frame(awaited: set[str], owners: list[str]) -> None:
    inbox = Inbox()
    assert got_by_a_sleeper(inbox, awaited, [partial(inbox.put, frame(owner)) for owner in owners])


@pytest.mark.parametrize("topic", [LOG, HEALTH])
def test_queries_and_observed_messages_wake_a_sleeper(topic: Topic[Any]) -> None:
    inbox = Inbox()
    assert got_by_a_sleeper(inbox, {"driver"}, [partial(inbox.put_query, "query")])
    assert got_by_a_sleeper(inbox, {"driver"}, [partial(inbox.put_observed, Delivery(topic, None, Raw(b"", None, "")))])


def test_what_is_no_frame_wakes_at_once() -> None:
    inbox = Inbox()
    inbox.put("query")
    assert inbox.get(LONG_S, {"driver"}) == "query"


def test_what_came_while_the_reader_was_awake_needs_no_bell() -> None:
    inbox = Inbox()
    inbox.put(frame("driver"))
    assert inbox.get(LONG_S, {"driver", "estimator"}).owner == "driver"
    with pytest.raises(Empty):
        inbox.get(0.001, {"estimator"})


def test_nothing_is_lost_between_many_writers_and_one_reader() -> None:
    inbox, per = Inbox(), 2000
    owners = ("driver", "estimator", "walker")
    writers = [threading.Thread(target=lambda o=o: [inbox.put(frame(o)) for _ in range(per)]) for o in owners]
    for writer in writers:
        writer.start()
    seen: list[str] = []
    while len(seen) < per * len(owners):
        try:
            seen.append(inbox.get(0.01, {"driver", "walker"}).owner)
        except Empty:
            continue
    assert {owner: seen.count(owner) for owner in owners} == dict.fromkeys(owners, per)


def test_a_join_awaits_the_owners_of_what_it_lacks() -> None:
    join = Join("stability", (HW_IMU, STATE_VELOCITY, Delayed(STATE_GAIT)))
    assert join.awaited() == set()  # not on the roster: anything may matter
    roster = ("stability", "estimator", "walker")

    def offer(tick: int, mode: str = "lockstep") -> None:
        join.offer(
            HW_TICK,
            Tick(tick=tick, epoch=1, roster=roster, due=("hw/imu",), mode=mode, roster_version=1),  # pyright: ignore[reportArgumentType]
        )
        join.offer(HW_IMU, IMU.stamped(0, tick, 1, tick, "driver"))

    offer(0)
    assert join.awaited() == {"estimator"}
    join.offer(STATE_VELOCITY, Header(tick=0, epoch=1, source="estimator"))
    assert join.awaited() == set()
    assert join.take() is not None
    assert join.awaited() == {"driver", "estimator", "walker"}
    join.offer(STATE_GAIT, Header(tick=0, epoch=1, source="walker"))
    assert join.awaited() == {"driver", "estimator"}
    offer(1)
    assert join.awaited() == {"estimator"}
    join.offer(STATE_VELOCITY, Header(tick=1, epoch=1, source="estimator"))
    offer(2, mode="paced")
    assert join.take() is not None
    join.offer(STATE_VELOCITY, Header(tick=2, epoch=1, source="estimator"))
    join.offer(STATE_GAIT, Header(tick=1, epoch=1, source="walker"))
    assert join.take() is not None
    assert join.awaited() == set()  # paced: a tick is taken even if something lacks


@pytest.mark.parametrize("size", [10, SMALL_BYTES + 1])
def test_a_lane_is_bounded_by_count_and_bytes_and_has_room_again(size: int) -> None:
    items, most = 2 * FEW, FEW * (SMALL_BYTES + 1)
    lane = Lane(items, most)
    put = 0
    while lane.put(Frame("driver", {}, b"x" * size, b""), size):
        put += 1
    assert put == (items if size <= SMALL_BYTES else FEW)
    assert lane.dropped == {"frame/driver": 1}
    for _ in range(put):
        assert isinstance(lane.get(), Frame)
    assert len(lane) == 0
    assert all(lane.put(frame("walker"), most) is first for first in (True, False))
