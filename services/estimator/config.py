"""Configuration of the estimator service."""

import math
from typing import Literal

from pydantic import Field

from surefoot.lockstep.config import ServiceConfig
from surefoot.robot.description import Robot
from surefoot.services.estimator.estimator import Estimator, StartPose


class EstimatorConfig(ServiceConfig):
    """Which estimate is ``state/velocity``, and where the robot starts."""

    mode: Literal["imu", "kinematics", "kinematics_gyro", "ekf"] = Field(
        default="ekf", description="estimator behind state/velocity"
    )
    remove_gyro_bias: bool = Field(default=True, description="subtract the mean gyro of the first standstill")
    refine_gyro_bias: bool = Field(default=True, description="go on learning it in every later standstill")
    start_x: float = Field(default=0.0, description="m, start pose in map: map = odom by this statement")
    start_y: float = Field(default=0.0, description="m")
    start_yaw: float = Field(default=0.0, description="rad")
    start_ground: float = Field(default=0.0, description="m, mean height of the ground under the feet at the start")
    start_slope_sd: float | None = Field(
        default=0.003,
        ge=0,
        description="rad, how level that ground is; tells the accelerometer's bias from a tilt. Not believed if the "
        "accelerometer contradicts by 4 sigma of its bias. null = unknown slope",
    )

    def estimator(self, robot: Robot) -> Estimator:
        """The estimator of this configuration."""
        return Estimator.for_robot(
            robot,
            StartPose(self.start_x, self.start_y, self.start_yaw, self.start_ground),
            remove_gyro_bias=self.remove_gyro_bias,
            refine_gyro_bias=self.refine_gyro_bias,
            start_slope_sd=math.inf if self.start_slope_sd is None else self.start_slope_sd,
        )
