"""The `best` estimator over the rows of a log in their order of arrival, without the interpreter in between.

The same kernels in the same order as `stream.Estimator` calls for one sample after the other: estimates are equal to
the bit.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from surefoot.geometry.rotations import wrap_angle
from surefoot.kernels.box import KernelBox
from surefoot.kernels.jit import inner_kernel, kernel

from ..health import flags_of
from ..inputs.judge import REFUSED
from ..inputs.results import RESTART
from .cell import Cell, put_feet, put_imu, restart, take_feet, take_imu
from .memory import bring_up
from .summary import condition, summary

Array = NDArray[np.float64]
Ints = NDArray[np.int64]
Flags = NDArray[np.bool_]

FLAGS = ("initialised", "standing", "inputs_ok", "filter_ok", "sensors_ok")
"""Columns of `LogRows.flags`."""


class LogInputs(NamedTuple):
    """n inertial rows and m samples of L feet."""

    stamp_ns: Ints  # (n,)
    w: Array  # (n, 3) rad/s
    q: Array  # (n, 3) m/s^2
    clipped: Flags  # (n,)
    foot_ns: Ints  # (m,)
    position: Array  # (m, L, 3) m, IMU axes
    rot: Array  # (m, L, 3, 3) rot_imu_from_foot
    contact: Array  # (m, L, S) probability at each switch, NaN = unknown


class LogRows(NamedTuple):
    """Estimates at n inertial rows."""

    vectors: Array  # (n, 8, 3) as `best_summary.summary`
    more: Array  # (n, 4 + L) quaternion of base_link in odom, probability of sliding of each foot
    covariance: Array  # (n, 6, 6) of (g, v)
    pose: Array  # (n, 4, 4) covariance of x, y, z, yaw
    yaw: Array  # (n,) rad, not wrapped
    flags: Flags  # (n, 5)
    refused: Ints  # (n,) inputs refused so far


def new_rows(n: int, feet: int) -> LogRows:
    """Return room for n rows of L feet."""
    return LogRows(
        np.zeros((n, 8, 3)), np.zeros((n, 4 + feet)), np.zeros((n, 6, 6)), np.zeros((n, 4, 4)),
        np.zeros(n), np.zeros((n, len(FLAGS)), dtype=np.bool_), np.zeros(n, dtype=np.int64),
    )  # fmt: skip


@inner_kernel
def _note_row(rows: LogRows, at: int, cell: Cell) -> None:
    """Write the estimate into a row."""
    clock, flags = cell.clock, rows.flags
    vectors, more, covariance, pose = summary(cell.state, cell.geometry, clock.w, cell.judge.feet.shape[0])
    rows.vectors[at], rows.more[at], rows.covariance[at], rows.pose[at] = vectors, more, covariance, pose
    clock.yaw[0] += wrap_angle(vectors[6, 0] - clock.yaw[0])
    rows.yaw[at], rows.refused[at] = clock.yaw[0], cell.judge.marks[REFUSED]
    c = condition(cell, vectors, more, covariance)
    flags[at, 0], flags[at, 1] = c.initialised, c.standing
    flags[at, 2], flags[at, 3], flags[at, 4] = flags_of(c)


@kernel
def follow_log(order: Ints, log: LogInputs, rows: LogRows, first: int, box: KernelBox[Cell]) -> None:
    """Take the inputs of a log, in place, and write the estimate after each inertial row and the feet that follow it.

    Args:
        order: of arrival: the number of an inertial row, or n + that of a sample of the feet.
        log: the inputs.
        rows: for the estimates, those of row `first` and later.
        first: see `rows`.
        box: of the filter.
    """
    n, row, cell = log.stamp_ns.size, -1, box.parts
    for i in range(order.size):
        at = order[i]
        if at < n:
            stamp_ns, w, q = int(log.stamp_ns[at]), log.w[at], log.q[at]
            if take_imu(box, stamp_ns, w, q, log.clipped[at]) == RESTART:  # pyright: ignore[reportArgumentType]
                bring_up(cell.memory, cell.state, cell.geometry, cell.noise, cell.limits)
                restart(box)
                put_imu(box, stamp_ns, w, q, RESTART)
            row = at - first
        else:
            m = at - n
            stamp_ns, position, rot, contact = int(log.foot_ns[m]), log.position[m], log.rot[m], log.contact[m]
            if take_feet(box, stamp_ns, position, rot, contact) == RESTART:
                bring_up(cell.memory, cell.state, cell.geometry, cell.noise, cell.limits)
                restart(box)
                put_feet(box, stamp_ns, position, rot, contact, RESTART)
        if row >= 0 and (i + 1 == order.size or order[i + 1] < n):
            bring_up(cell.memory, cell.state, cell.geometry, cell.noise, cell.limits)
            _note_row(rows, row, cell)
