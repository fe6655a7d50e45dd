"""The `best` estimator: velocity, tilt, biases, position and heading by one filter over all samples in their order."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from surefoot.kernels.box import KernelBox
from surefoot.kernels.jit import kernel

from ..feet.contact import BestGeometry
from ..health import Condition, flags_of, is_quiet
from ..inputs.counted import InputJudge
from ..inputs.results import RESTART
from ..output import express
from .cell import (
    Cell,
    boxed,
    new_clock,
    put_feet,
    put_imu,
    restart,
    take_feet,
    take_imu,
)
from .hypotheses import modes_of
from .log import LogInputs, LogRows, follow_log
from .memory import bring_up, clear, new_memory
from .start import BestLimits
from .state import BestNoise, new_state
from .summary import SLIDES, condition, summary

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]


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
    since_contact_s: float
    standing: bool
    settled: bool
    slipping: Flags  # (L,)
    expressed: Array  # (5, 3) see `express`
    flags: tuple[bool, bool, bool]  # see `flags_of`
    quiet: bool  # see `is_quiet`


@kernel
def report(
    box: KernelBox[Cell],
) -> tuple[Array, Array, Array, Array, Flags, Array, float, bool, bool, bool, tuple[bool, bool, bool]]:
    """Bring the state up to the newest inertial sample, in place.

    Returns:
        What `summary` does; slipping, expressed, since_contact_s, standing, settled, quiet and flags of `BestOutput`.
    """
    cell = box.parts
    bring_up(cell.memory, cell.state, cell.geometry, cell.noise, cell.limits)
    geometry, w, feet = cell.geometry, cell.clock.w, cell.judge.feet.shape[0]
    rows, more, covariance, pose = summary(cell.state, geometry, w, feet)
    expressed = express(rows[0], rows[1], w - rows[4], geometry.rot_base_from_imu, geometry.imu_position)
    slipping, c = more[4:] > SLIDES, condition(cell, rows, more, covariance)
    return (
        rows, more, covariance, pose, slipping, expressed, c.since_contact_s, c.standing, c.initialised, is_quiet(c),
        flags_of(c),
    )  # fmt: skip


@kernel
def condition_now(box: KernelBox[Cell]) -> Condition:
    """Return the condition of a state that has been brought up."""
    cell = box.parts
    rows, more, covariance, _ = summary(cell.state, cell.geometry, cell.clock.w, cell.judge.feet.shape[0])
    return condition(cell, rows, more, covariance)


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
        self.outdate()

    def outdate(self) -> None:
        """Compute output and condition anew when they are asked for: a sample came, or was refused."""
        self._output: BestOutput | None = None
        self._condition: Condition | None = None

    def imu(self, stamp_ns: int, w: Array, q: Array, clipped: bool) -> int:
        """Take an inertial sample, see `take_imu`."""
        self.outdate()
        code = take_imu(self._box, stamp_ns, w, q, clipped)
        if code == RESTART:
            self._restart()
            code = put_imu(self._box, stamp_ns, w, q, code)
        return code

    def feet(self, stamp_ns: int, position: Array, rot: Array, contact: Array) -> int:
        """Take a sample of the feet, see `take_feet`."""
        self.outdate()
        code = take_feet(self._box, stamp_ns, position, rot, contact)
        if code == RESTART:
            self._restart()
            code = put_feet(self._box, stamp_ns, position, rot, contact, code)
        return code

    def _restart(self) -> None:
        report(self._box)
        restart(self._box)

    def follow(self, log: LogInputs, order: NDArray[np.int64], rows: LogRows, first: int) -> None:
        """Take inputs of a log and write the estimates, see `follow_log`."""
        self.outdate()
        follow_log(order, log, rows, first, self._box)

    @property
    def output(self) -> BestOutput:
        """The estimate at the newest inertial sample; late samples cost one replay of at most the window."""
        if self._output is None:
            rows, more, covariance, pose, slipping, expressed, since, standing, settled, quiet, flags = report(
                self._box
            )
            g, v, position, v_odom, gyro_bias, acc_bias, turn, fit = rows
            nis, excess, _ = fit.tolist()
            self._output = BestOutput(
                g, v, covariance, position, more[:4], v_odom, pose, gyro_bias, acc_bias, more[4:], float(turn[0]), nis,
                excess, since, standing, settled, slipping, expressed, flags, quiet,
            )  # fmt: skip
        return self._output

    @property
    def condition(self) -> Condition:
        """Numbers from which flags and reasons of the output follow."""
        if self._condition is None:
            _ = self.output  # brings the state up
            self._condition = condition_now(self._box)
        return self._condition
