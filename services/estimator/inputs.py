"""Judging inputs: every sample gets a named result, refused ones are counted, nothing raises."""

import math
from collections import Counter
from dataclasses import dataclass, field
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray

from surefoot.kernels.jit import kernel
from surefoot.services.estimator.params import EstimatorParams

Array = NDArray[np.float64]

RESYNC_AFTER = 20  # consecutive samples of an older but orderly clock: the source restarted its clock
FROZEN_ROWS = 50  # equal IMU rows in a row: a live sensor's noise never repeats so long
BAD_MEMORY_NS = 100_000_000  # a refused input spoils `inputs_ok` so long
STEADY_ROWS = 30  # 1 s of equal joint angles while the gyro says that the robot moves


class InputResult(StrEnum):
    """What became of an input; all but the first three are refusals."""

    OK = "ok"
    GAP = "gap"  # accepted after missing samples
    RESTART = "restart"  # accepted: the source's clock began anew
    NONFINITE = "nonfinite"
    SHAPE = "shape"
    BACKWARD = "backward"
    DUPLICATE = "duplicate"
    LATE = "late"
    SATURATED = "saturated"
    IMPLAUSIBLE = "implausible"

    @property
    def accepted(self) -> bool:
        """Whether the sample is used."""
        return self in (InputResult.OK, InputResult.GAP, InputResult.RESTART)


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
class StampCheck:
    """Order of the stamps of one source."""

    last: int | None = None
    _older: int = 0
    _older_last: int = 0

    def judge(self, stamp_ns: int) -> InputResult:
        """`ok`, `duplicate` or `backward`; a clock that restarted is accepted after `RESYNC_AFTER` orderly samples."""
        if self.last is None or stamp_ns > self.last:
            self._older = 0
            return InputResult.OK
        if stamp_ns == self.last:
            return InputResult.DUPLICATE
        self._older = self._older + 1 if self._older and stamp_ns > self._older_last else 1
        self._older_last = stamp_ns
        if self._older < RESYNC_AFTER:
            return InputResult.BACKWARD
        self.last = None
        self._older = 0
        return InputResult.RESTART


@dataclass
class InputJudge:
    """Checks and counters of the inputs of one estimator."""

    params: EstimatorParams
    counts: Counter[str] = field(default_factory=Counter)
    """Refusals and gaps by name, e.g. `imu_nonfinite`."""

    def __post_init__(self) -> None:
        self._imu, self._kinematics = StampCheck(), StampCheck()
        self._last_row = np.full(6, np.nan)
        self._last_feet: Array | None = None
        self.refused = 0  # inputs so far
        self._equal_rows = 0
        self._equal_feet = 0
        self._last_bad: int | None = None
        self._last_saturated: int | None = None

    def imu(self, stamp_ns: int, w: Array, q: Array) -> tuple[InputResult, int]:
        """Judge an inertial sample; returns the result and the time since the last accepted one, ns (0: first)."""
        if w.shape != (3,) or q.shape != (3,):
            return self._note("imu", InputResult.SHAPE, stamp_ns), 0
        peak_w, peak_q, same = _look(w, q, self._last_row)
        if peak_w == np.inf or peak_q == np.inf:
            return self._note("imu", InputResult.NONFINITE, stamp_ns), 0
        result = self._imu.judge(stamp_ns)
        if not result.accepted:
            return self._note("imu", result, stamp_ns), 0
        if peak_w >= self.params.max_gyro or peak_q >= self.params.max_acc:
            return self._note("imu", InputResult.SATURATED, stamp_ns), 0
        step = 0 if self._imu.last is None else stamp_ns - self._imu.last
        self._imu.last = stamp_ns
        self._equal_rows = self._equal_rows + 1 if same else 0
        self._last_row[:3], self._last_row[3:] = w, q
        if result is InputResult.RESTART:
            return self._note("imu", result, stamp_ns), 0
        if step > self.params.gap_periods * self.params.imu_period_ns:
            return self._note("imu", InputResult.GAP, stamp_ns), step
        return InputResult.OK, step

    def kinematics(self, stamp_ns: int, feet: Array, now_ns: int) -> InputResult:
        """Judge the feet (L, 3) of a kinematic sample; a foot that is not finite is left out elsewhere."""
        last = self._last_feet
        some, every, same = _look_at_feet(feet, feet if last is None else last)
        if not some:
            return self._note("kinematics", InputResult.NONFINITE, stamp_ns)
        result = self._kinematics.judge(stamp_ns)
        if not result.accepted:
            return self._note("kinematics", result, stamp_ns)
        if now_ns - stamp_ns > self.params.late_ns:
            return self._note("kinematics", InputResult.LATE, stamp_ns)
        if not every:
            self._note("kinematics", InputResult.NONFINITE, stamp_ns)
        self._kinematics.last = stamp_ns
        self._equal_feet = self._equal_feet + 1 if same and last is not None else 0
        self._last_feet = feet
        return InputResult.OK

    def shape(self, stamp_ns: int) -> InputResult:
        """Note a sample of the wrong length."""
        return self._note("kinematics", InputResult.SHAPE, stamp_ns)

    def clipped(self, stamp_ns: int) -> InputResult:
        """Note an inertial sample that its driver marks as clipped."""
        return self._note("imu", InputResult.SATURATED, stamp_ns)

    def implausible(self, stamp_ns: int) -> InputResult:
        """Note legs that move faster than any robot."""
        return self._note("kinematics", InputResult.IMPLAUSIBLE, stamp_ns)

    def _note(self, source: str, result: InputResult, stamp_ns: int) -> InputResult:
        self.counts[f"{source}_{result}"] += 1
        self.refused += not result.accepted
        self._last_bad = self._imu.last if self._imu.last is not None else stamp_ns
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
