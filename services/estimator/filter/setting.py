"""Noises and limits of the `best` filter from the parameters of a robot's sensors and geometry."""

import math

from ..params import EstimatorParams, StartPose
from .noise import FIXED, BestLimits, BestNoise


def best_noise(params: EstimatorParams, modes: bool = False) -> BestNoise:
    """Return the noises of the filter.

    Args:
        params: parameters of sensors and geometry.
        modes: True: hypotheses about sliding feet are carried through time (`hypotheses`); False: each sample is mixed.
    """
    root, point = math.sqrt(1e-9 * params.imu_period_ns), max(params.sigma_point, FIXED.least_point)
    noise = BestNoise(
        params.sigma_w * root, FIXED.acc_share * params.sigma_q * root, params.sigma_w, params.sigma_q, point, point
    )
    if modes:
        noise = noise._replace(
            point=FIXED.point_share * point, stay=0.0005, gyro_bias=6e-5, gyro_jerk=0.12, turn_jerk=0.12,
            slide=0.04, go_on=0.95,
        )  # fmt: skip
    return noise


def best_limits(params: EstimatorParams, start: StartPose, stated: bool, hypotheses: bool = True) -> BestLimits:
    """Return limits of start and rest of the filter; `stated`: True if pose and slope at the start are known."""
    faster = FIXED.rest_period_s / (1e-9 * params.imu_period_ns)
    samples = min(round(params.standstill_samples * max(faster, 1.0)), FIXED.most_samples)
    return BestLimits(
        samples=samples, rest_s=FIXED.rest_period_s * params.standstill_samples,
        travel=params.standstill_travel, max_speed=params.max_speed,
        gyro_variance=params.standstill_gyro_sd**2, acc_variance=params.standstill_acc_sd**2,
        gyro_bias_sd=params.gyro_bias_sd, acc_bias_sd=params.acc_bias_sd, hypotheses=hypotheses,
        slope_sd=params.start_slope_sd if stated else math.inf, start=StartPose(*map(float, start)),
        start_sd=FIXED.stated_sd if stated else FIXED.lost_sd, gap_s=params.gap_periods * 1e-9 * params.imu_period_ns,
        forget_s=1e-9 * params.reset_gap_ns, level_sd=FIXED.level_sd if params.level_ground and stated else math.inf,
        levels=params.levels and not (params.level_ground and stated),
    )  # fmt: skip
