"""How a query ends: with its handler's reply, a typed error, or later, with what another thread worked out."""

from collections.abc import Callable
from concurrent.futures import Future
from typing import Any, NamedTuple, cast

from surefoot.bus.interface import Incoming
from surefoot.errors import Refusal, SurefootError
from surefoot.schemas.base import Request


class Late(NamedTuple):
    """An answer that was worked out on another thread."""

    incoming: Incoming
    future: Future[Any]


class Answers:
    """Ends queries; late answers go through the node's inbox.

    Args:
        put: puts something into that inbox.
        refuse: counts a refusal by its reason, with a detail for the log.
    """

    def __init__(self, put: Callable[[Late], None], refuse: Callable[[str, str], None]) -> None:
        self._put, self._refuse = put, refuse
        self.late = 0
        """Queries whose answer is being worked out on another thread."""

    def request(self, incoming: Incoming) -> Request | None:
        """What is asked; None where that is answered already: a probe, or nothing that can be read."""
        if incoming.probe:
            incoming.accept_probe()
            return None
        try:
            return incoming.request()
        except Refusal as refusal:
            self._refuse(refusal.code, f"{incoming.query.key}: {refusal.message}")
            incoming.fail(refusal)
            return None

    def settle(self, incoming: Incoming, make: Callable[[], Any]) -> None:
        """Answers with what ``make`` returns or raises; where that is a future, once it is done."""
        key = incoming.query.key
        try:
            answer = make()
            if not isinstance(answer, Future):
                incoming.reply(answer)
                return
            self.late += 1
            cast(Future[Any], answer).add_done_callback(lambda done: self._put(Late(incoming, done)))
        except SurefootError as error:
            self._refuse(error.code, f"{key}: {error.message}")
            incoming.fail(error)
        except Exception as error:  # a defect in a handler must not leave the asker without an answer
            self._refuse("internal", f"{key}: {type(error).__name__}: {error}")
            incoming.fail(SurefootError("internal", f"{key} failed: {type(error).__name__}: {error}"))

    def arrived(self, late: Late) -> None:
        """A future is done."""
        self.late -= 1
        self.settle(late.incoming, late.future.result)
