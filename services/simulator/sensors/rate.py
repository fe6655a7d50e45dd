"""Rate of a sensor: its topic's row states it, a profile of the sensor may state its own."""

from typing import Any

from surefoot.schemas.topics import Topic


def period_ms(own: int | None, topic: Topic[Any]) -> int:
    """Return the period of a sensor, ms: the one of its profile, else that of its topic's row."""
    return topic.period_ns // 1_000_000 if own is None else own
