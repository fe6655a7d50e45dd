"""What became of the inputs, by name: refusals counted, and what is wrong now."""

from collections import Counter

from ..params import EstimatorParams
from .judge import (
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
    JudgeLimits,
    new_judge,
    note,
)
from .results import RESULTS, InputResult
from .timeline import bounded

FROZEN_NS = 250_000_000  # an inertial unit that repeats one sample for so long is no live one,
FROZEN_ROWS = 20  # unless that is fewer samples: a coarse one at rest repeated 12


class InputJudge:
    """Limits and counters of the inputs of one estimator; kernels judge and count.

    Args:
        params: limits.
        feet: their number L.
        points: number of contact points K.
    """

    def __init__(self, params: EstimatorParams, feet: int, points: int) -> None:
        frozen = max(FROZEN_ROWS, round(FROZEN_NS / params.imu_period_ns))
        self.limits = JudgeLimits(params.max_gyro, params.max_acc, params.gap_periods * params.imu_period_ns, frozen)
        self.state = new_judge(feet, points)
        self.noisy = params.sigma_w > 0.0  # equal samples are no chance

    def note(self, source: str, result: InputResult, stamp_ns: int) -> InputResult:
        """Count what became of a sample of `source` and return it."""
        note(self.state, SOURCES.index(source), RESULTS.index(result), bounded(stamp_ns))
        return result

    @property
    def counts(self) -> Counter[str]:
        """Refusals and gaps by name, e.g. `imu_nonfinite`."""
        counts = self.state.counts.tolist()
        return Counter({
            f"{SOURCES[i]}_{result}": counts[i][code] for i in (IMU, KINEMATICS) for code, result in enumerate(RESULTS)
            if counts[i][code]
        })  # fmt: skip

    @property
    def refused(self) -> int:
        """Inputs refused so far."""
        return int(self.state.marks[REFUSED])

    @property
    def unit(self) -> str:
        """What is wrong with the unit or the sign of a sensor, in words; empty: nothing."""
        return UNIT_WORDS[self.state.marks[UNITS]]

    @property
    def last_bad(self) -> str:
        """Name of the last refusal or gap, e.g. `imu_nonfinite`; empty: there was none."""
        marks = self.state.marks
        return "" if marks[BAD_NS] == NEVER else f"{SOURCES[marks[BAD_SOURCE]]}_{RESULTS[marks[BAD_CODE]]}"
