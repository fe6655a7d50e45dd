"""Replies to clients that are no participants, sent by two threads: one for small replies, one for large ones.

A client that requests more than it reads fills the link to it, and whoever sends a reply on a full link is blocked for
seconds. It is a thread of the replies that is blocked then, and not the control loop, whose heartbeats others expect.
Large replies are sent at a bounded rate, for ticks and heartbeats on the same links are delayed meanwhile: their thread
pauses after each. At most `WAITING` of them are queued; further requests are refused as `busy`.
"""

import threading
import traceback
from collections.abc import Callable
from contextlib import suppress
from queue import SimpleQueue
from time import sleep

LARGE = 16 << 10
"""Size of a reply, bytes, from which it counts as large."""
WAITING = 8
"""Largest number of large replies in the queue; a request beyond it is refused as ``busy``."""
MOST_SMALL = 4096
"""Number of small replies in the queue from which on further queries are closed without a reply."""
BYTES_PER_S = 32e6
"""Largest mean rate of large replies, bytes/s; a map of 400 x 400 cells takes 20 ms."""


class ReplyLane:
    """Queue of replies and the daemon thread that sends them; the thread starts with the first reply."""

    def __init__(self, name: str, bytes_per_s: float) -> None:
        """Make an empty queue whose thread, with this name, sends at most `bytes_per_s` bytes/s; inf = at once."""
        self._name, self._bytes_per_s = name, bytes_per_s
        self._waiting = SimpleQueue[tuple[Callable[[], None], int]]()
        self._thread: threading.Thread | None = None
        self._starts = threading.Lock()

    def __len__(self) -> int:
        return self._waiting.qsize()

    def put(self, send: Callable[[], None], size: int) -> None:
        """Queue a reply of `size` bytes that the function `send` sends; any thread may do so."""
        self._waiting.put((send, size))
        with self._starts:
            if self._thread is None:
                thread = threading.Thread(target=self._work, name=self._name, daemon=True)
                with suppress(RuntimeError):  # no memory for a thread now: the next reply tries it again
                    thread.start()
                    self._thread = thread

    def finish(self, timeout_s: float) -> None:
        """Wait until what is queued now has been sent, at most `timeout_s` s."""
        if self._thread is not None and self._thread is not threading.current_thread():
            sent = threading.Event()
            self._waiting.put((sent.set, 0))
            sent.wait(timeout_s)

    def _work(self) -> None:
        while True:
            send, size = self._waiting.get()
            try:
                send()
            except Exception:  # a defect in one reply must not silence all that follow
                traceback.print_exc()
            del send  # a query that is kept here would stay open
            if rest := size / self._bytes_per_s:
                sleep(rest)


class Replies:
    """Replies of one process to clients: a lane of small ones, which nothing slows, and a lane of large ones."""

    def __init__(self) -> None:
        self._small, self._large = ReplyLane("replies", float("inf")), ReplyLane("large replies", BYTES_PER_S)

    def put(self, send: Callable[[], None], close: Callable[[], None], size: int) -> bool:
        """Queue a reply; return False if it is large and `WAITING` large ones are queued.

        Args:
            send: sends the reply and closes its query.
            close: closes the query without a reply; called instead where `MOST_SMALL` small replies are queued.
            size: size of the payload, bytes.
        """
        if size < LARGE:
            self._small.put(send if len(self._small) < MOST_SMALL else close, size)
        elif len(self._large) < WAITING:
            self._large.put(send, size)
        else:
            return False
        return True

    def finish(self, timeout_s: float) -> None:
        """Wait until the small replies that are queued now have been sent, at most `timeout_s` s."""
        self._small.finish(timeout_s)
