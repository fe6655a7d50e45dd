"""Rate of a sensor: its topic's row states it, a profile of the sensor may state its own."""

from typing import Any

from surefoot.schemas.topics import Topic
from surefoot.tables import Table


def period_ms(profile: Table, topic: Topic[Any]) -> int:
    """Return the period of a sensor, ms: `period_ms` of its profile, else that of its topic's row.

    Raises:
        RobotError: the profile's own period is no whole number from 10 to 10000.
    """
    if profile.has("period_ms"):
        return profile.integer("period_ms", at_least=10, at_most=10_000)
    return topic.period_ns // 1_000_000
