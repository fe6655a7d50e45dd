"""Sample that a driver releases in a tick."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from surefoot.schemas.base import Message
from surefoot.schemas.topics import Topic


@dataclass(frozen=True)
class DueSample:
    """A sample of a sensor that is due in the coming tick, with its topic."""

    topic: Topic[Any]
    message: Message | Callable[[], Message]
    """Message, or a factory called at publication (for ``observers_only`` topics)."""
    stamp_ns: int
    seq: int
