"""The `best` estimator: velocity, tilt, biases, position and heading by one filter over all samples in their order."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from surefoot.kernels.box import Box
from surefoot.kernels.jit import kernel
from surefoot.services.estimator.best_cell import Cell, boxed, new_clock, take_feet, take_imu
from surefoot.services.estimator.best_kernel import BestNoise, new_state
from surefoot.services.estimator.best_log import LogInputs, LogRows, follow_log
from surefoot.services.estimator.best_memory import bring_up, clear, new_memory
from surefoot.services.estimator.best_modes import modes_of
from surefoot.services.estimator.best_start import BestGeometry, BestLimits
from surefoot.services.estimator.best_summary import summary
from surefoot.services.estimator.inputs import InputJudge

Array = NDArray[np.float64]


class BestOutput(NamedTuple):
    """The estimate at the newest inertial sample."""

    g: Array  # (3,) m/s^2, IMU axes, points up
    v: Array  # (3,) m/s, IMU axes
    covariance: Array  # (6, 6) of (g, v)
    position: Array  # (3,) m, base_link in odom
    quat_wxyz: Array  # (4,) rot_odom_from_base
    v_odom: Array  # (3,) m/s, base_link
    pose_covariance: Array  # (4, 4) of x, y, z, yaw
    gyro_bias: Array  # (3,) rad/s
    acc_bias: Array  # (3,) m/s^2
    sliding: Array  # (L,) probability that a foot slides; NaN: it does not stand
    yaw: float  # rad
    nis: float  # 3 degrees of freedom
    excess: float  # factor of the inertial noise
    standing: bool
    settled: bool


@kernel
def report(box: Box[Cell]) -> tuple[Array, Array, Array, Array]:
    """Bring the state up to the newest inertial sample, in place; return what `summary` does."""
    cell = box.parts
    bring_up(cell.memory, cell.state, cell.geometry, cell.noise, cell.limits)
    return summary(cell.state, cell.geometry, cell.clock.w, cell.judge.feet.shape[0])


class BestFilter:
    """Takes samples in any order within the last half second; the result is that of their order by stamps, to the bit.

    Args:
        geometry: of the robot.
        noise: of the filter.
        limits: of start and rest.
        judge: of the inputs.
    """

    def __init__(self, geometry: BestGeometry, noise: BestNoise, limits: BestLimits, judge: InputJudge) -> None:
        feet, points = judge.state.feet.shape[0], len(geometry.foot)
        modes = modes_of(feet) if limits.hypotheses else 0
        memory, state = new_memory(feet, points, modes), new_state(points, modes)
        clear(memory, state)
        self.__setstate__(
            Cell(new_clock(), judge.state, judge.limits, judge.noisy, memory, state, geometry, noise, limits)
        )

    def __getstate__(self) -> Cell:
        return self.cell

    def __setstate__(self, cell: Cell) -> None:
        self.cell, self._box = cell, boxed(cell)  # the same arrays
        self._output: BestOutput | None = None

    def imu(self, stamp_ns: int, w: Array, q: Array, clipped: bool) -> int:
        """Take an inertial sample, see `take_imu`."""
        self._output = None
        return take_imu(self._box, stamp_ns, w, q, clipped)

    def feet(self, stamp_ns: int, position: Array, rot: Array, contact: Array) -> int:
        """Take a sample of the feet, see `take_feet`."""
        self._output = None
        return take_feet(self._box, stamp_ns, position, rot, contact)

    def follow(self, log: LogInputs, order: NDArray[np.int64], rows: LogRows, first: int) -> None:
        """Take inputs of a log and write the estimates, see `follow_log`."""
        self._output = None
        follow_log(order, log, rows, first, self._box)

    @property
    def output(self) -> BestOutput:
        """The estimate at the newest inertial sample; late samples cost one replay of at most the window."""
        if self._output is None:
            rows, more, covariance, pose = report(self._box)
            yaw, settled, standing = rows[6].tolist()
            nis, excess, _ = rows[7].tolist()
            self._output = BestOutput(
                rows[0], rows[1], covariance, rows[2], more[:4], rows[3], pose, rows[4], rows[5], more[4:], yaw, nis,
                excess, standing > 0.0, settled > 0.0,
            )  # fmt: skip
        return self._output
