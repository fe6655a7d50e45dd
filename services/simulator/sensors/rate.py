"""Period of a sensor: from the profile of the sensor, or else from the row of its topic."""

from typing import Any

from surefoot.schemas.topics import Topic


def period_ms(own: int | None, topic: Topic[Any]) -> int:
    """Return the period of a sensor, ms: `own`, from its profile, if given, else that of its topic."""
    return topic.period_ns // 1_000_000 if own is None else own
