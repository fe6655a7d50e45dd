"""Intake of the `best` filter: a sample is checked, counted and inserted in the order of its stamp."""

from typing import NamedTuple

import numpy as np

from surefoot.arrays import Array, Ints
from surefoot.kernels.box import KernelBox
from surefoot.kernels.jit import kernel

from ..feet.contact import probabilities
from ..feet.mount import known_feet
from ..inputs.check import (
    BACK,
    FOR_EVER,
    IMU,
    KINEMATICS,
    KNOWN,
    LATE_FEET_NS,
    LIGHT_NS,
    NEWEST,
    SHOWN_LATE_NS,
    TURN_NS,
    CheckLimits,
    CheckState,
    check_feet,
    check_imu,
    check_units,
    count_result,
)
from ..inputs.clock import WINDOW_NS
from ..inputs.results import AHEAD, BACKWARD, DUPLICATE, LATE, OK, RESTART, SATURATED, STEPPED
from ..inputs.stamps import MOST_BACK, has_room, late_by
from .delay import delay_of, forget_delay
from .noise import FIXED, BestSetting
from .replay import EXTERNAL_END, FEET_END, IMU_END, Replay, note_sample, restart_clock, step_clock
from .samples import ROW_Q, ROW_W, after, insert_external, insert_feet, insert_imu
from .state import BestState

NOW_NS, FEET_NS, CONTACT_NS = range(3)
"""Indices in `Clock.stamps`; `NOW_NS`: newest inertial sample; `FEET_NS`: newest sample of the feet; `CONTACT_NS`:
newest sample in which a foot may have stood."""


class Clock(NamedTuple):
    """Stamps and values of the newest samples that a filter has taken."""

    stamps: Ints
    """Stamps of the newest inertial sample, sample of the feet, and sample in which a foot may have stood, (3,) ns."""
    w: Array
    """Newest gyro sample, IMU axes, (3,) rad/s."""
    yaw: Array
    """Published heading of base_link in odom, not wrapped to one turn, (1,) rad."""


class FilterParts(NamedTuple):
    """Parts of the `best` filter: clock, check of inputs, stored samples and snapshots, state, settings."""

    clock: Clock
    check: CheckState
    check_limits: CheckLimits
    noisy: bool
    """True: equal inertial samples in a row are a fault of the sensor; False: they may be chance."""
    replay: Replay
    state: BestState
    setting: BestSetting


def new_clock() -> Clock:
    """Return the clock of a filter before its first sample: all zeros."""
    return Clock(np.zeros(3, dtype=np.int64), np.zeros(3), np.zeros(1))


@kernel
def boxed(parts: FilterParts) -> KernelBox[FilterParts]:
    """Return a box that passes the parts of a filter to kernels as one argument and shares their arrays."""
    return KernelBox(parts)


@kernel
def _steps_back(parts: FilterParts, stamp_ns: int, w: Array, q: Array) -> int:
    """Return the code of an inertial sample by where its stamp lies among the stored samples.

    `OK`: the sample is new, a repetition, or fills a gap; `BACKWARD`: it is old and none is missing there; `DUPLICATE`:
    a different sample has its stamp.

    Args:
        parts: parts of the filter.
        stamp_ns: stamp of the sample, ns.
        w: gyro, IMU axes, (3,) rad/s.
        q: accelerometer, IMU axes, (3,) m/s^2.
    """
    samples, end = parts.replay.samples, parts.replay.marks[IMU_END]
    at = after(samples.imu_stamps[:end], stamp_ns)
    if at == 0 or stamp_ns <= parts.clock.stamps[NOW_NS] - WINDOW_NS:
        return OK
    if at == end and samples.imu_stamps[at - 1] == stamp_ns:  # the newest once more: its clock stands
        return OK
    if samples.imu_stamps[at - 1] != stamp_ns:
        return OK if has_room(samples.imu_stamps[:end], at, parts.check_limits.period_ns) else BACKWARD
    for i in range(3):
        if samples.imu[at - 1, ROW_W + i] != w[i] or samples.imu[at - 1, ROW_Q + i] != q[i]:
            return DUPLICATE
    return OK


@kernel
def take_imu(box: KernelBox[FilterParts], stamp_ns: int, w: Array, q: Array, clipped: bool, restarted: int) -> int:
    """Check an inertial sample and insert it, in place; return the code of its result.

    Codes are indices in `RESULTS`, the tuple of all `InputResult`: `OK`, or the reason of a refusal.

    Args:
        box: parts of the filter, whose arrays are changed.
        stamp_ns: time of the sample, ns.
        w: gyro, IMU axes, (3,) rad/s.
        q: accelerometer, IMU axes, (3,) m/s^2.
        clipped: True if an axis was at the end of its range.
        restarted: code of its check, RESTART or STEPPED, if `restart` has been called since, else OK. Without it such a
            sample is not inserted: `restart` would be compiled into this kernel with the whole filter.
    """
    parts = box.parts
    if clipped and not restarted:
        return count_result(parts.check, IMU, SATURATED, stamp_ns)
    marks, old = parts.check.marks, OK if restarted != OK else _steps_back(parts, stamp_ns, w, q)
    marks[BACK] = marks[BACK] + 1 if old != OK else 0
    if old != OK:
        return STEPPED if marks[BACK] >= MOST_BACK else count_result(parts.check, IMU, old, stamp_ns)
    code = check_imu(parts.check, parts.check_limits, stamp_ns, w, q) if restarted == OK else restarted
    if code >= RESTART and restarted == OK:
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
def _shown_late(parts: FilterParts) -> int:
    """Return the delay of the stamps of the feet that their motion has shown for long enough, ns; 0: none.

    `parts`: of the filter; the stamp since which they are shown late is changed.
    """
    marks, newest = parts.check.marks, parts.replay.samples.feet_stamps[parts.replay.marks[FEET_END] - 1]
    late = int(1e9 * delay_of(parts.state.sensors))
    if late == 0:
        marks[SHOWN_LATE_NS] = 0
    elif marks[SHOWN_LATE_NS] == 0:
        marks[SHOWN_LATE_NS] = newest
    if newest - marks[SHOWN_LATE_NS] <= 1e9 * FIXED.delay_lasts_s or late == 0:
        return 0
    return late if abs(marks[LATE_FEET_NS] + late) < 1e9 * FIXED.most_late_s else 0


@kernel
def _late(parts: FilterParts) -> int:
    """Subtract the time by which the stamps of the feet are late, in place, and return it, ns; 0: not late.

    A gap in which the feet did not move on shows it, or their motion beside the inertial unit: in the second case it
    has existed for a while, and all stored samples are moved. `parts`: of the filter; stamps and checks are changed.
    """
    replay, end = parts.replay, parts.replay.marks[FEET_END]
    row, late = late_by(replay.samples.feet_stamps[:end], replay.samples.feet[:end])
    if late == 0:
        row, late = 0, _shown_late(parts)
    if late != 0:
        replay.samples.feet_stamps[row:end] -= late
        note_sample(replay, FEET_END, end, replay.samples.feet_stamps[row])
        parts.check.marks[LATE_FEET_NS] += late
        parts.check.marks[SHOWN_LATE_NS] = 0
        parts.check.clocks[KINEMATICS, NEWEST] -= late
        parts.clock.stamps[FEET_NS] -= late
        parts.clock.stamps[CONTACT_NS] -= late
        forget_delay(parts.state.sensors)
        forget_delay(replay.snapshots.sensors)
    return late


@kernel
def take_feet(
    box: KernelBox[FilterParts], stamp_ns: int, position: Array, rot: Array, contact: Array, restarted: int
) -> int:
    """Check a sample of L feet and insert it, in place; return the code of its result.

    Codes are indices in `RESULTS`, the tuple of all `InputResult`: `OK`, or the reason of a refusal.

    Args:
        box: parts of the filter, whose arrays are changed.
        stamp_ns: time of the sample, ns.
        position: foot centres from the IMU, IMU axes, (L, 3) m.
        rot: rot_imu_from_foot, (L, 3, 3).
        contact: probability of contact at each of S switches of a foot, (L, S), NaN = unknown.
        restarted: code of its check, RESTART or STEPPED, if `restart` has been called since, else OK.
    """
    parts = box.parts
    stamp_ns -= parts.check.marks[LATE_FEET_NS]
    if parts.check.marks[BACK] > 0:
        return count_result(parts.check, KINEMATICS, BACKWARD, stamp_ns)
    code = check_feet(parts.check, stamp_ns, position) if restarted == OK else restarted
    if code >= RESTART and restarted == OK:
        return code
    stamps, geometry, replay = parts.clock.stamps, parts.setting.geometry, parts.replay
    seen, turn, known, closed, stands = known_feet(position, rot, contact)
    points = probabilities(geometry.foot, known)
    end = insert_feet(replay.samples, replay.marks[FEET_END], stamp_ns, seen, turn, points, closed)
    if end < 0:
        return count_result(parts.check, KINEMATICS, DUPLICATE, stamp_ns)
    note_sample(replay, FEET_END, end, stamp_ns)
    if stamp_ns > stamps[FEET_NS]:
        stamp_ns -= _late(parts)
    check_units(parts.check, stamp_ns, seen, turn, known, geometry.foot, geometry.place)
    stamps[FEET_NS] = max(stamps[FEET_NS], stamp_ns)
    if stands:
        stamps[CONTACT_NS] = max(stamps[CONTACT_NS], stamp_ns)
    return code


@kernel
def take_external(box: KernelBox[FilterParts], stamp_ns: int, row: Array) -> int:
    """Insert a sample of another source, such as a camera, in place; return the code of its result.

    Codes are indices in `RESULTS`, the tuple of all `InputResult`: `OK`, `LATE`, `AHEAD` or `DUPLICATE`.

    Args:
        box: parts of the filter, whose arrays are changed.
        stamp_ns: time at which the sample holds, ns.
        row: position (3,) m, heading rad, velocity (3,) m/s and their covariances, (26,) in the order of
            `ExternalLayout`; NaN = not in this sample.
    """
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
def restart(box: KernelBox[FilterParts], stamp_ns: int) -> None:
    """Let a filter whose state is at the newest sample continue after the stamps began anew, in place.

    After a step back of less than the window of late samples, 0.5 s, the estimate goes on: the newest sample is moved
    to `MOST_BACK` = 3 periods before `stamp_ns`. Else velocity, feet and all samples are forgotten.

    Args:
        box: parts of the filter, whose arrays are changed.
        stamp_ns: stamp of the sample that comes next, ns.
    """
    parts = box.parts
    marks, clocks, stamps = parts.check.marks, parts.check.clocks, parts.clock.stamps
    if marks[BACK] < MOST_BACK:
        restart_clock(parts.replay, parts.state)
        stamps[:], marks[LATE_FEET_NS], marks[SHOWN_LATE_NS] = 0, 0, 0
        return
    last = stamp_ns - MOST_BACK * int(parts.check_limits.period_ns)
    step_clock(parts.replay, parts.state, last)
    stamps -= stamps[NOW_NS] - last
    clocks[IMU, NEWEST], clocks[KINEMATICS, KNOWN] = stamp_ns, 0
    marks[TURN_NS], marks[LIGHT_NS], marks[BACK] = last, FOR_EVER, 0
    count_result(parts.check, IMU, STEPPED, stamp_ns)
