"""Large replies to strangers, sent by a thread of their own and no faster than a network takes them.

A client that asks for maps faster than it reads them fills the links between it and a service, and what else travels on
them waits: the ticks, and the signs of life. So the thread leaves the links free for a part of the time, and waits in
the robot's place where one is full; a few replies wait for the thread, and whoever asks while they wait is refused.
"""

import threading
import time
import traceback
from collections.abc import Callable
from queue import Full, Queue

LARGE = 16 << 10
"""Bytes from which a reply is sent by the thread."""
WAITING = 8
"""Replies that wait at most."""
BYTES_PER_S = 32e6
"""How fast they are sent at most: a map of 400 x 400 cells takes 20 ms."""


class Replies:
    """The thread; it starts with the first large reply."""

    def __init__(self) -> None:
        self._waiting: Queue[tuple[Callable[[], None], int]] = Queue(WAITING)
        self._thread: threading.Thread | None = None

    def put(self, send: Callable[[], None], size: int) -> bool:
        """Send `size` bytes when it is their turn; return whether there was room. From one thread."""
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
            time.sleep(size / BYTES_PER_S)
