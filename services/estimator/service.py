"""The estimator service: hardware samples in, velocity, tilt and odometry out."""

import math
from typing import Literal

import numpy as np
from pydantic import Field

from schemas.hw import FootContacts, Imu, JointState
from schemas.state import Odometry, VelocityEstimate
from schemas.topics import (
    HW_CONTACTS,
    HW_IMU,
    HW_JOINTS,
    STATE_ODOMETRY,
    STATE_VELOCITY,
    STATE_VELOCITY_EKF,
    STATE_VELOCITY_IMU,
    STATE_VELOCITY_KINEMATICS,
    STATE_VELOCITY_KINEMATICS_GYRO,
)
from services.estimator import estimator as algorithm
from services.estimator import feet, history, inertial, odometry, odometry_kernel, output, standstill
from services.estimator import inputs as judging
from services.estimator.output import Estimate
from surefoot import kinematics, rotations
from surefoot.config import ServiceConfig
from surefoot.join import TickInputs
from surefoot.robot import load_robot
from surefoot.service import Service

VARIANTS = {
    "imu": STATE_VELOCITY_IMU,
    "kinematics": STATE_VELOCITY_KINEMATICS,
    "kinematics_gyro": STATE_VELOCITY_KINEMATICS_GYRO,
    "ekf": STATE_VELOCITY_EKF,
}

_KERNELS = (rotations, kinematics, feet, history, inertial, judging, odometry, odometry_kernel, output, standstill)


class EstimatorConfig(ServiceConfig):
    """Which estimate is ``state/velocity``, and where the robot starts."""

    mode: Literal["imu", "kinematics", "kinematics_gyro", "ekf"] = Field(
        default="ekf", description="estimator behind state/velocity"
    )
    remove_gyro_bias: bool = Field(default=True, description="subtract the mean gyro of the first standstill")
    start_x: float = Field(default=0.0, description="m, start pose in map: map = odom by this statement")
    start_y: float = Field(default=0.0, description="m")
    start_yaw: float = Field(default=0.0, description="rad")
    start_slope_sd: float | None = Field(
        default=0.003,
        ge=0,
        description="rad, the ground under the feet is level to this at the start, unless the accelerometer contradicts "
        "by 4 sigma of its bias; tells that bias from a tilt. null = unknown slope",
    )
    start_ground: float = Field(default=0.0, description="m, mean height of the ground under the feet at the start")


class Estimator(Service[EstimatorConfig]):
    """Velocity and gravity by the four estimators of Wawrzynski et al. side by side, and the odometry."""

    name = "estimator"
    Config = EstimatorConfig
    inputs = (HW_IMU, HW_JOINTS, HW_CONTACTS)
    outputs = (STATE_VELOCITY, STATE_ODOMETRY, *VARIANTS.values())

    def on_start(self) -> None:
        c = self.config
        start = algorithm.StartPose(c.start_x, c.start_y, c.start_yaw, c.start_ground)
        self.robot = load_robot(c.robot)
        for module in _KERNELS:
            module.warm()
        slope_sd = math.inf if c.start_slope_sd is None else c.start_slope_sd
        self.estimator = algorithm.Estimator.for_robot(
            self.robot, start, remove_gyro_bias=c.remove_gyro_bias, start_slope_sd=slope_sd
        )
        self._contacts: FootContacts | None = None

    def on_reset(self) -> None:
        self.estimator.reset()
        self._contacts = None

    def on_tick(self, inputs: TickInputs) -> None:
        imu, joints, contacts = inputs.get(HW_IMU), inputs.get(HW_JOINTS), inputs.get(HW_CONTACTS)
        if imu is not None:
            self._imu(imu)
        if contacts is not None:
            self._contacts = contacts
        if joints is not None and self._contacts is not None:
            self._kinematics(joints, self._contacts)
        stamp = self.estimator.stamp_ns
        self.publish(STATE_VELOCITY, velocity_message(self.estimator.estimate(self.config.mode)), stamp)
        self.publish(STATE_ODOMETRY, self._odometry(), stamp)
        for name, topic in VARIANTS.items():
            if topic.due(inputs.number):
                self.publish(topic, velocity_message(self.estimator.estimate(name)), stamp)

    def _imu(self, imu: Imu) -> None:
        result = self.estimator.on_imu(imu.stamp_ns, np.array(imu.gyro), np.array(imu.acc))
        if not result.accepted:
            self.log("warning", f"hw/imu of {imu.stamp_ns} ns refused: {result.name.lower()}")

    def _kinematics(self, joints: JointState, contacts: FootContacts) -> None:
        touch = np.array([any(foot) for foot in contacts.touch])
        result = self.estimator.on_kinematics(joints.stamp_ns, np.array(joints.position), touch)
        if not result.accepted:
            self.log("warning", f"hw/joints of {joints.stamp_ns} ns refused: {result.name.lower()}")

    def _odometry(self) -> Odometry:
        pose = self.estimator.pose()
        return Odometry(
            position=tuple(pose.position.tolist()),
            quat_wxyz=tuple(pose.quat_wxyz.tolist()),
            yaw=pose.yaw,
            velocity=tuple(pose.velocity.tolist()),
            covariance=tuple(pose.covariance.ravel().tolist()),
            initialised=self.estimator.initialised,
        )


def velocity_message(e: Estimate) -> VelocityEstimate:
    """An estimate as it travels."""
    return VelocityEstimate(
        mode=e.mode,  # pyright: ignore[reportArgumentType] - a name of the table of estimators
        velocity=tuple(e.velocity.tolist()),
        velocity_imu=tuple(e.velocity_imu.tolist()),
        velocity_heading=tuple(e.velocity_heading.tolist()),
        angular_velocity=tuple(e.angular_velocity.tolist()),
        g_up=tuple(e.g_up.tolist()),
        roll=e.roll,
        pitch=e.pitch,
        gyro_bias=tuple(e.gyro_bias.tolist()),
        acc_bias=tuple(e.acc_bias.tolist()),
        covariance=tuple(e.covariance.ravel().tolist()),
        initialised=e.initialised,
        standing=e.standing,
        inputs_ok=e.inputs_ok,
        filter_ok=e.filter_ok,
        sensors_ok=e.sensors_ok,
        slipping=tuple(e.slipping.tolist()),
        nis=e.nis,
        refused=e.refused,
    )


SERVICE = Estimator
