"""Estimates as they travel."""

from typing import cast

from numpy.typing import NDArray

from schemas.base import QuatWxyz, Vec3
from schemas.state import Covariance4, Covariance6, Odometry, VelocityEstimate
from services.estimator.odometry import Pose
from services.estimator.output import Estimate


def velocity_message(e: Estimate) -> VelocityEstimate:
    """One estimator's velocity and gravity."""
    return VelocityEstimate(
        mode=e.mode,  # pyright: ignore[reportArgumentType] - a name of the table of estimators
        velocity=_vec3(e.velocity),
        velocity_imu=_vec3(e.velocity_imu),
        velocity_heading=_vec3(e.velocity_heading),
        angular_velocity=_vec3(e.angular_velocity),
        g_up=_vec3(e.g_up),
        roll=e.roll,
        pitch=e.pitch,
        gyro_bias=_vec3(e.gyro_bias),
        acc_bias=_vec3(e.acc_bias),
        covariance=cast(Covariance6, tuple(e.covariance.ravel().tolist())),
        initialised=e.initialised,
        standing=e.standing,
        inputs_ok=e.inputs_ok,
        filter_ok=e.filter_ok,
        sensors_ok=e.sensors_ok,
        slipping=tuple(e.slipping.tolist()),
        nis=e.nis,
        refused=e.refused,
    )


def odometry_message(pose: Pose, initialised: bool) -> Odometry:
    """The dead-reckoned pose."""
    return Odometry(
        position=_vec3(pose.position),
        quat_wxyz=cast(QuatWxyz, tuple(pose.quat_wxyz.tolist())),
        yaw=pose.yaw,
        velocity=_vec3(pose.velocity),
        covariance=cast(Covariance4, tuple(pose.covariance.ravel().tolist())),
        initialised=initialised,
    )


def _vec3(x: NDArray) -> Vec3:
    return cast(Vec3, tuple(x.tolist()))
