"""Judging inputs: every sample gets a named result, refused ones are counted, nothing raises."""

import math
from collections import Counter
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from surefoot.kernels.jit import kernel
from surefoot.services.estimator.params import EstimatorParams
from surefoot.services.estimator.results import InputResult
from surefoot.services.estimator.timeline import ClockJudge

Array = NDArray[np.float64]

FROZEN_ROWS = 50  # equal IMU rows in a row: a live sensor's noise never repeats so long
BAD_MEMORY_NS = 100_000_000  # a refused input spoils `inputs_ok` so long
MEAN_WEIGHT = 0.02  # of a sample in the mean of the accelerometer
UNIT_ROWS = 100  # samples before its mean is judged
GRAVITIES = (0.5, 2.0)  # m/s^2, a mean between these is gravity in g: no robot falls for so long
STEADY_ROWS = 30  # 1 s of equal joint angles while the gyro says that the robot moves


@kernel
def peak(x: Array) -> float:
    """Largest absolute value, infinity if one is not finite."""
    most = 0.0
    for i in range(x.size):
        if not math.isfinite(x[i]):
            return np.inf
        most = max(most, abs(x[i]))
    return most


@kernel
def _look(w: Array, q: Array, row: Array) -> tuple[float, float, bool]:
    """Peaks of gyro and accelerometer, and whether the sample repeats the last `row` (6,)."""
    same = True
    for i in range(3):
        same = same and w[i] == row[i] and q[i] == row[3 + i]
    return peak(w), peak(q), same


@kernel
def _look_at_feet(feet: Array, last: Array) -> tuple[bool, bool, bool]:
    """Whether any number of feet (L, 3) is finite, whether all are, and whether they repeat the last ones."""
    some, every, same = False, True, True
    for i in range(feet.shape[0]):
        for k in range(3):
            finite = math.isfinite(feet[i, k])
            some, every, same = some or finite, every and finite, same and feet[i, k] == last[i, k]
    return some, every, same


def _recent(stamp_ns: int | None, now_ns: int) -> bool:
    return stamp_ns is not None and 0 <= now_ns - stamp_ns < BAD_MEMORY_NS


@dataclass
class InputJudge:
    """Checks and counters of the inputs of one estimator."""

    params: EstimatorParams
    counts: Counter[str] = field(default_factory=Counter)
    """Refusals and gaps by name, e.g. `imu_nonfinite`."""

    def __post_init__(self) -> None:
        self._clocks = {"imu": ClockJudge(), "kinematics": ClockJudge()}
        self._last_row = np.full(6, np.nan)
        self._mean_q, self._mean_rows, self._wrong_side = np.zeros(3), 0, 0
        self._last_feet: Array | None = None
        self.unit = ""
        """What is wrong with the unit or the sign of the accelerometer, in words; empty: nothing."""
        self.refused = 0  # inputs so far
        self._equal_rows = 0
        self._equal_feet = 0
        self.last_bad = ""
        """Name of the last refusal or gap, e.g. `imu_nonfinite`."""
        self._last_bad: int | None = None
        self._last_saturated: int | None = None

    def imu(self, stamp_ns: int, w: Array, q: Array) -> InputResult:
        """Judge an inertial sample."""
        if w.shape != (3,) or q.shape != (3,):
            return self.note("imu", InputResult.SHAPE, stamp_ns)
        peak_w, peak_q, same = _look(w, q, self._last_row)
        if peak_w == np.inf or peak_q == np.inf:
            return self.note("imu", InputResult.NONFINITE, stamp_ns)
        if peak_w >= self.params.max_gyro or peak_q >= self.params.max_acc:
            return self.note("imu", InputResult.SATURATED, stamp_ns)
        if self._other_unit(q):
            return self.note("imu", InputResult.UNIT, stamp_ns)
        before = self._clocks["imu"].newest
        result = self._order("imu", stamp_ns)
        if not result.accepted:
            return result
        self._equal_rows = self._equal_rows + 1 if same else 0
        self._last_row[:3], self._last_row[3:] = w, q
        if result is InputResult.RESTART:
            return result
        if before is not None and stamp_ns - before > self.params.gap_periods * self.params.imu_period_ns:
            return self.note("imu", InputResult.GAP, stamp_ns)
        return InputResult.OK

    def kinematics(self, stamp_ns: int, feet: Array) -> InputResult:
        """Judge the feet (L, 3) of a kinematic sample; a foot that is not finite is left out elsewhere."""
        last = self._last_feet
        some, every, same = _look_at_feet(feet, feet if last is None else last)
        if not some:
            return self.note("kinematics", InputResult.NONFINITE, stamp_ns)
        result = self._order("kinematics", stamp_ns)
        if not result.accepted:
            return result
        if not every:
            self.note("kinematics", InputResult.NONFINITE, stamp_ns)
        self._equal_feet = self._equal_feet + 1 if same and last is not None else 0
        self._last_feet = feet
        return result

    def _other_unit(self, q: Array) -> bool:
        """Whether the mean of the accelerometer is that of one in g, or points to the feet that stand."""
        self._mean_rows += 1
        weight = max(MEAN_WEIGHT, 1.0 / self._mean_rows)
        for i in range(3):
            self._mean_q[i] += weight * (q[i] - self._mean_q[i])
        if self._mean_rows < UNIT_ROWS:
            return False
        self.unit = ""
        x, y, z = self._mean_q.tolist()
        if GRAVITIES[0] < math.sqrt(x * x + y * y + z * z) < GRAVITIES[1]:
            self.unit = "the accelerometer measures in g: factor 9.81"
        elif self._wrong_side >= UNIT_ROWS:
            self.unit = "the accelerometer has the other sign: factor -1"
        return bool(self.unit)

    def standing_feet(self, position: Array, contact: Array) -> None:
        """Compare the accelerometer with the side of the feet (L, 3) that stand: at rest it points away from them."""
        along = 0.0
        for f in range(len(contact)):
            if contact[f] >= 0.5:
                along += sum(float(position[f, i]) * float(self._mean_q[i]) for i in range(3))
        self._wrong_side = min(self._wrong_side + 1, 2 * UNIT_ROWS) if along > 0.0 else max(self._wrong_side - 1, 0)

    def _order(self, source: str, stamp_ns: int) -> InputResult:
        newest = max((c.newest for c in self._clocks.values() if c.newest is not None), default=stamp_ns)
        result = self._clocks[source].judge(stamp_ns, newest)
        if result is InputResult.RESTART:
            for other in self._clocks.values():
                other.newest = None
            self._clocks[source].newest = stamp_ns
        return result if result is InputResult.OK else self.note(source, result, stamp_ns)

    def note(self, source: str, result: InputResult, stamp_ns: int) -> InputResult:
        """Count what became of a sample of `source` and return it."""
        self.last_bad = f"{source}_{result}"
        self.counts[self.last_bad] += 1
        self.refused += not result.accepted
        newest = self._clocks["imu"].newest
        self._last_bad = stamp_ns if newest is None else newest
        if result is InputResult.SATURATED:
            self._last_saturated = self._last_bad
        return result

    def inputs_ok(self, now_ns: int) -> bool:
        """Whether all inputs of the last 100 ms were accepted and in time."""
        return not _recent(self._last_bad, now_ns)

    def saturated(self, now_ns: int) -> bool:
        """Whether the inertial unit was at the end of its range in the last 100 ms."""
        return _recent(self._last_saturated, now_ns)

    @property
    def imu_frozen(self) -> bool:
        """The inertial unit repeats itself."""
        return self._equal_rows >= FROZEN_ROWS and self.params.sigma_w > 0.0

    def joints_frozen(self, moving: bool) -> bool:
        """The encoders repeat themselves while the robot moves."""
        return moving and self._equal_feet >= STEADY_ROWS
