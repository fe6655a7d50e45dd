"""The `best` estimator: velocity, tilt, biases, position and heading by one filter over all samples in their order."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from surefoot.arrays import Array, Flags
from surefoot.kernels.box import KernelBox
from surefoot.kernels.jit import kernel

from ..feet.contact import BestGeometry
from ..health import Condition, flags_of, is_quiet
from ..inputs.counters import InputCheck
from ..inputs.results import OK, RESTART, STEPPED
from ..output import express
from .hypotheses import modes_of
from .intake import FilterParts, boxed, new_clock, restart, take_external, take_feet, take_imu
from .layout import M, X
from .log import LogInputs, LogRows, follow_log
from .noise import FIXED, BestLimits, BestNoise, BestSetting
from .replay import bring_up, clear, new_replay
from .samples import EXTERNAL_CAPACITY
from .state import FRAME, fit_in, new_state
from .summary import QUAT, R, condition, summary

MOST_WAITING = EXTERNAL_CAPACITY // 2
"""Largest number of samples that wait for the next request of an estimate; then the state takes them."""


class BestOutput(NamedTuple):
    """Estimate of the `best` filter at the newest inertial sample, for L feet; `settled`: True = it can be used.

    g: specific force at rest, IMU axes, m/s^2; v: velocity of the IMU, IMU axes, m/s; covariance: of (g, v), (6, 6);
    position and quat_wxyz: base_link in odom, m; v_odom: of base_link, odom axes, m/s; pose_covariance: of x, y, z and
    the rotation about them, odom axes, (6, 6); biases: IMU axes, rad/s and m/s^2; sliding: probability that a foot
    slides, (L,), NaN = it does not touch the ground; slipping: `sliding` > 0.5, (L,); standing: True = the robot is at
    rest; nis: normalised innovation squared, 3 degrees of freedom; excess: factor of the inertial noise; expressed,
    (5, 3): velocity of base_link in its own axes, then in heading axes, m/s, turn rate, rad/s, and g, m/s^2, in
    base_link axes, (roll, pitch, 0), rad; flags: inputs_ok, filter_ok, sensors_ok; quiet: True = nothing to report but
    that the robot stands.
    """

    g: Array  # (3,) m/s^2, IMU axes, points up
    v: Array  # (3,) m/s, IMU axes
    covariance: Array  # (6, 6) of (g, v)
    position: Array  # (3,) m, base_link in odom
    quat_wxyz: Array  # (4,) rot_odom_from_base
    v_odom: Array  # (3,) m/s, base_link
    pose_covariance: Array  # (6, 6) of x, y, z and the rotation about x, y, z, odom axes
    gyro_bias: Array  # (3,) rad/s
    acc_bias: Array  # (3,) m/s^2
    sliding: Array  # (L,) probability that a foot slides; NaN: it does not stand
    yaw: float  # rad
    nis: float  # 3 degrees of freedom
    excess: float  # factor of the inertial noise
    standing: bool
    settled: bool
    slipping: Flags  # (L,)
    expressed: Array  # (5, 3) see `express`
    flags: tuple[bool, bool, bool]  # see `flags_of`
    quiet: bool  # see `is_quiet`


class ExternalUse(NamedTuple):
    """Counts of the poses and velocities of other sources, e.g. a camera, and the turn of their frame against odom.

    left_out: number of samples that contradicted the estimate; frames: times that the frame of their poses was found, 1
    and one more for each jump of it; yaw: rad, NaN = unknown.
    """

    used: int
    left_out: int  # since they contradicted the estimate
    frames: int  # times that the frame of their poses was found: 1, and one more for each jump of it
    yaw: float  # rad, turn of that frame against odom; NaN: unknown


@kernel
def report(
    box: KernelBox[FilterParts],
) -> tuple[Array, Array, Array, Array, Flags, Array, bool, bool, bool, tuple[bool, bool, bool]]:
    """Bring the state up to the newest inertial sample, in place, and return the estimate there.

    Args:
        box: parts of the filter, whose arrays are changed.

    Returns:
        Vectors by rows (8, 3): g, v, position, velocity in odom, biases, heading and counts, fit, SI, as in
        `RowLayout`.

        Quaternion (w, x, y, z) of base_link in odom and probability that each of L feet slides, (4 + L,).

        Covariance of (g, v) in IMU axes, (6, 6), and covariance of the pose in odom, (6, 6), m and rad.

        Which feet slip, (L,) bool; rows velocity, heading velocity, turn, g in base_link and (roll, pitch, 0), (5, 3),
        SI.

        Standing, settled, quiet, and the flags inputs_ok, filter_ok, sensors_ok.
    """
    parts = box.parts
    bring_up(parts.replay, parts.state, parts.setting)
    geometry, w, feet = parts.setting.geometry, parts.clock.w, parts.check.feet.shape[0]
    rows, more, covariance, pose = summary(parts.state, geometry, w, feet)
    rate = w - rows[R.gyro_bias]
    expressed = express(rows[R.g], rows[R.v], rate, geometry.rot_base_from_imu, geometry.imu_position)
    slipping, c = more[QUAT:] > FIXED.slides, condition(parts, rows, more, covariance)
    return (
        rows, more, covariance, pose, slipping, expressed, c.standing, c.initialised, is_quiet(c),
        flags_of(c),
    )  # fmt: skip


@kernel
def condition_now(box: KernelBox[FilterParts]) -> Condition:
    """Return the numbers from which flags and reasons follow; the filter is at its newest sample already.

    `box`: parts of the filter.
    """
    parts = box.parts
    feet = parts.check.feet.shape[0]
    rows, more, covariance, _ = summary(parts.state, parts.setting.geometry, parts.clock.w, feet)
    return condition(parts, rows, more, covariance)


class BestFilter:
    """Filter of velocity, tilt, biases and pose of a legged robot by its inertial unit and its feet, named `best`.

    It takes samples in any order within the last half second; the result is that of their order by stamps, to the bit.

    Args:
        geometry: contact points on the feet, and mounting of the IMU.
        noise: noises and rates of the filter.
        limits: limits of start and rest.
        check: limits and counters of the inputs.
    """

    def __init__(self, geometry: BestGeometry, noise: BestNoise, limits: BestLimits, check: InputCheck) -> None:
        feet, points = check.state.feet.shape[0], len(geometry.foot)
        modes = modes_of(feet) if limits.hypotheses else 0
        replay, state = new_replay(feet, points, modes), new_state(points, modes)
        clear(replay, state)
        setting = BestSetting(geometry, noise, limits)
        self.__setstate__(FilterParts(new_clock(), check.state, check.limits, check.noisy, replay, state, setting))

    def __getstate__(self) -> FilterParts:
        return self.parts

    def __setstate__(self, parts: FilterParts) -> None:
        self.parts, self._box = parts, boxed(parts)  # the same arrays
        self._waiting = 0
        self.outdate()

    def outdate(self) -> None:
        """Drop the stored output and condition after a sample, so that their next request computes them anew."""
        self._output: BestOutput | None = None
        self._condition: Condition | None = None

    def _keep_up(self) -> None:
        """Take the stored samples into the state before there are so many that the oldest would be lost."""
        self._waiting += 1
        if self._waiting > MOST_WAITING:
            report(self._box)
            self._waiting = 0

    def imu(self, stamp_ns: int, w: Array, q: Array, clipped: bool) -> int:
        """Take an inertial sample; return the index of its result in `RESULTS`: taken, or the reason why not.

        Args:
            stamp_ns: time of the sample, ns.
            w: gyro, IMU axes, (3,) rad/s.
            q: accelerometer, IMU axes, (3,) m/s^2.
            clipped: True if an axis was at the end of its range.
        """
        self.outdate()
        self._keep_up()
        code = take_imu(self._box, stamp_ns, w, q, clipped, OK)
        if RESTART <= code <= STEPPED:
            self._restart(stamp_ns)
            code = take_imu(self._box, stamp_ns, w, q, clipped, code)
        return code

    def feet(self, stamp_ns: int, position: Array, rot: Array, contact: Array) -> int:
        """Take a sample of L feet; return the index of its result in `RESULTS`: taken, or the reason why not.

        Args:
            stamp_ns: time of the sample, ns.
            position: foot centres from the IMU, IMU axes, (L, 3) m.
            rot: rot_imu_from_foot, (L, 3, 3).
            contact: probability of contact at each of S switches of a foot, (L, S), NaN = unknown.
        """
        self.outdate()
        self._keep_up()
        code = take_feet(self._box, stamp_ns, position, rot, contact, OK)
        if RESTART <= code <= STEPPED:
            self._restart(stamp_ns)
            code = take_feet(self._box, stamp_ns, position, rot, contact, code)
        return code

    def external(self, stamp_ns: int, row: Array) -> int:
        """Take a sample of another source, such as a camera; return the index of its result in `RESULTS`.

        Args:
            stamp_ns: time at which the sample holds, ns.
            row: position (3,) m, heading rad, velocity (3,) m/s and their covariances, (26,) in the order of
                `ExternalLayout`; NaN = not in this sample.
        """
        self.outdate()
        self._keep_up()
        self.frame()
        return take_external(self._box, stamp_ns, row)

    def frame(self) -> None:
        """Extend the state by the shift and turn of the frame in which other sources give poses, unless it has them."""
        parts = self.parts
        feet, points, modes = parts.check.feet.shape[0], len(parts.state.points), len(parts.state.weight)
        if parts.state.x.size > X.points + 3 * points:
            return
        state, replay = new_state(points, modes, FRAME), new_replay(feet, points, modes, FRAME)
        fit_in(parts.state, state)
        fit_in(parts.replay.snapshots, replay.snapshots)
        snapshots = replay.snapshots
        self.__setstate__(parts._replace(state=state, replay=parts.replay._replace(snapshots=snapshots)))

    def _restart(self, stamp_ns: int) -> None:
        """Bring the state up to date and continue it after a restart of stamps; `stamp_ns`: of the next sample, ns."""
        report(self._box)
        restart(self._box, stamp_ns)

    def follow(self, log: LogInputs, order: NDArray[np.int64], rows: LogRows, first: int) -> None:
        """Take inputs of a log in their order of arrival, and write the estimates into `rows`, in place.

        Args:
            log: n inertial rows, m samples of the feet and those of other sources.
            order: (k,): number of an inertial row, n + that of a sample of the feet, or n + m + that of another source.
            rows: estimates, one for each inertial row from `first` on; changed.
            first: first inertial row that gets an estimate, written to row 0.
        """
        self.outdate()
        follow_log(order, log, rows, first, self._box)

    @property
    def output(self) -> BestOutput:
        """Estimate at the newest inertial sample; late samples cost one replay of at most the last half second."""
        if self._output is None:
            rows, more, covariance, pose, slipping, expressed, standing, settled, quiet, flags = report(self._box)
            g, v, position, v_odom, gyro_bias, acc_bias, (yaw, _, _), fit = rows
            nis, excess, _ = fit.tolist()
            self._waiting = 0
            self._output = BestOutput(
                g, v, covariance, position, more[:QUAT], v_odom, pose, gyro_bias, acc_bias, more[QUAT:], float(yaw),
                nis, excess, standing, settled, slipping, expressed, flags, quiet,
            )  # fmt: skip
        return self._output

    @property
    def externals(self) -> ExternalUse:
        """Counts of the poses and velocities of other sources, and the turn of their frame against odom."""
        _ = self.output  # brings the state up
        memory, x = self.parts.state.memory, self.parts.state.x
        left_out = int(memory[M.externals_out])
        yaw = float(x[-1]) if memory[M.framed] > 0.0 else math.nan
        return ExternalUse(int(memory[M.externals]) - left_out, left_out, int(memory[M.frames]), yaw)

    @property
    def condition(self) -> Condition:
        """Numbers from which the flags of the estimate, and the reasons for them in words, follow."""
        if self._condition is None:
            _ = self.output  # brings the state up
            self._condition = condition_now(self._box)
        return self._condition
