"""Large replies to clients that are no participants, sent by one thread at a bounded rate.

A client that requests maps faster than it reads them fills the links between it and the service; ticks and heartbeats
on the same links are delayed. The thread therefore pauses after each reply, and it is the thread that blocks when a
link is full, not the control loop. At most `WAITING` replies are queued; further requests are refused as `busy`.
"""

import threading
import traceback
from collections.abc import Callable
from queue import Full, Queue
from time import sleep

LARGE = 16 << 10
"""Size of a reply, bytes, from which a thread of its own sends it; a smaller one is sent at once."""
WAITING = 8
"""Largest number of replies in the queue; a request beyond it is refused as ``busy``."""
BYTES_PER_S = 32e6
"""Largest mean rate of large replies, bytes/s; a map of 400 x 400 cells takes 20 ms."""


class Replies:
    """Queue of replies and the daemon thread that sends them; the thread starts with the first reply."""

    def __init__(self) -> None:
        self._waiting: Queue[tuple[Callable[[], None], int]] = Queue(WAITING)
        self._thread: threading.Thread | None = None

    def put(self, send: Callable[[], None], size: int) -> bool:
        """Queue a reply; return False if the queue is full. Call it from one thread only.

        Args:
            send: sends the reply.
            size: of its payload, bytes.
        """
        if self._thread is None:
            self._thread = threading.Thread(target=self._work, name="replies", daemon=True)
            self._thread.start()
        try:
            self._waiting.put_nowait((send, size))
        except Full:
            return False
        return True

    def _work(self) -> None:
        while True:
            send, size = self._waiting.get()
            try:
                send()
            except Exception:  # a defect in one reply must not silence all that follow
                traceback.print_exc()
            del send  # a query that is kept here would stay open
            sleep(size / BYTES_PER_S)
