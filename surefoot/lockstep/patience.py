"""Wait for the answer to a query that a service sends during a tick in lockstep, and the conditions that end it.

Simulated time waits, too, so that wall time does not decide the result of a tick: a process that is slow, out of reach
or restarted is waited for, as the driver waits for it.
"""

import time
from collections.abc import Callable
from typing import Any, TypeVar

from surefoot.bus.frame import Frame
from surefoot.bus.inbox import Inbox, plain
from surefoot.bus.interface import Life
from surefoot.errors import CallError, Refusal
from surefoot.lockstep.binding import Bindings
from surefoot.lockstep.join import DRIVER
from surefoot.schemas.hw import Tick
from surefoot.schemas.topics import HW_TICK

Rep = TypeVar("Rep")

LOCKSTEP_ANSWER_S = 30.0
"""Limit on the wall time of the wait for an answer within a tick, s: longer than a service needs to start, or Zenoh to
link two hosts again after a partition."""
TRY_S = 5.0
"""Limit on the wall time of one try of a query, s; then the query is sent again, and its owner handles it once."""
AGAIN_S = 0.1
"""Pause before a query is sent again to a process that was out of reach, s."""


class Patience:
    """Rule of the wait of one service for answers to its queries.

    Args:
        inbox: inbox of the service, which is read but not changed.
        bindings: processes that services are bound to; updated as processes come and go during the wait.
        beat: publishes a heartbeat if one is due.
        stopping: returns whether the service is to end.
    """

    def __init__(
        self, inbox: Inbox, bindings: Bindings, beat: Callable[[], None], stopping: Callable[[], bool]
    ) -> None:
        self._inbox, self._bindings, self._beat, self._stopping = inbox, bindings, beat, stopping

    def look(self, owner: str, within: Tick) -> None:
        """Publish a heartbeat if one is due; raise CallError if the answer is of no use any more.

        That is so if the service is to end, a new run begins, or ``owner`` has left the roster.
        """
        self._beat()
        if self._stopping():
            raise CallError("absent", "the service ends")
        newest: Frame | None = None
        tick: Any = within
        for item in map(plain, tuple(self._inbox.tick.items)):
            if isinstance(item, Life):
                self._bindings.on_life(item)
            elif isinstance(item, Frame) and item.owner == DRIVER and item.instance == self._bindings.bound.get(DRIVER):
                newest = newest if self._bindings.fault_of(item) else item
        if newest is None:
            return
        try:
            tick = next((d.message() for d in newest.deliveries() if d.key == HW_TICK.key), tick)
        except Refusal:  # it is counted when it is taken out
            return
        if tick.epoch != within.epoch:
            raise CallError("absent", f"run {tick.epoch} begins")
        if tick.tick >= 0 and owner not in (DRIVER, *tick.roster):
            raise CallError("absent", f"{owner} has left the roster")

    def ask(self, once: Callable[[], Rep], look: Callable[[], None]) -> Rep:
        """Send a request, again while the process is out of reach or has not done the tick, and return the reply.

        Args:
            once: sends the request and returns the reply.
            look: called between two tries; raises CallError once the reply is of no use.

        Raises:
            CallError: that of the last try, or of `look`.
        """
        end = time.monotonic() + LOCKSTEP_ANSWER_S
        while True:
            try:
                return once()
            except CallError as error:
                if error.code not in ("absent", "timeout", "not_ready") or time.monotonic() >= end:
                    raise
            look()
            time.sleep(AGAIN_S)
