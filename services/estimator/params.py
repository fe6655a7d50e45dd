"""Parameters of the estimators of Wawrzynski et al. and of `best`; where their own values differ, these are noted."""

import math
from dataclasses import dataclass, replace
from typing import NamedTuple, Self

from surefoot.geometry.constants import GRAVITY
from surefoot.robot.description import Robot
from surefoot.robot.kinematics import foot_positions
from surefoot.schemas.topics import HW_IMU, HW_JOINTS

STANDSTILL_FACTOR = 2.5
"""Ratio of a sensor's standard deviation to its own noise below which the robot stands still."""
GAP_TURN = 0.1
"""Standard deviation of unseen turning in a gap of inertial samples, rad/s; in one longer than `reset_gap_ns`, rad."""
GAP_PUSH = 1.0
"""Standard deviation of unseen acceleration in a gap of inertial samples, m/s^2."""
UNKNOWN_SPEED = 1.0
"""Standard deviation of an unknown velocity, m/s per axis."""
UNKNOWN_TURN = 1.0
"""Standard deviation of the turn about the vertical of a robot that was knocked over unseen, rad."""
UNKNOWN_WAY = 0.3
"""Standard deviation of the displacement of a robot that was knocked over unseen, m on each axis."""


class StartPose(NamedTuple):
    """Pose of base_link in map when the robot starts: odom begins there, so that odom and map agree."""

    x: float = 0.0
    """Coordinate x of base_link when the robot starts, m, frame map."""
    y: float = 0.0
    """Coordinate y of base_link when the robot starts, m, frame map."""
    yaw: float = 0.0
    """Heading of base_link when the robot starts, rad, frame map."""
    ground: float = 0.0
    """Mean height of the ground under the feet when the robot starts, m, frame map."""


@dataclass(frozen=True)
class EstimatorParams:
    """Noises, limits and switches of the four estimators of Wawrzynski et al. and of `best`, SI.

    Noises are standard deviations of one IMU sample, of which there is one each `imu_period_ns`.
    """

    # sensors
    sigma_w: float = 0.0054  # rad/s, gyro, (22); ADIS16365, 0.044 deg/s/rtHz at 100 Hz
    sigma_q: float = 0.035  # m/s^2, accelerometer, (22); 0.5 mg/rtHz at 100 Hz
    acc_bias_sd: float = 0.157  # m/s^2, turn-on bias of an axis; 16 mg
    gyro_bias_floor: float = 2e-4  # rad/s, in-run drift: a bias is never known better
    gyro_bias_sd: float = 0.02  # rad/s, turn-on bias of an axis
    sigma_point: float = 0.0003  # m, a contact point by the encoders
    imu_period_ns: int = HW_IMU.period_ns
    kinematics_period_ns: int = HW_JOINTS.period_ns
    # limits of inputs
    max_gyro: float = math.radians(1000.0)  # rad/s
    max_acc: float = 5.0 * GRAVITY  # m/s^2
    max_speed: float = 2.0  # m/s; `best` takes a faster estimate that the feet do not show for an error, begins anew
    gap_periods: float = 5.0  # a longer IMU gap is counted and widens the covariance
    reset_gap_ns: int = 500_000_000  # a longer one makes the velocity unknown
    # start, equation (1)
    standstill_samples: int = 50  # at 100 Hz; `best` takes more of a faster unit, so that they last as long
    standstill_gyro_sd: float = STANDSTILL_FACTOR * 0.0054  # rad/s
    standstill_acc_sd: float = STANDSTILL_FACTOR * 0.035  # m/s^2
    standstill_travel: float = 0.0013  # m, of a foot within the window; an encoder step of a short leg moves it by 0.6
    prior_g: float = 0.02  # m/s^2, P0 = sigma_q^2/N + prior_g^2
    prior_v: float = 0.01  # m/s
    remove_gyro_bias: bool = True  # subtract the mean gyro of the rest (the paper: no)
    refine_gyro_bias: bool = True  # ... of all rest so far, not of the first window only
    start_slope_sd: float = math.inf  # rad, how level the ground under the feet is at the start; inf = unknown
    level_ground: bool = False  # the ground is level everywhere: `best` keeps height and tilt by it
    levels: bool = True  # `best` recognises levels that feet have stood on, and keeps its height by them
    soles: bool = True  # flat feet have three contact points (False: one, as round feet)
    # velocity from the legs
    sigma_v: float = 0.015  # m/s, (27), of one foot
    sigma_k: float = 0.05  # m/s, of v^K, for its covariance only
    feet: str = "all"  # "all": mean of the stance feet; "one": keep the earlier foot until it lifts (paper)
    slip_speed: float = 0.06  # m/s from the median of the feet: that foot slides
    rolling: bool = True  # round feet roll (paper: the ankle is the fixed point)
    gyro_mean: bool = True  # mean gyro between the kinematic samples (paper: the latest)
    exact_transition: bool = False  # F with the rotation that (24) drops

    @classmethod
    def from_robot(cls, robot: Robot, **changes: object) -> Self:
        """Return noises and limits of the robot's own sensors; `changes`: fields that get another value, by name."""
        profile = robot.imu.profile
        base = cls()
        rate = 1e9 / base.imu_period_ns
        sigma_w = _sample_noise(profile.gyro.noise_density, profile.gyro.lsb, rate)
        sigma_q = _sample_noise(profile.accel.noise_density, profile.accel.lsb, rate)
        values: dict[str, object] = {
            "sigma_w": sigma_w,
            "sigma_q": sigma_q,
            "acc_bias_sd": profile.accel.bias_turn_on,
            "gyro_bias_sd": max(profile.gyro.bias_turn_on, 0.01),
            "gyro_bias_floor": max(profile.gyro.bias_in_run, 1e-4),
            "standstill_gyro_sd": STANDSTILL_FACTOR * sigma_w,
            "standstill_acc_sd": STANDSTILL_FACTOR * sigma_q,
            "standstill_travel": max(0.0005, 1.5 * robot.encoder.resolution * _reach(robot)),
            "max_gyro": min(base.max_gyro, profile.gyro.limit),
            "max_acc": min(base.max_acc, profile.accel.limit),
        }
        return replace(base, **(values | changes))  # type: ignore[arg-type]


def at_rate(params: EstimatorParams, imu_hz: float) -> EstimatorParams:
    """Return the parameters of an inertial unit with another rate of samples and the same noise density.

    Args:
        params: parameters with one sample each `imu_period_ns`.
        imu_hz: samples of the inertial unit per second.
    """
    period_ns = round(1e9 / imu_hz)
    more = math.sqrt(params.imu_period_ns / period_ns)
    names = ("sigma_w", "sigma_q", "standstill_gyro_sd", "standstill_acc_sd")
    noises = {name: more * float(getattr(params, name)) for name in names}
    return replace(params, imu_period_ns=period_ns, **noises)  # type: ignore[arg-type]


def _reach(robot: Robot) -> float:
    """Return the longest distance from a hip to its foot centre in the neutral stance, m."""
    feet = foot_positions(robot.model, robot.neutral)
    return max(math.dist(foot, leg.hip) for foot, leg in zip(feet, robot.legs, strict=True))


def paper_params(params: EstimatorParams) -> EstimatorParams:
    """Return the parameters with all switches set as by Wawrzynski et al.

    That is one foot at a time, its ankle fixed, the latest gyro sample instead of a mean, and no bias removed.
    """
    return replace(params, feet="one", rolling=False, gyro_mean=False, remove_gyro_bias=False, refine_gyro_bias=False)


def _sample_noise(density: float, lsb: float, rate: float) -> float:
    """Return the standard deviation of a mean over one period: density sqrt(rate/2), and rounding lsb/sqrt(12).

    Args:
        density: noise density of the sensor, unit/sqrt(Hz).
        lsb: resolution of the sensor, unit.
        rate: sampling rate, Hz.
    """
    return math.hypot(density * math.sqrt(rate / 2.0), lsb / math.sqrt(12.0))
