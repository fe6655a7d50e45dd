"""Settings of a gait: defaults of the code, then `[gait]` of the robot description, then changes by the caller."""

from dataclasses import MISSING, fields
from typing import Any, TypeVar

from surefoot.robot.description import Robot, RobotError

P = TypeVar("P")


def settings_of(kind: type[P], robot: Robot, changes: dict[str, Any]) -> P:
    """Return the settings of a robot's gait, in which later sources override earlier ones.

    Args:
        kind: dataclass of settings. A field without a default is the robot's own and must stand in `[gait]`.
        robot: description with the table `[gait]`.
        changes: values that go before those of the description, by field.

    Raises:
        RobotError: `[gait]` lacks a field that has no default.
    """
    known: Any = kind
    for each in fields(known):
        if each.default is MISSING and each.name not in robot.gait and each.name not in changes:
            raise RobotError("missing", f"gait.{each.name}", f"robot {robot.name} needs a number for its gait")
    own = {each.name: robot.gait[each.name] for each in fields(known) if each.name in robot.gait}
    return kind(**{**own, **changes})
