"""Stamped samples in the order of their stamps, whatever the order of their arrival."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from surefoot.services.estimator.results import InputResult

Stamps = NDArray[np.int64]
Arrays = tuple[NDArray[np.float64], ...]

WINDOW_NS = 500_000_000
"""A sample may come this late and still be put where it belongs."""
AHEAD_NS = 500_000_000  # a stamp further ahead of its source waits for the next to confirm it
RESYNC_AFTER = 20  # samples of an older but orderly clock in a row: the source restarted its clock
CAPACITY = 4096  # samples; at 1 kHz 4 s


class Samples:
    """The last samples of one source: rising stamps, and arrays with one row for each."""

    def __init__(self, *shapes: tuple[int, ...]) -> None:
        self._stamps = np.zeros(CAPACITY, dtype=np.int64)
        self._values = tuple(np.zeros((CAPACITY, *shape)) for shape in shapes)
        self.clear()

    def clear(self) -> None:
        """Forget all samples."""
        self._end = 0

    def __len__(self) -> int:
        return self._end

    @property
    def stamps(self) -> Stamps:
        """Of all samples, (n,) ns, rising; a view."""
        return self._stamps[: self._end]

    @property
    def values(self) -> Arrays:
        """One array per shape, (n, ...); views."""
        return tuple(v[: self._end] for v in self._values)

    @property
    def newest(self) -> int:
        """Stamp of the newest sample, ns; -1 = there is none."""
        return int(self._stamps[self._end - 1]) if self._end else -1

    def after(self, stamp_ns: int) -> int:
        """Index of the first sample later than a stamp."""
        return int(np.searchsorted(self.stamps, stamp_ns, side="right"))

    def add(self, stamp_ns: int, *values: NDArray[np.float64]) -> bool:
        """Put a sample where it belongs; False if there is one of this stamp."""
        if self._end == CAPACITY:
            self._drop_oldest()
        at = self._end
        if at and stamp_ns <= self._stamps[at - 1]:
            at = self.after(stamp_ns)
            if at and self._stamps[at - 1] == stamp_ns:
                return False
            for column in (self._stamps, *self._values):
                column[at + 1 : self._end + 1] = column[at : self._end].copy()
        self._stamps[at] = stamp_ns
        for column, value in zip(self._values, values, strict=True):
            column[at] = value
        self._end += 1
        return True

    def _drop_oldest(self) -> None:
        keep = CAPACITY // 2
        for column in (self._stamps, *self._values):
            column[:keep] = column[CAPACITY - keep :].copy()
        self._end = keep


@dataclass
class ClockJudge:
    """Whether the stamp of a sample makes sense after those before it."""

    newest: int | None = None
    _older: int = 0
    _older_last: int = 0
    _ahead: int | None = None

    def judge(self, stamp_ns: int, now_ns: int) -> InputResult:
        """Judge a stamp.

        Args:
            stamp_ns: the stamp.
            now_ns: newest stamp of all sources.

        Returns:
            `ok`; `late`: older than the window; `ahead`: further ahead than a gap, unconfirmed; `restart`: the
            source's clock began anew.
        """
        if self.newest is None:
            self.newest = stamp_ns
            return InputResult.OK
        if stamp_ns > self.newest + AHEAD_NS:
            confirmed = self._ahead is not None and 0 < stamp_ns - self._ahead < AHEAD_NS
            self._ahead = stamp_ns
            if not confirmed:
                return InputResult.AHEAD
            self._accept(stamp_ns)
            return InputResult.OK
        if stamp_ns >= now_ns - WINDOW_NS:
            self._accept(max(stamp_ns, self.newest))
            return InputResult.OK
        self._older = self._older + 1 if self._older and stamp_ns > self._older_last else 1
        self._older_last = stamp_ns
        if self._older < RESYNC_AFTER:
            return InputResult.LATE
        self._accept(stamp_ns)
        return InputResult.RESTART

    def _accept(self, stamp_ns: int) -> None:
        self.newest, self._older, self._ahead = stamp_ns, 0, None
