"""Named sensor profiles, such as the noise of an inertial unit, that robots share: TOML files under `robots/`."""

import math
from pathlib import Path
from typing import Annotated, ClassVar, Literal, TypeVar

from pydantic import Field, model_validator

from surefoot.geometry.constants import GRAVITY
from surefoot.robot import description as r
from surefoot.robot.description import RobotError
from surefoot.tables import (
    FileModel,
    Name,
    NotNegative,
    Number,
    Positive,
    Text,
    Vector,
    Whole,
    read_toml,
    refused,
    validated,
)

ROBOTS = Path(__file__).parents[1] / "robots"
MILLI_G = 1e-3 * GRAVITY
"""One thousandth of standard gravity, m/s^2."""

Share = Annotated[Number, Field(ge=0, le=1)]
Pixels = Annotated[Whole, Field(ge=8, le=8192)]
PeriodMs = Annotated[Whole, Field(ge=10, le=10_000)]


class Profile(FileModel):
    """Fields that every profile of a sensor or camera has: its name and the source of its numbers."""

    folder: ClassVar[str]
    name: Name
    source: Text = Field(description="where the numbers come from")


class Gyro(FileModel):
    """Noise of each axis of a gyroscope, as stated in the file of an inertial unit."""

    lsb_deg_s: NotNegative = Field(description="deg/s, resolution")
    range_deg_s: Positive = Field(description="deg/s, largest rate either way")
    noise_deg_s_rthz: NotNegative = Field(description="deg/s per root Hz, white noise")
    bias_turn_on_deg_s: NotNegative = Field(description="deg/s, standard deviation of the bias at start")
    bias_in_run_deg_s: NotNegative = Field(description="deg/s, standard deviation of the bias in a run")
    bias_time_s: Positive = Field(description="s, correlation time of the bias in a run")


class Accelerometer(FileModel):
    """Noise of each axis of an accelerometer, as stated in the file of an inertial unit."""

    lsb_mg: NotNegative = Field(description="1e-3 g, resolution")
    range_g: Positive = Field(description="g, largest acceleration either way")
    noise_mg_rthz: NotNegative = Field(description="1e-3 g per root Hz, white noise")
    bias_turn_on_mg: NotNegative = Field(description="1e-3 g, standard deviation of the bias at start")
    bias_in_run_mg: NotNegative = Field(description="1e-3 g, standard deviation of the bias in a run")
    bias_time_s: Positive = Field(description="s, correlation time of the bias in a run")


class ImuFile(Profile):
    """Content of the file of an inertial unit, `robots/sensors/<name>.toml`."""

    folder = "sensors"
    format: Literal["surefoot.imu/1"] = Field(alias="schema")
    gyro: Gyro
    accel: Accelerometer


class CameraFile(Profile):
    """Content of the file of a landmark camera, `robots/cameras/<name>.toml`."""

    folder = "cameras"
    format: Literal["surefoot.camera/1"] = Field(alias="schema")
    link: Text = Field(description="link that carries the camera")
    position: Vector = Field(description="m, in that link")
    pitch_deg: Number = Field(ge=-90, le=90, description="deg, downwards")
    width_px: Pixels
    height_px: Pixels
    field_deg: Number = Field(gt=1, le=170, description="deg, horizontal field of view")
    period_ms: PeriodMs | None = Field(None, description="ms between two images; else the rate of `hw/landmarks`")
    exposure_ms: Number = Field(gt=0, le=1000, description="ms")
    detect: Share = Field(description="probability that a landmark in a sharp image is detected")
    blur_px: Positive = Field(description="px, blur at which exp(-1/2) of it is left")
    most: Annotated[Whole, Field(ge=1, le=10_000)] = Field(description="features of one image, at most")
    range_sigma: NotNegative = Field(description="standard deviation of the range, part of the range")
    bearing_sigma_deg: NotNegative = Field(description="deg, standard deviation of the bearing")
    descriptor_sigma: NotNegative = Field(description="standard deviation of each number of a descriptor")
    range_noise: NotNegative = Field(0.0, description="m, standard deviation of the range beside `range_sigma`")
    still: Share = Field(1.0, description="part of the noise of a sharp image; blur brings the rest")
    tilt_blind: bool = Field(False, description="places on the floor are computed for a level trunk")
    readout_ms: NotNegative = Field(10.0, description="ms between the exposures of an image's first and last row")
    delay_ms: NotNegative = Field(40.0, description="ms from the end of an image's exposure to its arrival")
    jitter_ms: NotNegative = Field(8.0, description="ms, standard deviation of that")
    image_noise: NotNegative = Field(0.008, description="standard deviation of a dark pixel, part of white")
    shot_noise: NotNegative = Field(0.012, description="standard deviation of a white pixel beside that, part of white")
    vignetting: Share = Field(0.3, description="part of the light that the corners of an image lack")


class RangerFile(Profile):
    """Content of the file of an ultrasonic ranger and foot bumpers, `robots/rangers/<name>.toml`."""

    folder = "rangers"
    format: Literal["surefoot.ranger/1"] = Field(alias="schema")
    position: Vector = Field(description="m, in base_link")
    field_deg: Number = Field(gt=0, le=180, description="deg, full cone, horizontal")
    shortest: NotNegative = Field(description="m, nearer things read as this")
    longest: Number = Field(description="m, no echo beyond")
    resolution: Positive = Field(description="m")
    sigma: NotNegative = Field(description="m, standard deviation")
    period_ms: PeriodMs | None = Field(None, description="ms between two readings; default: by the rate of `hw/range`")
    bump_n: Positive = Field(description="N, horizontal force on a foot that presses its bumper")

    @model_validator(mode="after")
    def _in_order(self) -> "RangerFile":
        if self.longest <= self.shortest:
            raise refused("value", f"got {self.longest}, must be above shortest = {self.shortest}", "longest")
        return self


class DepthCameraFile(Profile):
    """Content of the file of a depth camera on the trunk, `robots/depth_cameras/<name>.toml`."""

    folder = "depth_cameras"
    format: Literal["surefoot.depth_camera/1"] = Field(alias="schema")
    position: Vector = Field(description="m, in base_link")
    pitch_deg: Number = Field(ge=-90, le=90, description="deg, downwards")
    width_px: Annotated[Whole, Field(ge=8, le=320)]
    height_px: Annotated[Whole, Field(ge=8, le=320)]
    field_deg: Number = Field(gt=1, le=170, description="deg, horizontal field of view")
    period_ms: PeriodMs | None = Field(None, description="ms between two images; default: by the rate of `hw/depth`")
    shortest: Positive = Field(description="m, nearer things give no depth")
    longest: Number = Field(le=100, description="m, nor do things beyond")
    sigma: NotNegative = Field(description="m, standard deviation of the depth close by")
    sigma_square: NotNegative = Field(description="m per m2, beside that, with the square of the depth")
    dropout: Share = Field(description="share of pixels without a depth")
    resolution: Positive = Field(description="m, step of the depth")

    @model_validator(mode="after")
    def _in_order(self) -> "DepthCameraFile":
        if self.longest <= self.shortest:
            raise refused("value", f"got {self.longest}, must be above shortest = {self.shortest}", "longest")
        return self


P = TypeVar("P", bound=Profile)


def profile_names(model: type[Profile]) -> tuple[str, ...]:
    """Return the names of the profiles of one kind that come with the package."""
    return tuple(sorted(path.stem for path in (ROBOTS / model.folder).glob("*.toml")))


def read_profile(model: type[P], name: str, field: str) -> tuple[P, dict[str, object]]:
    """Return the profile with a name, and the content of its file, which is part of the hash of a robot description.

    Raises:
        RobotError: no profile has the name, reported under `field`, or a value in the file is not allowed.
    """
    known, place = profile_names(model), f"{model.folder}.{name}"
    if name not in known:
        raise RobotError("unknown_name", field, f"got {name!r}, known are {', '.join(known)}")
    data = read_toml(ROBOTS / model.folder / f"{name}.toml", RobotError)
    profile = validated(model, data, RobotError, place)
    if profile.name != name:
        raise RobotError("value", f"{place}.name", f"got {profile.name!r}, allowed are {name}")
    return profile, data


def imu_profile_names() -> tuple[str, ...]:
    """Return the names of the inertial units that come with the package."""
    return profile_names(ImuFile)


def read_imu_profile(name: str) -> r.ImuProfile:
    """Return the noise of an inertial unit of the package by its name, in SI units.

    Raises:
        RobotError: unknown name, or a number out of range.
    """
    return imu_profile(read_profile(ImuFile, name, "profile")[0])


def imu_profile(file: ImuFile) -> r.ImuProfile:
    """Return the noise of an inertial unit from the content of its file, converted to SI units."""
    deg, g, a = math.radians(1.0), file.gyro, file.accel
    gyro = r.AxisNoise(
        lsb=deg * g.lsb_deg_s,
        limit=deg * g.range_deg_s,
        noise_density=deg * g.noise_deg_s_rthz,
        bias_turn_on=deg * g.bias_turn_on_deg_s,
        bias_in_run=deg * g.bias_in_run_deg_s,
        bias_time_s=g.bias_time_s,
    )
    accel = r.AxisNoise(
        lsb=MILLI_G * a.lsb_mg,
        limit=GRAVITY * a.range_g,
        noise_density=MILLI_G * a.noise_mg_rthz,
        bias_turn_on=MILLI_G * a.bias_turn_on_mg,
        bias_in_run=MILLI_G * a.bias_in_run_mg,
        bias_time_s=a.bias_time_s,
    )
    return r.ImuProfile(file.name, gyro, accel)
