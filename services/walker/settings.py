"""Settings of a gait: defaults of the code, then `[gait]` of the robot description, then changes by the caller."""

from collections.abc import Mapping
from typing import TypeVar

from surefoot.robot.description import Robot, RobotError
from surefoot.tables import FileModel, validated

P = TypeVar("P", bound=FileModel)


def settings_of(kind: type[P], robot: Robot, changes: Mapping[str, object]) -> P:
    """Return the settings of a robot's gait, in which later sources override earlier ones.

    Args:
        kind: model of the settings. A field without a default is the robot's own and must stand in `[gait]`.
        robot: description with the table `[gait]`.
        changes: values that go before those of the description, by field.

    Raises:
        RobotError: a field is unknown, out of its range, or has neither a default nor a value.
    """
    return validated(kind, {**robot.gait, **changes}, RobotError, "gait")
