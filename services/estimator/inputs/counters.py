"""Counters of refused inputs by name, and the present faults."""

from collections import Counter

from ..params import EstimatorParams
from .check import (
    BAD_CODE,
    BAD_NS,
    BAD_SOURCE,
    IMU,
    KINEMATICS,
    NEVER,
    REFUSED,
    SOURCES,
    UNIT_WORDS,
    UNITS,
    CheckLimits,
    count_result,
    new_check,
)
from .clock import bounded
from .results import RESULTS, InputResult

FROZEN_NS = 250_000_000
"""Time for which an inertial unit has to repeat one sample to count as frozen, ns."""
FROZEN_ROWS = 20
"""Least number of equal inertial samples in a row by which a unit is frozen: a coarse one at rest repeated 12."""


class InputCheck:
    """Limits and counters of the inputs of one estimator; kernels check and count.

    Args:
        params: limits and noises of the sensors.
        feet: number L of feet.
        points: number K of contact points.
    """

    def __init__(self, params: EstimatorParams, feet: int, points: int) -> None:
        frozen = max(FROZEN_ROWS, round(FROZEN_NS / params.imu_period_ns))
        self.limits = CheckLimits(
            params.max_gyro,
            params.max_acc,
            params.gap_periods * params.imu_period_ns,
            float(params.imu_period_ns),
            frozen,
        )
        self.state = new_check(feet, points)
        self.noisy = params.sigma_w > 0.0  # equal samples are no chance
        self.external = Counter[str]()
        """Number of refused samples of other sources (camera, GNSS), by name, e.g. `external_late`."""

    def count(self, source: str, result: InputResult, stamp_ns: int) -> InputResult:
        """Count the result of a sample and return it.

        Args:
            source: source of the sample, `imu` or `kinematics` (joints or feet).
            result: result of the sample's check.
            stamp_ns: stamp of the sample, ns.
        """
        count_result(self.state, SOURCES.index(source), RESULTS.index(result), bounded(stamp_ns))
        return result

    @property
    def counts(self) -> Counter[str]:
        """Number of refusals and gaps by name: source and result, e.g. `imu_nonfinite`."""
        counts = self.state.counts.tolist()
        return Counter({
            f"{SOURCES[i]}_{result}": counts[i][code] for i in (IMU, KINEMATICS) for code, result in enumerate(RESULTS)
            if counts[i][code]
        }) + self.external  # fmt: skip

    @property
    def refused(self) -> int:
        """Number of samples of the inertial unit and the feet that were refused so far."""
        return int(self.state.marks[REFUSED])

    @property
    def unit(self) -> str:
        """Text about the wrong unit or sign of a sensor; empty: all are right."""
        return UNIT_WORDS[self.state.marks[UNITS]]

    @property
    def last_bad(self) -> str:
        """Name of the last refusal or gap, e.g. `imu_nonfinite`; empty before the first."""
        marks = self.state.marks
        return "" if marks[BAD_NS] == NEVER else f"{SOURCES[marks[BAD_SOURCE]]}_{RESULTS[marks[BAD_CODE]]}"
