"""Configuration of the estimator service."""

import math
from typing import Literal

from pydantic import Field, ValidationInfo, field_validator

from surefoot.lockstep.config import ServiceConfig
from surefoot.robot.description import Robot
from surefoot.tables import refused

from .paper.estimators import ESTIMATORS
from .params import StartPose
from .stream import BEST, Estimator


class EstimatorConfig(ServiceConfig):
    """Settings of the estimator service: estimator behind `state/velocity`, gyro bias, pose and ground at the start."""

    live = ("mode",)

    mode: Literal["best", "imu", "kinematics", "kinematics_gyro", "ekf"] = Field(
        default="best", description="estimator behind state/velocity; state/odometry is that of `best`"
    )
    beside: bool = Field(
        default=True,
        description="the paper's estimators run beside `best`, as for comparisons; without them a tick takes a quarter "
        "less, and `mode` is best",
    )
    remove_gyro_bias: bool = Field(
        default=True, description="the paper's estimators subtract the mean gyro of the rest"
    )
    refine_gyro_bias: bool = Field(
        default=True, description="the paper's estimators learn the mean gyro again in every later rest"
    )
    start_x: float = Field(default=0.0, description="m, start pose in map: map = odom by this statement")
    start_y: float = Field(default=0.0, description="m, start pose in map")
    start_yaw: float = Field(default=0.0, description="rad, start heading in map")
    start_ground: float = Field(default=0.0, description="m, mean height of the ground under the feet at the start")
    start_slope_sd: float | None = Field(
        default=0.003,
        ge=0,
        description="rad, how level that ground is; splits bias of the accelerometer from tilt. Not believed if the "
        "accelerometer contradicts by 4 sigma of its bias. null = unknown slope",
    )
    level_ground: bool = Field(
        default=False, description="the ground is level everywhere, as on a floor: keeps height and tilt from drifting"
    )

    @field_validator("beside")
    @classmethod
    def _runs(cls, beside: bool, info: ValidationInfo) -> bool:
        if not beside and (mode := info.data.get("mode", BEST)) != BEST:
            raise refused("mode", f"got false with mode {mode!r}, which needs true")
        return beside

    @property
    def modes(self) -> tuple[str, ...]:
        """Names of the paper's estimators that run beside `best`."""
        return tuple(ESTIMATORS) if self.beside else ()

    def estimator(self, robot: Robot) -> Estimator:
        """Return a new estimator for a robot with these settings."""
        return Estimator.for_robot(
            robot,
            StartPose(self.start_x, self.start_y, self.start_yaw, self.start_ground),
            names=(BEST, *self.modes),
            remove_gyro_bias=self.remove_gyro_bias,
            refine_gyro_bias=self.refine_gyro_bias,
            level_ground=self.level_ground,
            start_slope_sd=math.inf if self.start_slope_sd is None else self.start_slope_sd,
        )
