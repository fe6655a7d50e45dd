"""Noise of the `best` filter: what the sensors bring, and one set of rates for every robot and log."""

import math

import numpy as np

from ..params import EstimatorParams, StartPose
from .start import BestLimits
from .state import BestNoise

ACC_SHARE = 1.2  # noise of an accelerometer that walks over that of its data sheet
POINT_SHARE = 1.3  # of a point of a foot that is believed to stay over that of one that is doubted at each sample
STATED_SD = 1e-3  # m and rad, of a stated start pose
LEVEL_SD = 0.01  # m, of a point over level ground, per sample of the feet
LOST_SD = 1.0  # m and rad, of an unknown pose


def best_noise(params: EstimatorParams, modes: bool = False) -> BestNoise:
    """Noises of the filter; those of the sensors per square root of s, so that the rate of a log does not matter.

    Args:
        params: of sensors and geometry.
        modes: hypotheses about sliding feet are carried through time (`best_modes`); else each sample is doubted.
    """
    root = math.sqrt(1e-9 * params.imu_period_ns)
    noise = BestNoise(
        gyro=params.sigma_w * root,
        acc=ACC_SHARE * params.sigma_q * root,
        gyro_bias=2e-4,
        turn_bias=2e-5,
        acc_bias=3e-4,
        gyro_jerk=0.15,
        sample_gyro=params.sigma_w,
        point=params.sigma_point,
        stay=0.0002,
        slide=0.04,
        carry=0.25,
        slip=0.012,
        slip_begin=0.003,
        slip_landing=0.05,
        begin_slide=0.6,
        go_on=0.98,
        learn=0.02,
        drop=0.2,
        twist=0.05,
        rock=0.5,
        creep=0.008,
        most_excess=15.0,
        lag_s=5.0,
    )
    if modes:
        noise = noise._replace(
            point=POINT_SHARE * params.sigma_point,
            stay=0.0005,
            gyro_bias=6e-5,
            gyro_jerk=0.12,
            learn=0.05,
            drop=0.3,
            go_on=0.95,
        )
    return noise


def best_limits(params: EstimatorParams, start: StartPose, stated: bool, hypotheses: bool = True) -> BestLimits:
    """Start and rest; `stated`: whether pose and slope at the start are known (again)."""
    return BestLimits(
        samples=params.standstill_samples,
        gyro_variance=params.standstill_gyro_sd**2,
        acc_variance=params.standstill_acc_sd**2,
        travel=params.standstill_travel,
        gyro_bias_sd=params.gyro_bias_sd,
        creep=0.0025,
        turn_creep=0.0005,
        acc_bias_sd=params.acc_bias_sd,
        slope_sd=params.start_slope_sd if stated else math.inf,
        start=np.array([start.x, start.y, start.yaw, start.ground]),
        start_sd=STATED_SD if stated else LOST_SD,
        gap_s=params.gap_periods * 1e-9 * params.imu_period_ns,
        forget_s=1e-9 * params.reset_gap_ns,
        max_speed=params.max_speed,
        level_sd=LEVEL_SD if params.level_ground and stated else math.inf,
        hypotheses=hypotheses,
    )
