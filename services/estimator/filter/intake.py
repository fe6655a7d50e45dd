"""Intake of the `best` filter: a sample is checked, counted and inserted in the order of its stamp."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from surefoot.kernels.box import KernelBox
from surefoot.kernels.jit import kernel

from ..feet.contact import probabilities
from ..feet.mount import known_feet
from ..inputs.check import IMU, KINEMATICS, CheckLimits, CheckState, check_feet, check_imu, check_units, count_result
from ..inputs.clock import WINDOW_NS
from ..inputs.results import AHEAD, DUPLICATE, LATE, OK, RESTART, SATURATED
from .noise import BestSetting
from .replay import EXTERNAL_END, FEET_END, IMU_END, Replay, note_sample, restart_clock
from .samples import insert_external, insert_feet, insert_imu
from .state import BestState

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

NOW_NS, FEET_NS, CONTACT_NS = range(3)
"""Parts of `Clock.stamps`."""


class Clock(NamedTuple):
    """Newest samples of an estimator."""

    stamps: Ints
    """Stamps of the newest inertial sample, sample of the feet, and contact, (3,) ns."""
    w: Array
    """Newest gyro sample, IMU axes, (3,) rad/s."""
    yaw: Array
    """Heading, not wrapped, (1,) rad."""


class FilterParts(NamedTuple):
    """The filter with its samples, the check of its inputs and its numbers."""

    clock: Clock
    check: CheckState
    check_limits: CheckLimits
    noisy: bool
    """True: equal inertial samples are a fault, not chance."""
    replay: Replay
    state: BestState
    setting: BestSetting


def new_clock() -> Clock:
    """Return a clock without samples."""
    return Clock(np.zeros(3, dtype=np.int64), np.zeros(3), np.zeros(1))


@kernel
def boxed(parts: FilterParts) -> KernelBox[FilterParts]:
    """Return a box that shares the arrays of a filter."""
    return KernelBox(parts)


@kernel
def take_imu(box: KernelBox[FilterParts], stamp_ns: int, w: Array, q: Array, clipped: bool, restarted: bool) -> int:
    """Check an inertial sample and insert it, in place; return the code of its result.

    Args:
        box: of the filter.
        stamp_ns: time of the sample, ns.
        w: (3,) rad/s, IMU axes.
        q: (3,) m/s^2, IMU axes.
        clipped: an axis was at the end of its range.
        restarted: the sample was checked with the result RESTART, and `restart` has been called since. Without it such
            a sample is not inserted: `restart` would be compiled into this kernel with the whole filter.
    """
    parts = box.parts
    if clipped and not restarted:
        return count_result(parts.check, IMU, SATURATED, stamp_ns)
    code = RESTART if restarted else check_imu(parts.check, parts.check_limits, stamp_ns, w, q)
    if code >= RESTART and not restarted:
        return code
    end = insert_imu(parts.replay.samples, parts.replay.marks[IMU_END], stamp_ns, w, q)
    if end < 0:
        return count_result(parts.check, IMU, DUPLICATE, stamp_ns)
    note_sample(parts.replay, IMU_END, end, stamp_ns)
    if stamp_ns > parts.clock.stamps[NOW_NS]:
        parts.clock.stamps[NOW_NS] = stamp_ns
        parts.clock.w[:] = w
    return code


@kernel
def take_feet(
    box: KernelBox[FilterParts], stamp_ns: int, position: Array, rot: Array, contact: Array, restarted: bool
) -> int:
    """Check a sample of the feet and insert it, in place; return the code of its result.

    Args:
        box: of the filter.
        stamp_ns: time of the sample, ns.
        position: (L, 3) m, IMU axes.
        rot: rot_imu_from_foot, (L, 3, 3).
        contact: probability at each switch, (L, S), NaN = unknown.
        restarted: see `take_imu`.
    """
    parts = box.parts
    code = RESTART if restarted else check_feet(parts.check, stamp_ns, position)
    if code >= RESTART and not restarted:
        return code
    stamps, geometry, replay = parts.clock.stamps, parts.setting.geometry, parts.replay
    seen, turn, known, closed, stands = known_feet(position, rot, contact)
    points = probabilities(geometry.foot, known)
    end = insert_feet(replay.samples, replay.marks[FEET_END], stamp_ns, seen, turn, points, closed)
    if end < 0:
        return count_result(parts.check, KINEMATICS, DUPLICATE, stamp_ns)
    note_sample(replay, FEET_END, end, stamp_ns)
    check_units(parts.check, stamp_ns, seen, turn, known, geometry.foot, geometry.place)
    stamps[FEET_NS] = max(stamps[FEET_NS], stamp_ns)
    if stands:
        stamps[CONTACT_NS] = max(stamps[CONTACT_NS], stamp_ns)
    return code


@kernel
def take_external(box: KernelBox[FilterParts], stamp_ns: int, row: Array) -> int:
    """Insert a sample from elsewhere, (26,) as `samples.ExternalLayout`, in place; return the code of its result."""
    parts = box.parts
    now = parts.clock.stamps[NOW_NS]
    if stamp_ns <= now - WINDOW_NS:
        return LATE
    if stamp_ns > now + WINDOW_NS:
        return AHEAD
    end = insert_external(parts.replay.samples, parts.replay.marks[EXTERNAL_END], stamp_ns, row)
    if end < 0:
        return DUPLICATE
    note_sample(parts.replay, EXTERNAL_END, end, stamp_ns)
    return OK


@kernel
def restart(box: KernelBox[FilterParts]) -> None:
    """Begin a new clock with a state that has been brought up, in place."""
    parts = box.parts
    restart_clock(parts.replay, parts.state)
    parts.clock.stamps[:] = 0
