"""Sensor sample that a driver publishes in a tick."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from surefoot.schemas.base import Message
from surefoot.schemas.topics import Topic


@dataclass(frozen=True)
class DueSample:
    """A sensor sample to be published in the next tick: topic, message, stamp and sequence number."""

    topic: Topic[Any]
    message: Message | Callable[[], Message]
    """Message, or a factory called at publication (for ``observers_only`` topics)."""
    stamp_ns: int
    seq: int
