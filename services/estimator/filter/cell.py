"""What the `best` filter works on, and what one sample does to it: judged, counted, put where its stamp belongs."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from surefoot.kernels.box import KernelBox
from surefoot.kernels.jit import kernel

from ..feet.contact import BestGeometry, probabilities
from ..feet.kinematics import known_feet
from ..inputs.judge import (
    IMU,
    KINEMATICS,
    Judge,
    JudgeLimits,
    judge_feet,
    judge_imu,
    judge_units,
    note,
)
from ..inputs.results import DUPLICATE, RESTART, SATURATED
from .memory import Memory, add_feet, add_imu, restart_clock
from .start import BestLimits
from .state import BestNoise, BestState

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

NOW_NS, FEET_NS, CONTACT_NS = range(3)  # parts of `Clock.stamps`


class Clock(NamedTuple):
    """What an estimator remembers beside its filter."""

    stamps: Ints  # (3,) newest inertial sample, newest sample of the feet, newest contact, ns
    w: Array  # (3,) rad/s, newest gyro sample
    yaw: Array  # (1,) rad, not wrapped


class Cell(NamedTuple):
    """The filter with its samples, the judge of its inputs and all that they were made with."""

    clock: Clock
    judge: Judge
    judge_limits: JudgeLimits
    noisy: bool  # equal inertial samples are no chance
    memory: Memory
    state: BestState
    geometry: BestGeometry
    noise: BestNoise
    limits: BestLimits


def new_clock() -> Clock:
    """Return a clock that has seen nothing."""
    return Clock(np.zeros(3, dtype=np.int64), np.zeros(3), np.zeros(1))


@kernel
def boxed(cell: Cell) -> KernelBox[Cell]:
    """Return a box that shares the arrays of a cell."""
    return KernelBox(cell)


@kernel
def take_imu(box: KernelBox[Cell], stamp_ns: int, w: Array, q: Array, clipped: bool) -> int:
    """Take an inertial sample, w (3,) rad/s and q (3,) m/s^2, in place; return the code of what became of it.

    After RESTART the sample has still to be put, see `restart`.
    """
    cell = box.parts
    if clipped:
        return note(cell.judge, IMU, SATURATED, stamp_ns)
    code = judge_imu(cell.judge, cell.judge_limits, stamp_ns, w, q)
    return code if code >= RESTART else put_imu(box, stamp_ns, w, q, code)


@kernel
def put_imu(box: KernelBox[Cell], stamp_ns: int, w: Array, q: Array, code: int) -> int:
    """Put an inertial sample that was judged with this code where it belongs, in place; return what became of it."""
    cell = box.parts
    clock = cell.clock
    if not add_imu(cell.memory, stamp_ns, w, q):
        return note(cell.judge, IMU, DUPLICATE, stamp_ns)
    if stamp_ns > clock.stamps[NOW_NS]:
        clock.stamps[NOW_NS] = stamp_ns
        clock.w[:] = w
    return code


@kernel
def take_feet(box: KernelBox[Cell], stamp_ns: int, position: Array, rot: Array, contact: Array) -> int:
    """Take the feet, in place; return the code of what became of them. After RESTART as `take_imu`.

    Args:
        box: of the filter.
        stamp_ns: of the sample.
        position: (L, 3) m, IMU axes.
        rot: rot_imu_from_foot, (L, 3, 3).
        contact: probability at each switch, (L, S), NaN = unknown.
    """
    code = judge_feet(box.parts.judge, stamp_ns, position)
    return code if code >= RESTART else put_feet(box, stamp_ns, position, rot, contact, code)


@kernel
def put_feet(box: KernelBox[Cell], stamp_ns: int, position: Array, rot: Array, contact: Array, code: int) -> int:
    """Put feet that were judged with this code where they belong, in place; return what became of them."""
    cell = box.parts
    clock, judge, geometry = cell.clock, cell.judge, cell.geometry
    seen, turn, known, closed, stands = known_feet(position, rot, contact)
    if not add_feet(cell.memory, stamp_ns, seen, turn, probabilities(geometry.foot, known), closed):
        return note(judge, KINEMATICS, DUPLICATE, stamp_ns)
    judge_units(judge, stamp_ns, seen, turn, known, geometry.foot, geometry.place)
    clock.stamps[FEET_NS] = max(clock.stamps[FEET_NS], stamp_ns)
    if stands:
        clock.stamps[CONTACT_NS] = max(clock.stamps[CONTACT_NS], stamp_ns)
    return code


@kernel
def restart(box: KernelBox[Cell]) -> None:
    """Begin a new clock with a state that has been brought up, in place.

    Neither `take_imu` nor `take_feet` does so by itself: the whole filter would be compiled into each of them.
    """
    cell = box.parts
    restart_clock(cell.memory, cell.state)
    cell.clock.stamps[:] = 0
