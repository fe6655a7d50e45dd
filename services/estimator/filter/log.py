"""The `best` estimator over the rows of a log in their order of arrival, without the interpreter in between.

It calls the kernels that `stream.Estimator` calls, in the same order: estimates are equal to the bit.
"""

from typing import NamedTuple

import numpy as np

from surefoot.arrays import Array, Flags, Ints
from surefoot.geometry.rotations import wrap_angle
from surefoot.kernels.box import KernelBox
from surefoot.kernels.jit import inner_kernel, kernel

from ..health import LegSensors, flags_of
from ..inputs.check import BAD_CODE, REFUSED
from ..inputs.results import OK, RESTART, STEPPED
from .intake import FilterParts, restart, take_external, take_feet, take_imu
from .replay import bring_up
from .samples import EXTERNAL_WIDTH
from .state import rotation
from .summary import QUAT, YAW, condition, joint_covariance, summary

FLAGS = ("initialised", "standing", "inputs_ok", "filter_ok", "sensors_ok")
"""Names of the columns of `LogRows.flags`, in order."""
NAMED = (*LegSensors._fields, "refused", "imu_frozen")
"""Names of the columns of `LogRows.named`: fields of `LegSensors`, code of a recent refusal (0 = none), frozen IMU."""


class LogInputs(NamedTuple):
    """Inputs of a log as arrays, all vectors in IMU axes: n inertial rows, m samples of L feet, e of another source.

    w is the gyro, q the accelerometer; stamps are in ns; `clipped`: True where an axis was at the end of its range.
    """

    stamp_ns: Ints  # (n,)
    w: Array  # (n, 3) rad/s
    q: Array  # (n, 3) m/s^2
    clipped: Flags  # (n,)
    foot_ns: Ints  # (m,)
    position: Array  # (m, L, 3) m, IMU axes
    rot: Array  # (m, L, 3, 3) rot_imu_from_foot
    contact: Array  # (m, L, S) probability at each switch, NaN = unknown
    external_ns: Ints = np.zeros(0, dtype=np.int64)  # (e,) samples from elsewhere
    external: Array = np.zeros((0, EXTERNAL_WIDTH))  # (e, 26) see `samples.ExternalLayout`


class LogRows(NamedTuple):
    """Estimates of the `best` filter after each of n inertial samples of a log, one row each.

    vectors: (n, 8, 3) as in `RowLayout`; more: quaternion of base_link in odom and probability that each of L feet
    slides, (n, 4 + L); covariance of (g, v), (n, 6, 6), and of the pose, (n, 6, 6); yaw: (n,) rad, not wrapped; flags:
    (n, 5) in the order of `FLAGS`; refused: inputs refused so far, (n,); named: (n, 8) in the order of `NAMED`; joint:
    covariance of g, v, gyro and accelerometer bias, (n, 12, 12), or (0, 12, 12) if not wanted.
    """

    vectors: Array  # (n, 8, 3) see `summary.RowLayout`
    more: Array  # (n, 4 + L) quaternion of base_link in odom, probability of sliding of each foot
    covariance: Array  # (n, 6, 6) of (g, v)
    pose: Array  # (n, 6, 6) covariance of the pose, see `pose.pose_covariance`
    yaw: Array  # (n,) rad, not wrapped
    flags: Flags  # (n, 5)
    refused: Ints  # (n,) inputs refused so far
    named: Ints  # (n, 8) see `NAMED`
    joint: (
        Array  # (n, 12, 12) covariance of (g, v) and the biases of gyro and accelerometer, or (0, 12, 12): not wanted
    )


def new_rows(n: int, feet: int, joint: bool = False) -> LogRows:
    """Return zeros for n estimates of a robot with `feet` feet; `joint`: True includes `LogRows.joint`."""
    return LogRows(
        np.zeros((n, 8, 3)), np.zeros((n, QUAT + feet)), np.zeros((n, 6, 6)), np.zeros((n, 6, 6)),
        np.zeros(n), np.zeros((n, len(FLAGS)), dtype=np.bool_), np.zeros(n, dtype=np.int64),
        np.zeros((n, len(NAMED)), dtype=np.int64),
        np.zeros((n if joint else 0, 12, 12)),
    )  # fmt: skip


@inner_kernel
def _note_row(rows: LogRows, at: int, parts: FilterParts) -> None:
    """Write the estimate of the filter `parts` into row `at` of `rows`, in place."""
    clock, flags = parts.clock, rows.flags
    vectors, more, covariance, pose = summary(parts.state, parts.setting.geometry, clock.w, parts.check.feet.shape[0])
    rows.vectors[at], rows.more[at], rows.covariance[at], rows.pose[at] = vectors, more, covariance, pose
    if rows.joint.shape[0] > 0:
        rows.joint[at] = joint_covariance(rotation(parts.state.x), parts.state.cov)
    clock.yaw[0] += wrap_angle(vectors[YAW] - clock.yaw[0])
    rows.yaw[at], rows.refused[at] = clock.yaw[0], parts.check.marks[REFUSED]
    c = condition(parts, vectors, more, covariance)
    flags[at, 0], flags[at, 1] = c.initialised, c.standing
    flags[at, 2], flags[at, 3], flags[at, 4] = flags_of(c)
    named = rows.named[at]
    named[0], named[1], named[2], named[3], named[4], named[5] = c.legs
    named[6], named[7] = (parts.check.marks[BAD_CODE] if c.faults.refused else 0), c.faults.imu_frozen


@kernel
def follow_log(order: Ints, log: LogInputs, rows: LogRows, first: int, box: KernelBox[FilterParts]) -> None:
    """Take the inputs of a log and write the estimate after each inertial row and the feet that follow it, in place.

    Args:
        order: inputs in their order of arrival, (k,): the number of an inertial row, n + that of a sample of the feet,
            or n + m + that of one of another source.
        log: n inertial rows, m samples of the feet and those of another source, SI.
        rows: for the estimates; inertial row `first` + i goes to row i; changed.
        first: first inertial row that gets an estimate.
        box: parts of the filter, whose arrays are changed.
    """
    n, row, parts = log.stamp_ns.size, -1, box.parts
    feet_end = n + log.foot_ns.size
    for i in range(order.size):
        at = order[i]
        if at < n:
            stamp_ns, w, q = int(log.stamp_ns[at]), log.w[at], log.q[at]
            clipped = log.clipped[at]
            code = take_imu(box, stamp_ns, w, q, clipped, OK)  # pyright: ignore[reportArgumentType]
            if RESTART <= code <= STEPPED:
                bring_up(parts.replay, parts.state, parts.setting)
                restart(box, stamp_ns)
                take_imu(box, stamp_ns, w, q, clipped, code)  # pyright: ignore[reportArgumentType]
            row = at - first
        elif at >= feet_end:
            e = at - feet_end
            take_external(box, int(log.external_ns[e]), log.external[e])
        else:
            m = at - n
            stamp_ns, position, rot, contact = int(log.foot_ns[m]), log.position[m], log.rot[m], log.contact[m]
            code = take_feet(box, stamp_ns, position, rot, contact, OK)
            if RESTART <= code <= STEPPED:
                bring_up(parts.replay, parts.state, parts.setting)
                restart(box, stamp_ns)
                take_feet(box, stamp_ns, position, rot, contact, code)
        if row >= 0 and (i + 1 == order.size or order[i + 1] < n):
            bring_up(parts.replay, parts.state, parts.setting)
            _note_row(rows, row, parts)
