"""Progress reports of long work: the share that is done and the time left."""

import threading
import time
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Self

from surefoot.errors import SurefootError, printable
from surefoot.kernels.compiling import COMPILING

from .output import notify

FIRST_S, SECOND_S, EACH_S = 0.5, 2.0, 10.0
"""Wall time between progress lines, s: `FIRST_S`: before the first line; `SECOND_S`: from the first to the second;
`EACH_S`: longest between further lines."""
LEAST_SHARE = 0.01
"""Finished share of the work, 0 to 1, from which on the remaining time is shown; below, it would be too uncertain."""


class Progress:
    """Progress lines of long work: its name within the first second, then the share done and the time left.

    As a context manager it also writes lines while the work reports no share, and on Ctrl-C a line with `kept`. The
    time left is that of the work alone: imports before the first share, and compilations, which have lines of their
    own, are no measure of it.

    Args:
        what: name of the work, shown in the lines.
        kept: text on what remains of the result after Ctrl-C.
        report: called with each line.
        clock: returns the time, s.
        reads: files and folders that the work needs; checked here, so that an error precedes the first line.

    Raises:
        SurefootError: one of the files or folders is absent.
    """

    def __init__(
        self,
        what: str,
        kept: str = "nothing was written",
        report: Callable[[str], None] = notify,
        clock: Callable[[], float] = time.monotonic,
        reads: Iterable[Path] = (),
    ) -> None:
        for path in reads:
            try:
                path.stat()
            except OSError as error:
                raise SurefootError("unreadable", f"{path}: {error.strerror}") from None
        self._what, self.kept, self._report, self._clock = printable(what), kept, report, clock
        self._share, self._step = 0.0, ""
        self._began = clock()
        self._next = self._began + FIRST_S
        self._paced = self._worked(), 0.0  # time of the work, and its share, from which on its pace counts
        self._lock, self._over = threading.Lock(), threading.Event()
        self._watcher = threading.Thread(target=self._watch, daemon=True)

    def __enter__(self) -> Self:
        self._watcher.start()
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        self._over.set()
        self._watcher.join()
        if kind is not None and issubclass(kind, KeyboardInterrupt):
            done = f" at {100.0 * self._share:.0f} %" if self._share > 0.0 else ""
            self._report(f"{self._what}: interrupted{done}; {self.kept}")

    def at(self, share: float, step: str = "") -> None:
        """Set the finished share of the work, 0 to 1, and the name of the present step; write a line if one is due."""
        with self._lock:
            if self._share == 0.0 and share < LEAST_SHARE:
                self._paced = self._worked(), share
            self._share, self._step = share, step
        self._write_due()

    def and_on(self, share: float) -> bool:
        """Set the finished share of the work, 0 to 1; return True, for use as a callback whose False means stop."""
        self.at(share)
        return True

    def part(self, begin: float, end: float, step: str = "") -> Callable[[float], None]:
        """Return a setter for a part of the work: its share 0 to 1 maps to `begin` to `end` of the whole."""
        return lambda share: self.at(begin + share * (end - begin), step)

    def _watch(self) -> None:
        while not self._over.wait(max(0.01, self._next - self._clock())):
            self._write_due()

    def _worked(self) -> float:
        """Return the time without that of compilations, s."""
        return self._clock() - COMPILING.spent_s

    def _write_due(self) -> None:
        with self._lock:
            now, share, step = self._clock(), self._share, self._step
            if now < self._next or share >= 1.0:
                return
            spent, (since, before) = now - self._began, self._paced
            self._next = now + min(EACH_S, max(SECOND_S, spent))
            if COMPILING.reported and spent >= SECOND_S:  # whose lines state share and time left
                return
        state = "at work"
        if share >= LEAST_SHARE:
            left = (self._worked() - since) * (1.0 - share) / (share - before)
            state = f"{100.0 * share:.0f} %, about {left:.0f} s left"
        elif spent >= SECOND_S:
            state = f"at work for {spent:.0f} s"
        self._report(f"{self._what}: {state}{f' ({step})' if step else ''}")
