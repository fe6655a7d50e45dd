"""What has arrived for a node, from whatever thread, and when it is worth waking the node for it."""

import threading
from collections import deque
from queue import Empty
from typing import Any

from surefoot.bus.frame import Frame

_AWAKE = {""}
"""Awaits an owner that does not exist: a reader that is awake looks by itself before it sleeps."""


class Inbox:
    """A queue with one reader.

    A tick needs the frames of several services. A reader that is woken for each of them does nothing but go to sleep
    again: so it is woken by the last of the frames that it awaits, and by everything that is not a frame.
    """

    def __init__(self) -> None:
        self._awaited: set[str] = set()
        self._items: deque[Any] = deque()
        self._bell = threading.Lock()
        self._bell.acquire()

    def put(self, item: Any) -> None:
        """Adds an item; from any thread."""
        self._items.append(item)
        if isinstance(item, Frame):
            awaited = self._awaited
            awaited.discard(item.owner)
            if awaited:
                return
        try:
            self._bell.release()
        except RuntimeError:
            return  # it rings already

    def get(self, timeout: float, awaited: set[str]) -> Any:
        """The oldest item; sleeps while there is none.

        Args:
            timeout: s.
            awaited: owners whose frames are lacking, crossed out here as they come; empty = any frame wakes.

        Raises:
            Empty: nothing came in time, or the bell rang for what is gone already.
        """
        self._awaited = awaited
        if not self._items and timeout > 0.0:  # looked at after ``awaited`` is set: what came before does not ring
            self._bell.acquire(timeout=timeout)
        self._awaited = _AWAKE
        return self.get_nowait()

    def get_nowait(self) -> Any:
        """The oldest item (raises Empty)."""
        try:
            return self._items.popleft()
        except IndexError:
            raise Empty from None

    def empty(self) -> bool:
        """Whether nothing is there."""
        return not self._items
