"""Query handlers of the stability service: errors become refusals, long computations run on a thread of their own."""

import threading
from collections.abc import Callable
from concurrent.futures import Future
from typing import TypeVar

from surefoot.background import Background
from surefoot.errors import Refusal
from surefoot.schemas.base import Reply
from surefoot.schemas.rows import Req
from surefoot.schemas.whatif import BatchReply, BatchRequest, WhatifReply, WhatifRequest

from .answers import batch_reply, whatif_reply
from .programs.clarabel_tools import clarabel_and_sparse
from .programs.contacts import StabilityError
from .regions import many

Rep = TypeVar("Rep", bound=Reply)

LATER_S = 1.0
"""Delay after the start, s, before another thread imports (0.2 s) the modules that only unusual contact sets need."""

AT_ONCE = 32
"""Largest number of sets of a batch that is answered between two ticks, in about 1 ms; more go to the other thread."""


def answered(handler: Callable[[Req], Rep]) -> Callable[[Req], Rep]:
    """Return a handler that raises each StabilityError of the given handler as a Refusal, the answer to a query."""

    def answer(request: Req) -> Rep:
        try:
            return handler(request)
        except StabilityError as error:
            raise Refusal(error.code, str(error), error.field) from None

    return answer


class Workers:
    """Handlers of the queries of the stability service that may take long, with a thread beside the ticks for them."""

    def __init__(self) -> None:
        self._timer = threading.Timer(LATER_S, clarabel_and_sparse)
        self._timer.daemon = True
        self._timer.start()
        self._background = Background("batch")

    def stop(self) -> None:
        """End the thread that answers large batches."""
        self._background.stop()

    def batch(self, request: BatchRequest) -> BatchReply | Future[BatchReply]:
        """Return the reply to `stability/batch`; with many sets a future, which a thread beside the ticks fulfils."""
        large = max(len(request.sets), len(request.counts)) > AT_ONCE
        return (
            self._background.answer(answered(batch_reply), request)
            if large
            else self._soon(answered(batch_reply), request)
        )

    def whatif(self, request: WhatifRequest) -> WhatifReply | Future[WhatifReply]:
        """Return the reply to `stability/whatif`; a future as long as its kernel is not compiled."""
        return self._soon(answered(whatif_reply), request)

    def _soon(self, answer: Callable[[Req], Rep], request: Req) -> Rep | Future[Rep]:
        """Return the answer at once if the kernel of many sets is compiled; else a future of the other thread."""
        return answer(request) if many.loaded() else self._background.answer(answer, request)
