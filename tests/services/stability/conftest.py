"""The stability service as an outside client sees it."""

import json
from concurrent.futures import Future
from typing import Any

import pytest

from surefoot.bus.codec import decode, encode
from surefoot.services.stability.config import StabilityConfig
from surefoot.services.stability.service import SERVICE, Stability


@pytest.fixture(scope="module")
def service() -> Stability:
    made = SERVICE(StabilityConfig())
    made.on_start()
    return made


def ask(service: Stability, what: str, **fields: Any) -> dict[str, Any]:
    """Request and reply through the codec."""
    model = {query.key: query.request for query in SERVICE.serves}[f"stability/{what}"]
    reply = service.handlers[f"stability/{what}"](decode(model, json.dumps(fields).encode()))
    return json.loads(encode(reply.result() if isinstance(reply, Future) else reply)[0])
