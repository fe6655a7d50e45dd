"""Conversion of estimates to the messages `state/velocity` and `state/odometry`."""

from collections.abc import Sequence
from typing import Any

from numpy.typing import NDArray

from surefoot.schemas.hw import ExternalMotion
from surefoot.schemas.state import Odometry, StanceEnd, VelocityEstimate

from .feet.slip import FinishedStance
from .inputs.external import ExternalSample
from .output import OdometryPose, VelocityAndTilt

PLANAR = tuple(6 * row + column for row in (0, 1, 2, 5) for column in (0, 1, 2, 5))
"""Places of x, y, z and heading, row by row, in the 36 numbers of the covariance of a pose."""


def velocity_message(e: VelocityAndTilt) -> VelocityEstimate:
    """Return the message `state/velocity` of one estimator: velocity, gravity, biases, covariance and flags."""
    return VelocityEstimate(
        mode=e.mode,  # pyright: ignore[reportArgumentType] - a name of the table of estimators
        velocity=_list(e.velocity),
        velocity_imu=_list(e.velocity_imu),
        velocity_heading=_list(e.velocity_heading),
        angular_velocity=_list(e.angular_velocity),
        g_up=_list(e.g_up),
        roll=e.roll,
        pitch=e.pitch,
        gyro_bias=_list(e.gyro_bias),
        acc_bias=_list(e.acc_bias),
        covariance=_list(e.covariance.ravel()),
        initialised=e.initialised,
        standing=e.standing,
        inputs_ok=e.inputs_ok,
        filter_ok=e.filter_ok,
        sensors_ok=e.sensors_ok,
        slipping=_list(e.slipping),
        nis=e.nis,
        refused=e.refused,
        reasons=e.reasons,
    )


def sample_of(m: ExternalMotion) -> ExternalSample:
    """Return the pose, heading and velocity in a message of another estimator as a sample for the filter."""
    return ExternalSample(m.position, m.position_covariance, m.yaw, m.yaw_variance, m.velocity, m.velocity_covariance)


def odometry_message(pose: OdometryPose, initialised: bool, stances: Sequence[FinishedStance] = ()) -> Odometry:
    """Return the message `state/odometry`: dead-reckoned pose of base_link in odom and stances that have ended.

    Args:
        pose: pose, velocity and covariance.
        initialised: True if the pose can be used.
        stances: stances (times in which a foot stood) that ended since the last message.
    """
    covariance: list[float] = pose.covariance.ravel().tolist()
    return Odometry(
        position=_list(pose.position),
        quat_wxyz=_list(pose.quat_wxyz),
        yaw=pose.yaw,
        velocity=_list(pose.velocity),
        covariance=tuple([covariance[place] for place in PLANAR]),
        pose_covariance=tuple(covariance),
        initialised=initialised,
        stances=tuple(
            StanceEnd(foot=s.leg, slip=s.slip, begin=s.begin, samples=s.samples, healthy=s.healthy) for s in stances
        ),
    )


def _list(x: NDArray[Any]) -> Any:
    """Return the numbers of an array of any shape as nested lists; the model makes the tuple and checks the length."""
    return x.tolist()
