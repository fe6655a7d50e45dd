"""Samples and snapshots of the `best` filter: late samples are put where they belong, and the state runs again."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from surefoot.kernels.jit import kernel

from ..feet.contact import BestGeometry
from ..inputs.timeline import CAPACITY, WINDOW_NS, after, keep_newest, make_room, place_of
from .run import advance, forget
from .start import BestLimits
from .state import BestNoise, BestState, new_state

Array = NDArray[np.float64]
Stamps = NDArray[np.int64]

SNAPSHOT_NS = 50_000_000  # inertial time between two snapshots
SNAPSHOTS = 3 + WINDOW_NS // SNAPSHOT_NS
KEEP = CAPACITY // 2  # samples that stay when a store is full
NOTHING = 2**62  # `DIRTY_NS` without late samples

# parts of `Memory.marks`: samples of the IMU and of the feet, stamp of the last inertial sample in the state, of the
# oldest sample that came after its time, first snapshot in the ring and their number
IMU_END, FEET_END, DONE_NS, DIRTY_NS, FIRST, COUNT = range(6)


class Memory(NamedTuple):
    """The last N samples of each source by rising stamps, and the last S states; L feet, K contact points."""

    imu_stamps: Stamps  # (N,) ns
    imu: Array  # (N, 6) gyro rad/s, accelerometer m/s^2
    feet_stamps: Stamps  # (N,)
    feet: Array  # (N, L, 3) m, IMU axes
    foot_rots: Array  # (N, L, 3, 3) rot_imu_from_foot
    contact: Array  # (N, K)
    closed: Stamps  # (N, L) switches, bit s for switch s
    marks: Stamps  # (6,)
    snapshot_ns: Stamps  # (S,)
    snapshots: BestState  # arrays of S states


def new_memory(feet: int, points: int, modes: int = 0) -> Memory:
    """Return an empty memory for states of so many points and hypotheses; `clear` makes its first snapshot."""
    n, one = CAPACITY, new_state(points, modes)
    return Memory(
        np.zeros(n, dtype=np.int64), np.zeros((n, 6)), np.zeros(n, dtype=np.int64), np.zeros((n, feet, 3)),
        np.zeros((n, feet, 3, 3)), np.zeros((n, points)), np.zeros((n, feet), dtype=np.int64),
        np.zeros(COUNT + 1, dtype=np.int64), np.zeros(SNAPSHOTS, dtype=np.int64),
        BestState(*(np.stack([part] * SNAPSHOTS) for part in one)),
    )  # fmt: skip


@kernel
def _snap(memory: Memory, state: BestState) -> None:
    """Keep the state as the newest snapshot; the oldest goes when the ring is full."""
    marks, kept = memory.marks, memory.snapshots
    if marks[COUNT] == SNAPSHOTS:
        marks[FIRST] = (marks[FIRST] + 1) % SNAPSHOTS
        marks[COUNT] -= 1
    at = (marks[FIRST] + marks[COUNT]) % SNAPSHOTS
    marks[COUNT] += 1
    memory.snapshot_ns[at] = marks[DONE_NS]
    kept.x[at], kept.cov[at], kept.points[at] = state.x, state.cov, state.points
    kept.turn[at], kept.memory[at], kept.weight[at] = state.turn, state.memory, state.weight
    kept.mode_x[at], kept.mode_cov[at], kept.mode_points[at] = state.mode_x, state.mode_cov, state.mode_points
    kept.mode_turn[at], kept.mode_memory[at] = state.mode_turn, state.mode_memory


@kernel
def clear(memory: Memory, state: BestState) -> None:
    """Forget all samples and snapshots but the state itself, in place."""
    marks = memory.marks
    marks[IMU_END] = marks[FEET_END] = marks[FIRST] = marks[COUNT] = 0
    marks[DONE_NS], marks[DIRTY_NS] = -1, NOTHING
    _snap(memory, state)


@kernel
def _note_late(marks: Stamps, stamp_ns: int) -> None:
    if stamp_ns <= marks[DONE_NS]:
        marks[DIRTY_NS] = min(marks[DIRTY_NS], stamp_ns)


@kernel
def add_imu(memory: Memory, stamp_ns: int, w: Array, q: Array) -> bool:
    """Put an inertial sample where it belongs, in place; False: there is one of this stamp."""
    marks, stamps, rows = memory.marks, memory.imu_stamps, memory.imu
    if marks[IMU_END] == CAPACITY:
        keep_newest(stamps, KEEP)
        keep_newest(rows, KEEP)
        marks[IMU_END] = KEEP
    end = marks[IMU_END]
    at = place_of(stamps[:end], stamp_ns)
    if at < 0:
        return False
    make_room(stamps, at, end)
    make_room(rows, at, end)
    stamps[at] = stamp_ns
    for i in range(3):
        rows[at, i], rows[at, 3 + i] = w[i], q[i]
    marks[IMU_END] += 1
    _note_late(marks, stamp_ns)
    return True


@kernel
def add_feet(memory: Memory, stamp_ns: int, position: Array, rot: Array, contact: Array, closed: Stamps) -> bool:
    """Put feet (L, 3), (L, 3, 3), contacts (K,) and closed switches (L,) where they belong, in place.

    False: there are some of this stamp.
    """
    marks, stamps = memory.marks, memory.feet_stamps
    if marks[FEET_END] == CAPACITY:
        keep_newest(stamps, KEEP)
        keep_newest(memory.feet, KEEP)
        keep_newest(memory.foot_rots, KEEP)
        keep_newest(memory.contact, KEEP)
        keep_newest(memory.closed, KEEP)
        marks[FEET_END] = KEEP
    end = marks[FEET_END]
    at = place_of(stamps[:end], stamp_ns)
    if at < 0:
        return False
    make_room(stamps, at, end)
    make_room(memory.feet, at, end)
    make_room(memory.foot_rots, at, end)
    make_room(memory.contact, at, end)
    make_room(memory.closed, at, end)
    stamps[at] = stamp_ns
    memory.feet[at], memory.foot_rots[at], memory.contact[at] = position, rot, contact
    memory.closed[at] = closed
    marks[FEET_END] += 1
    _note_late(marks, stamp_ns)
    return True


@kernel
def bring_up(memory: Memory, state: BestState, geometry: BestGeometry, noise: BestNoise, limits: BestLimits) -> None:
    """Bring the state up to the newest inertial sample, in place; late samples cost one replay of the window."""
    marks, kept = memory.marks, memory.snapshots
    if marks[DIRTY_NS] != NOTHING:
        last = (marks[FIRST] + marks[COUNT] - 1) % SNAPSHOTS
        while marks[COUNT] > 1 and memory.snapshot_ns[last] >= marks[DIRTY_NS]:
            marks[COUNT] -= 1
            last = (marks[FIRST] + marks[COUNT] - 1) % SNAPSHOTS
        marks[DONE_NS], marks[DIRTY_NS] = memory.snapshot_ns[last], NOTHING
        state.x[:], state.cov[:], state.points[:] = kept.x[last], kept.cov[last], kept.points[last]
        state.turn[:], state.memory[:], state.weight[:] = kept.turn[last], kept.memory[last], kept.weight[last]
        state.mode_x[:], state.mode_cov[:], state.mode_points[:] = (
            kept.mode_x[last], kept.mode_cov[last], kept.mode_points[last],
        )  # fmt: skip
        state.mode_turn[:], state.mode_memory[:] = kept.mode_turn[last], kept.mode_memory[last]
    count, m = marks[IMU_END], marks[FEET_END]
    stamps = memory.imu_stamps[:count]
    while count > 0 and marks[DONE_NS] < stamps[count - 1]:
        last = (marks[FIRST] + marks[COUNT] - 1) % SNAPSHOTS
        due = memory.snapshot_ns[last] + SNAPSHOT_NS
        begin = after(stamps, marks[DONE_NS])  # pyright: ignore[reportArgumentType] - a number to the compiler
        end = max(begin + 1, after(stamps, due))  # pyright: ignore[reportArgumentType] - likewise
        advance(
            state, stamps[:end], memory.imu[:end], memory.feet_stamps[:m], memory.feet[:m], memory.foot_rots[:m],
            memory.contact[:m], memory.closed[:m], begin, geometry, noise, limits,
        )  # fmt: skip
        marks[DONE_NS] = stamps[end - 1]
        if marks[DONE_NS] >= due:
            _snap(memory, state)


@kernel
def restart_clock(memory: Memory, state: BestState) -> None:
    """Keep what is known but for velocity and feet when stamps begin anew, in place."""
    state.weight[:] = 0.0
    forget(state, 1.0)
    clear(memory, state)
