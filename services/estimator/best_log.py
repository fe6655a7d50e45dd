"""The `best` estimator over the rows of a log in their order of arrival, without the interpreter in between.

The same kernels in the same order as `stream.Estimator` calls for one sample after the other: estimates are equal to
the bit.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from surefoot.geometry.rotations import wrap_angle
from surefoot.kernels.jit import kernel
from surefoot.services.estimator.best import summary
from surefoot.services.estimator.best_kernel import NIS, REST, BestNoise, BestState
from surefoot.services.estimator.best_memory import Memory, add_feet, add_imu, bring_up, restart_clock
from surefoot.services.estimator.best_start import BestGeometry, BestLimits
from surefoot.services.estimator.contact import probabilities
from surefoot.services.estimator.feet import known_feet
from surefoot.services.estimator.health import flags_of
from surefoot.services.estimator.inputs import BAD_MEMORY_NS, FROZEN_ROWS, LIGHT_FOR_NS, STEADY_ROWS
from surefoot.services.estimator.judge import (
    BAD_NS,
    EQUAL_FEET,
    EQUAL_ROWS,
    IMU,
    KINEMATICS,
    LIGHT_NS,
    REFUSED,
    SATURATED_NS,
    Judge,
    JudgeLimits,
    judge_feet,
    judge_imu,
    judge_units,
    note,
)
from surefoot.services.estimator.output import healthy
from surefoot.services.estimator.results import DUPLICATE, RESTART, SATURATED

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
    contact: Array  # (m, L) probability, NaN = unknown


class LogRows(NamedTuple):
    """Estimates at n inertial rows."""

    vectors: Array  # (n, 7, 3) as `best.summary`
    more: Array  # (n, 4 + L) quaternion of base_link in odom, probability of sliding of each foot
    covariance: Array  # (n, 6, 6) of (g, v)
    pose: Array  # (n, 4, 4) covariance of x, y, z, yaw
    yaw: Array  # (n,) rad, not wrapped
    nis: Array  # (n,)
    flags: Flags  # (n, 5)
    refused: Ints  # (n,) inputs refused so far


class Clock(NamedTuple):
    """What an estimator remembers beside its filter."""

    stamps: Ints  # (3,) newest inertial sample, newest sample of the feet, newest contact, ns
    w: Array  # (3,) rad/s, newest gyro sample
    yaw: Array  # (1,) rad, not wrapped


NOW_NS, FEET_NS, CONTACT_NS = range(3)


def new_rows(n: int, feet: int) -> LogRows:
    """Return room for n rows of L feet."""
    return LogRows(
        np.zeros((n, 7, 3)), np.zeros((n, 4 + feet)), np.zeros((n, 6, 6)), np.zeros((n, 4, 4)),
        np.zeros(n), np.zeros(n), np.zeros((n, len(FLAGS)), dtype=np.bool_), np.zeros(n, dtype=np.int64),
    )  # fmt: skip


@kernel
def _take_imu(
    log: LogInputs, at: int, clock: Clock, judge: Judge, judge_limits: JudgeLimits, memory: Memory, state: BestState,
    geometry: BestGeometry, noise: BestNoise, limits: BestLimits,
) -> None:  # fmt: skip
    stamp = log.stamp_ns[at]
    if log.clipped[at]:
        note(judge, IMU, SATURATED, stamp)
        return
    code = judge_imu(judge, judge_limits, stamp, log.w[at], log.q[at])
    if code > RESTART:
        return
    if code == RESTART:
        _restart(clock, memory, state, geometry, noise, limits)
    if not add_imu(memory, stamp, log.w[at], log.q[at]):
        note(judge, IMU, DUPLICATE, stamp)
        return
    if stamp > clock.stamps[NOW_NS]:
        clock.stamps[NOW_NS] = stamp
        clock.w[:] = log.w[at]


@kernel
def _take_feet(
    log: LogInputs, at: int, clock: Clock, judge: Judge, judge_limits: JudgeLimits, memory: Memory, state: BestState,
    geometry: BestGeometry, noise: BestNoise, limits: BestLimits,
) -> None:  # fmt: skip
    stamp = log.foot_ns[at]
    code = judge_feet(judge, stamp, log.position[at])
    if code > RESTART:
        return
    if code == RESTART:
        _restart(clock, memory, state, geometry, noise, limits)
    position, rot, contact, stands = known_feet(log.position[at], log.rot[at], log.contact[at])
    if not add_feet(memory, stamp, position, rot, probabilities(geometry.foot, contact)):
        note(judge, KINEMATICS, DUPLICATE, stamp)
        return
    judge_units(judge, stamp, position, rot, contact, geometry.foot, geometry.place)
    clock.stamps[FEET_NS] = max(clock.stamps[FEET_NS], stamp)
    if stands:
        clock.stamps[CONTACT_NS] = max(clock.stamps[CONTACT_NS], stamp)


@kernel
def _restart(
    clock: Clock, memory: Memory, state: BestState, geometry: BestGeometry, noise: BestNoise, limits: BestLimits
) -> None:
    bring_up(memory, state, geometry, noise, limits)
    restart_clock(memory, state)
    clock.stamps[:] = 0


@kernel
def _note_row(
    rows: LogRows, at: int, clock: Clock, judge: Judge, noisy: bool, state: BestState, geometry: BestGeometry, feet: int
) -> None:
    """Write the estimate into a row."""
    vectors, more, covariance, pose = summary(state, geometry, clock.w, feet)
    rows.vectors[at], rows.more[at], rows.covariance[at], rows.pose[at] = vectors, more, covariance, pose
    clock.yaw[0] += wrap_angle(vectors[6, 0] - clock.yaw[0])
    rows.yaw[at], rows.nis[at] = clock.yaw[0], state.memory[NIS]
    now, marks, flags = clock.stamps[NOW_NS], judge.marks, rows.flags
    rows.refused[at] = marks[REFUSED]
    started, stands = vectors[6, 1] > 0.0, state.memory[REST] > 0.0
    frozen = (noisy and marks[EQUAL_ROWS] >= FROZEN_ROWS) or (
        started and not stands and marks[EQUAL_FEET] >= STEADY_ROWS
    )
    light = now - marks[LIGHT_NS] >= LIGHT_FOR_NS
    saturated = 0 <= now - marks[SATURATED_NS] < BAD_MEMORY_NS
    refused = 0 <= now - marks[BAD_NS] < BAD_MEMORY_NS
    since_contact = 1e-9 * (now - clock.stamps[CONTACT_NS])
    flags[at, 0], flags[at, 1] = started, stands
    flags[at, 2], flags[at, 3], flags[at, 4] = flags_of(
        started, healthy(vectors[0], vectors[1], covariance), state.memory[NIS], refused, frozen or saturated or light,
        False,
        1e-9 * (now - clock.stamps[FEET_NS]), since_contact, since_contact,
    )  # fmt: skip


@kernel
def follow_log(
    order: Ints, log: LogInputs, rows: LogRows, first: int, clock: Clock, judge: Judge, judge_limits: JudgeLimits,
    noisy: bool, memory: Memory, state: BestState, geometry: BestGeometry, noise: BestNoise, limits: BestLimits,
) -> None:  # fmt: skip
    """Take the inputs of a log, in place, and write the estimate after each inertial row and the feet that follow it.

    Args:
        order: of arrival: the number of an inertial row, or n + that of a sample of the feet.
        log: the inputs.
        rows: for the estimates, those of row `first` and later.
        first: see `rows`.
        clock, judge, memory, state: what the estimator remembers.
        judge_limits, noisy, geometry, noise, limits: what it was made with.
    """
    n, row, feet = log.stamp_ns.size, -1, log.contact.shape[1]
    for i in range(order.size):
        at = order[i]
        if at < n:
            _take_imu(log, at, clock, judge, judge_limits, memory, state, geometry, noise, limits)
            row = at - first
        else:
            _take_feet(log, at - n, clock, judge, judge_limits, memory, state, geometry, noise, limits)
        if row >= 0 and (i + 1 == order.size or order[i + 1] < n):
            bring_up(memory, state, geometry, noise, limits)
            _note_row(rows, row, clock, judge, noisy, state, geometry, feet)
