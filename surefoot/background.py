"""A thread that computes answers to requests which take longer than a control tick allows."""

import os
import threading
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from typing import TypeVar

from surefoot.errors import Refusal

Asked = TypeVar("Asked")
Answer = TypeVar("Answer")

NICE = 5
"""Niceness (Linux: 0 = usual, higher = yields to others) of threads that run no ticks, so that ticks have priority."""

MOST_WAITING = 8
"""Largest number of requests that wait or are being answered; a further one is refused as `busy`."""


def be_nice() -> None:
    """Set the niceness of the calling thread (Linux: each has its own) to `NICE`, so that ticks have priority."""
    os.setpriority(os.PRIO_PROCESS, threading.get_native_id(), NICE)


class Background:
    """One thread that computes the answers to requests, one after the other in their order.

    Args:
        name: name of the thread.
    """

    def __init__(self, name: str) -> None:
        self._pool = ThreadPoolExecutor(1, name, initializer=be_nice)
        self._waiting = threading.BoundedSemaphore(MOST_WAITING)

    def answer(self, handler: Callable[[Asked], Answer], request: Asked) -> Future[Answer]:
        """Let the thread call `handler(request)`, and return the future of its result.

        Raises:
            Refusal: `busy`, `MOST_WAITING` requests wait already.
        """
        if not self._waiting.acquire(blocking=False):
            raise Refusal("busy", f"{MOST_WAITING} batches wait already; ask again later")
        found = self._pool.submit(handler, request)
        found.add_done_callback(lambda _: self._waiting.release())
        return found

    def stop(self) -> None:
        """End the thread; requests that still wait are cancelled."""
        self._pool.shutdown(wait=False, cancel_futures=True)
