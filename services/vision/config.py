"""Configuration of the vision service."""

from typing import Literal

from pydantic import Field

from surefoot.lockstep.config import ServiceConfig

from .recognise import RecogniseParams
from .view import Patch

_PATCH, _LIMITS = Patch(), RecogniseParams()


class VisionConfig(ServiceConfig):
    """Settings of the vision service: map, features, and part of the floor that it evaluates."""

    live = ("late_s",)

    map: str | None = Field(
        default=None, description="map of features, of `surefoot map build`; null = nothing is recognised"
    )
    features: Literal["orb", "sift"] = Field(default="sift", description="kind of features; that of the map counts")
    count: int = Field(default=250, ge=20, le=5000, description="features of an image, the strongest")
    most: int = Field(default=_LIMITS.most, ge=1, le=256, description="largest number of landmarks reported per image")
    nearest: float = Field(default=_PATCH.nearest, ge=0, le=10, description="m, begin of the floor ahead that counts")
    farthest: float = Field(default=_PATCH.farthest, gt=0, le=20, description="m, end of it")
    beside: float = Field(default=_PATCH.beside, gt=0, le=20, description="m, half of its width")
    pixel: float = Field(default=_PATCH.pixel, ge=0.0005, le=0.05, description="m, pixel of the picture from above")
    late_s: float = Field(default=0.4, gt=0, le=5, description="s, largest age of an image that is used")
