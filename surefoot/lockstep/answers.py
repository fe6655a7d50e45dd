"""Answers to the queries of a service: the handler's reply, an error, or later the result of another thread."""

import time
from collections import defaultdict, deque
from collections.abc import Callable
from concurrent.futures import Future
from typing import Any, NamedTuple, cast

from surefoot.bus.interface import Incoming
from surefoot.errors import Refusal, SurefootError
from surefoot.schemas.base import Request, TickRequest
from surefoot.schemas.rows import MOST_TICKS

NOT_READY_S = 2.0
"""Wall time after which a query about a tick that has not come is answered by the error ``not_ready``, s."""

SENDERS = 4
"""Number of requests of each query, the newest ones, whose answers are kept for senders that repeat a request."""


class LateAnswer(NamedTuple):
    """A query whose reply is computed on another thread: the query to answer, and the future of the reply."""

    incoming: Incoming
    future: Future[Any]


class Answers:
    """Sender of the answers to the queries of a node; a reply from another thread comes back through the node's inbox.

    Args:
        put: puts a reply from another thread into the inbox.
        refuse: counts a refused query by a reason, with a detail for the log.
        clock: returns monotonic wall time, s.
    """

    def __init__(
        self,
        put: Callable[[LateAnswer], Any],
        refuse: Callable[[str, str], None],
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._put, self._refuse, self._clock = put, refuse, clock
        self.late = 0
        """Number of queries whose answer is still being computed on another thread."""
        self._last: dict[str, deque[tuple[Request | None, Any]]] = defaultdict(lambda: deque(maxlen=SENDERS))
        """Newest requests of participants and their answers, at most ``SENDERS`` by key of the query."""
        self.waiting: list[tuple[float, Incoming, TickRequest]] = []
        """Queries about ticks that have not come: wall time of arrival, s, query, and decoded request."""

    def begin(self) -> None:
        """Forget the answers of the last run, as the ticks of a new run have the same numbers."""
        self._last.clear()

    def wait(self, incoming: Incoming, request: TickRequest) -> None:
        """Keep a query about a tick that has not come yet, to be answered once it has."""
        self.waiting.append((self._clock(), incoming, request))

    def due(self, seen: Callable[[TickRequest], bool]) -> list[tuple[Incoming, TickRequest]]:
        """Remove and return the waiting queries for which `seen` returns True: their tick has come."""
        ready = [item for item in self.waiting if seen(item[2])]
        self.waiting = [item for item in self.waiting if item not in ready]
        return [(incoming, request) for _, incoming, request in ready]

    def expire(self, name: str) -> None:
        """Answer queries that waited longer than ``NOT_READY_S`` by the error ``not_ready``; ``name``: the service."""
        if not self.waiting:
            return
        now = self._clock()
        old = [item for item in self.waiting if now - item[0] > NOT_READY_S]
        self.waiting = [item for item in self.waiting if item not in old]
        for _, incoming, request in old:
            incoming.fail(Refusal("not_ready", f"{name} has not seen tick {request.tick} of epoch {request.epoch}"))

    def request(self, incoming: Incoming) -> Request | None:
        """Return the request of a query; None for a test of the link or a request that is refused, answered here."""
        if incoming.probe:
            incoming.accept_probe()
            return None
        try:
            request = incoming.request()
            _check_ticks(request)
            return request
        except Refusal as refusal:
            self._refuse(refusal.code, f"{incoming.query.key}: {refusal.message}")
            incoming.fail(refusal)
            return None

    def settle(self, incoming: Incoming, make: Callable[[], Any], request: Request | None = None) -> None:
        """Answer a query with the result or the error of ``make``; if the result is a future, once it is done.

        A participant that repeats a request that names a tick gets the same answer without a new call of ``make``: the
        first answer was lost on the way, and a request takes effect only once.
        """
        key = incoming.query.key
        try:
            known = self._last[key] if incoming.participant and _tick_of(request) is not None else None
            answers = [answer for earlier, answer in known or () if earlier == request]
            answer: Any = answers[-1] if answers else make()
            if known is not None and not answers:
                known.append((request, answer))
            if not isinstance(answer, Future):
                incoming.reply(answer)
                return
            self.late += 1
            cast(Future[Any], answer).add_done_callback(lambda done: self._put(LateAnswer(incoming, done)))
        except SurefootError as error:
            self._refuse(error.code, f"{key}: {error.message}")
            incoming.fail(error)
        except Exception as error:  # a defect in a handler must not leave the asker without an answer
            self._refuse("internal", f"{key}: {type(error).__name__}: {error}")
            incoming.fail(SurefootError("internal", f"{key} failed: {type(error).__name__}: {error}"))

    def arrived(self, late: LateAnswer) -> None:
        """Send the reply of a query that another thread has computed."""
        self.late -= 1
        self.settle(late.incoming, late.future.result)


def _check_ticks(request: Request) -> None:
    """Raise a Refusal if a request names a tick, or a number of ticks, that no run reaches: it would wait for ever."""
    for name in ("at_tick", "ticks", "max_ticks"):
        value = getattr(request, name, None)
        if isinstance(value, int) and value > MOST_TICKS:
            raise Refusal("range", f"{name}: got {value}, allowed are up to {MOST_TICKS} ticks", name)


def _tick_of(request: Request | None) -> int | None:
    """Return the tick whose state a request is about or in which its order takes effect; None: it names none."""
    return request.tick if isinstance(request, TickRequest) else getattr(request, "at_tick", None)
