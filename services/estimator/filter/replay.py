"""Replay of late samples: the state goes back to a snapshot before them and runs over all samples again."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from surefoot.kernels.jit import kernel

from ..inputs.clock import WINDOW_NS
from .advance import advance, forget
from .noise import BestSetting
from .samples import SampleStore, after, new_samples
from .state import BestState, new_state

Stamps = NDArray[np.int64]

SNAPSHOT_NS = 50_000_000
"""Time between two snapshots of the filter state, by stamps of inertial samples, ns."""
SNAPSHOTS = 3 + WINDOW_NS // SNAPSHOT_NS
"""Number of snapshots that are kept: those of the window in which samples may be late, and three more."""
NOTHING = 2**62
"""Value of `Replay.marks[DIRTY_NS]`, ns, while no late sample waits for a replay."""
IMU_END, FEET_END, DONE_NS, DIRTY_NS, FIRST, COUNT, EXTERNAL_END = range(7)
"""Indices in `Replay.marks`; `IMU_END`, `FEET_END`, `EXTERNAL_END`: number of stored samples of the inertial unit, of
the feet, of another source; `DONE_NS`: stamp of the last inertial sample in the state; `DIRTY_NS`: oldest stamp of late
samples; `FIRST`: row of the oldest snapshot in the ring; `COUNT`: number of snapshots in it."""


class Replay(NamedTuple):
    """Samples of the last seconds, and S snapshots of the filter state, from which late samples are replayed."""

    samples: SampleStore
    marks: Stamps
    """Counts and stamps, ns, (7,), at the indices named by `IMU_END` and the six constants beside it."""
    snapshot_ns: Stamps
    """Stamp of the last inertial sample in each snapshot, (S,) ns."""
    snapshots: BestState
    """Filter states at S times: each array of `BestState` has the axis S in front."""


def new_replay(feet: int, points: int, modes: int = 0, frame: int = 0) -> Replay:
    """Return an empty replay of samples and filter states; `clear` has to make its first snapshot.

    Args:
        feet: number of feet.
        points: number of contact points.
        modes: number of hypotheses about sliding feet.
        frame: `FRAME` = 4 if states hold the frame of another source, else 0.
    """
    return Replay(
        new_samples(feet, points), np.zeros(EXTERNAL_END + 1, dtype=np.int64), np.zeros(SNAPSHOTS, dtype=np.int64),
        BestState(*(np.stack([part] * SNAPSHOTS) for part in new_state(points, modes, frame))),
    )  # fmt: skip


@kernel
def _snap(replay: Replay, state: BestState) -> None:
    """Store `state` as the newest snapshot of `replay`, in place; the oldest is dropped when the ring is full."""
    marks, kept = replay.marks, replay.snapshots
    if marks[COUNT] == SNAPSHOTS:
        marks[FIRST] = (marks[FIRST] + 1) % SNAPSHOTS
        marks[COUNT] -= 1
    at = (marks[FIRST] + marks[COUNT]) % SNAPSHOTS
    marks[COUNT] += 1
    replay.snapshot_ns[at] = marks[DONE_NS]
    kept.x[at], kept.cov[at], kept.points[at] = state.x, state.cov, state.points
    kept.turn[at], kept.memory[at], kept.weight[at] = state.turn, state.memory, state.weight
    kept.mode_x[at], kept.mode_cov[at], kept.mode_points[at] = state.mode_x, state.mode_cov, state.mode_points
    kept.mode_turn[at], kept.mode_memory[at] = state.mode_turn, state.mode_memory
    kept.sensors[at] = state.sensors


@kernel
def _go_back(replay: Replay, state: BestState) -> None:
    """Set `state` to the last snapshot before the oldest late sample, in place; drop later snapshots of `replay`."""
    marks, kept = replay.marks, replay.snapshots
    last = (marks[FIRST] + marks[COUNT] - 1) % SNAPSHOTS
    while marks[COUNT] > 1 and replay.snapshot_ns[last] >= marks[DIRTY_NS]:
        marks[COUNT] -= 1
        last = (marks[FIRST] + marks[COUNT] - 1) % SNAPSHOTS
    marks[DONE_NS], marks[DIRTY_NS] = replay.snapshot_ns[last], NOTHING
    state.x[:], state.cov[:], state.points[:] = kept.x[last], kept.cov[last], kept.points[last]
    state.turn[:], state.memory[:], state.weight[:] = kept.turn[last], kept.memory[last], kept.weight[last]
    state.mode_x[:], state.mode_cov[:] = kept.mode_x[last], kept.mode_cov[last]
    state.mode_points[:], state.mode_turn[:] = kept.mode_points[last], kept.mode_turn[last]
    state.mode_memory[:], state.sensors[:] = kept.mode_memory[last], kept.sensors[last]


@kernel
def clear(replay: Replay, state: BestState) -> None:
    """Forget all samples and snapshots of `replay`, in place; `state` becomes the first snapshot."""
    marks = replay.marks
    marks[IMU_END] = marks[FEET_END] = marks[EXTERNAL_END] = marks[FIRST] = marks[COUNT] = 0
    marks[DONE_NS], marks[DIRTY_NS] = -1, NOTHING
    _snap(replay, state)


@kernel
def note_sample(replay: Replay, source: int, end: int, stamp_ns: int) -> None:
    """Note in `replay` that a sample was inserted, in place; one before the state makes a replay due.

    Args:
        replay: memory of the filter for replays; changed.
        source: `IMU_END`, `FEET_END` or `EXTERNAL_END`.
        end: number of samples of that source now.
        stamp_ns: stamp of the sample, ns.
    """
    marks = replay.marks
    marks[source] = end
    if stamp_ns <= marks[DONE_NS]:
        marks[DIRTY_NS] = min(marks[DIRTY_NS], stamp_ns)


@kernel
def bring_up(replay: Replay, state: BestState, setting: BestSetting) -> None:
    """Advance the state to the newest inertial sample, in place; late samples cost one replay of the window.

    Args:
        replay: stored samples and snapshots; changed.
        state: state of the filter; changed.
        setting: geometry, noises and limits of the filter.
    """
    marks, samples = replay.marks, replay.samples
    if marks[DIRTY_NS] != NOTHING:
        _go_back(replay, state)
    count, m, e = marks[IMU_END], marks[FEET_END], marks[EXTERNAL_END]
    stamps = samples.imu_stamps[:count]
    while count > 0 and marks[DONE_NS] < stamps[count - 1]:
        last = (marks[FIRST] + marks[COUNT] - 1) % SNAPSHOTS
        due = replay.snapshot_ns[last] + SNAPSHOT_NS
        begin = after(stamps, marks[DONE_NS])  # pyright: ignore[reportArgumentType] - a number to the compiler
        end = max(begin + 1, after(stamps, due))  # pyright: ignore[reportArgumentType] - likewise
        part = SampleStore(
            stamps[:end], samples.imu[:end], samples.feet_stamps[:m], samples.feet[:m], samples.foot_rots[:m],
            samples.contact[:m], samples.closed[:m], samples.external_stamps[:e], samples.external[:e],
        )  # fmt: skip
        advance(state, part, begin, setting)
        marks[DONE_NS] = stamps[end - 1]
        if marks[DONE_NS] >= due:
            _snap(replay, state)


@kernel
def restart_clock(replay: Replay, state: BestState) -> None:
    """Forget all samples, velocity and feet because stamps begin anew, in place; the rest of `state` stays."""
    state.weight[:] = 0.0
    forget(state, 1.0)
    clear(replay, state)


@kernel
def step_clock(replay: Replay, state: BestState, stamp_ns: int) -> None:
    """Move the newest inertial sample to `stamp_ns`, ns, because stamps step back, and forget all others, in place.

    `replay`: samples and snapshots, changed; `state`: of the filter, which becomes the only snapshot and stays.
    """
    marks, samples = replay.marks, replay.samples
    row = samples.imu[marks[IMU_END] - 1].copy()
    clear(replay, state)
    samples.imu_stamps[0], samples.imu[0], marks[IMU_END] = stamp_ns, row, 1
    marks[DONE_NS] = replay.snapshot_ns[0] = stamp_ns
