"""Commands to the walker."""

from collections.abc import Mapping
from typing import Any, ClassVar, Literal

from pydantic import Field, ValidationInfo, field_validator

from .base import Reply, Request, Vec2, belonging

FIELDS: Mapping[str, tuple[str, ...]] = {
    "walk": ("distance", "velocity", "angle", "duration", "gait"),
    "turn": ("angle", "duration", "gait"),
    "stand": ("duration", "shift"),
    "stop": (),
}
"""Fields of `WalkCommand` that go with each of its actions, beside ``at_tick``; another field is refused."""


class WalkCommand(Request):
    """Walk, turn, stand or stop. A later command replaces the present one; ``stop`` ends in a closing step."""

    schema_version: ClassVar[str] = "1.1"
    action: Literal["walk", "turn", "stand", "stop"] = Field(description="what to do")
    distance: float | None = Field(default=None, ge=-100, le=100, description="m along the heading; null = until stop")
    velocity: float | None = Field(
        default=None, ge=-1, le=1, description="m/s along the heading; null = the gait's own"
    )
    angle: float | None = Field(
        default=None,
        ge=-31.5,
        le=31.5,
        description="rad, left positive; of a turn, or of an arc",
    )
    duration: float | None = Field(
        default=None,
        ge=0,
        le=3600,
        description="s from its first step on after which a walk or turn ends; for stand: how long a scenario waits",
    )
    shift: Vec2 | None = Field(
        default=None,
        description="m forward and left, for stand: moves the trunk over its standing feet to so far from their middle",
    )
    gait: str | None = Field(
        default=None, max_length=32, description="name of a gait of this robot; null = its default"
    )
    at_tick: int | None = Field(
        default=None, ge=0, description="tick the command takes effect in (reproducible); null = the next one"
    )

    @field_validator("distance", "velocity", "angle", "duration", "shift", "gait")
    @classmethod
    def _goes_with_action(cls, value: Any, info: ValidationInfo) -> Any:
        return belonging(value, info, "action", FIELDS)


class WalkReply(Reply):
    """Reply to a walk command, sent at once; progress of the walk is in state/gait under ``id``."""

    schema_version: ClassVar[str] = "1.1"
    accepted: bool = Field(description="false: nothing changes")
    id: int = Field(ge=0, description="number of the command, 0 when refused")
    code: str = Field(default="", description="short machine-readable reason of a refusal, e.g. too_fast, fallen")
    field: str | None = Field(default=None, description="field of the command that is to blame; null = none is")
    reason: str = Field(default="", description="why it was refused, in words")
