"""Inbox of a node: queues that any thread fills, and that wake the node only when it has something to do.

Four queues, each bounded by count and bytes: what a tick needs (frames, commands, changes of liveliness, queries of
participants), heartbeats, queries of others, and messages that are only observed. A full queue refuses new items and
counts them by key.
"""

import threading
from collections import Counter, deque
from contextlib import suppress
from queue import Empty
from typing import Any, NamedTuple

from surefoot.bus.frame import Frame
from surefoot.schemas.topics import HEALTH

_AWAKE = {""}
"""Awaited set of a reader that is awake; it names no service, so no item wakes the reader."""

SMALL_BYTES, FEW = 4096, 256
"""`SMALL_BYTES`: size, bytes, up to which an item is queued without counting its bytes; `FEW`: number of waiting items
from which on the bytes of each item count."""
TICK_ITEMS, TICK_BYTES = 8192, 96 << 20
QUERY_ITEMS, QUERY_BYTES = 256, 96 << 20  # a request may bring a map of 64 MiB
OBSERVED_ITEMS, OBSERVED_BYTES = 256, 4 << 20  # and as much for heartbeats


class _Counted(NamedTuple):
    """Item of the inbox whose bytes count towards its limit."""

    item: Any
    size: int


def plain(item: Any) -> Any:
    """Return an item as it was put into a `Lane`, without the wrapper that counts its bytes."""
    return item.item if type(item) is _Counted else item


class Lane:
    """One bounded queue of an inbox: any thread may add items, one thread takes them."""

    def __init__(self, items: int, size: int) -> None:
        self.items: deque[Any] = deque()
        """Items that wait in this queue, oldest first; a node tests it for emptiness with each message of a tick."""
        self._most, self._most_bytes = items, size
        self._few = min(FEW, items)
        self._put = self._taken = 0
        self._lock = threading.Lock()
        self.dropped: Counter[str] = Counter()
        """Number of messages refused because the queue was full, by key; a lower bound, as the bus may have dropped
        others."""

    def __len__(self) -> int:
        return len(self.items)

    def put(self, item: Any, size: int) -> bool:
        """Queue an item of ``size`` bytes; return False if there is no room. An empty queue takes any item."""
        items = self.items
        if size <= SMALL_BYTES and len(items) < self._few:
            items.append(item)
            return True
        with self._lock:
            if items and (len(items) >= self._most or self._put - self._taken + size > self._most_bytes):
                self.dropped[_key_of(item)] += 1
                return False
            items.append(_Counted(item, size))
            self._put += size
        return True

    def get(self) -> Any:
        """Remove and return the oldest item of the queue (raises IndexError: there is none)."""
        item = self.items.popleft()
        if type(item) is _Counted:
            item, size = item
            self._taken += size  # by the one reader
        return item


class Inbox:
    """Four queues of one reader, the thread of a node.

    A tick needs the frames of several services. The reader is therefore woken by the last of the frames that it awaits,
    not by each of them, and by every item that is not a frame.
    """

    def __init__(self) -> None:
        self._awaited: set[str] = set()
        self.tick = Lane(TICK_ITEMS, TICK_BYTES)
        self.queries = Lane(QUERY_ITEMS, QUERY_BYTES)
        self.observed = Lane(OBSERVED_ITEMS, OBSERVED_BYTES)
        self.heartbeats = Lane(OBSERVED_ITEMS, OBSERVED_BYTES)
        self._bell = threading.Lock()
        self._bell.acquire()

    def put(self, item: Any) -> bool:
        """Add a frame or other item of a tick, from any thread; return False if there is no room.

        It wakes the reader, unless it is a frame and the reader awaits frames of other services.
        """
        frame = isinstance(item, Frame)
        if not self.tick.put(item, item.size if frame else getattr(item, "size", 0)):
            return False
        if frame:
            awaited = self._awaited
            awaited.discard(item.owner)
            if awaited:
                return True
        return self._ring() if self._bell.locked() else True

    def put_query(self, item: Any) -> bool:
        """Add a query of a client that is no participant of lockstep, from any thread; False: no room."""
        return self.queries.put(item, getattr(item, "size", 0)) and self._ring()

    def put_observed(self, item: Any) -> bool:
        """Add a message that is only observed and needed by no tick, from any thread; False: no room.

        Heartbeats have a queue of their own: a reader that lags must not lose them among status messages and logs.
        """
        lane = self.heartbeats if item.topic.model is HEALTH.model else self.observed
        return lane.put(item, item.size) and self._ring()

    def _ring(self) -> bool:
        with suppress(RuntimeError):  # it rings already
            self._bell.release()
        return True

    def get(self, timeout: float, awaited: set[str]) -> Any:
        """Return the oldest item of the first queue that has one; wait for an item while all are empty.

        Args:
            timeout: longest wait, s.
            awaited: services whose frames are missing; removed from the set as their frames come; empty = any frame
                wakes.

        Raises:
            Empty: no item came in time, or the reader was woken for an item that was taken before.
        """
        self._awaited = awaited
        if self.empty() and timeout > 0.0:  # looked at after ``awaited`` is set: what came before does not ring
            self._bell.acquire(timeout=timeout)
        self._awaited = _AWAKE
        return self.get_nowait()

    def get_nowait(self) -> Any:
        """Return the oldest item of the first queue that has one (raises Empty)."""
        for lane in (self.tick, self.heartbeats, self.queries, self.observed):
            try:
                return lane.get()
            except IndexError:
                continue
        raise Empty

    def empty(self) -> bool:
        """Return whether no item waits in the inbox."""
        return not (self.tick.items or self.heartbeats.items or self.queries.items or self.observed.items)

    def dropped(self) -> dict[str, int]:
        """Return how many messages and queries were refused, by key."""
        return dict(self.tick.dropped + self.heartbeats.dropped + self.queries.dropped + self.observed.dropped)


def _key_of(item: Any) -> str:
    if isinstance(item, Frame):
        return f"frame/{item.owner}"
    row = getattr(item, "query", item)
    return getattr(row, "key", type(row).__name__.lower())
