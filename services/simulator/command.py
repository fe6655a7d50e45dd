"""The border at which joint commands are judged: refused with a reason, or held when stale."""

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]

STALE_NS = 100_000_000  # a command older than this is stale: the driver holds the last one and reports
LIMIT_SLACK = 1e-6  # rad, rounding of a command at the limit


class CommandGuard:
    """Keeps the last good command and counts what it refused, by reason."""

    def __init__(self, lower: Array, upper: Array) -> None:
        self.lower, self.upper = lower, upper
        self.refused: dict[str, int] = {}
        self.clear(np.zeros_like(lower))

    def clear(self, hold: Array) -> None:
        """Forget the last command and hold this position; a new epoch."""
        self.q = np.array(hold)
        self.stamp_ns = -1

    def offer(self, q: ArrayLike, stamp_ns: int) -> str | None:
        """Take a command, or say why not.

        Args:
            q: joint positions in the robot's order, rad.
            stamp_ns: simulated time the command is for.

        Returns:
            None when taken; else `wrong_length`, `not_finite`, `out_of_range` or `stamp_back`.
        """
        value = np.asarray(q, dtype=np.float64)
        if value.shape != self.lower.shape:
            return self._refuse("wrong_length")
        if not np.isfinite(value).all():
            return self._refuse("not_finite")
        if (value < self.lower - LIMIT_SLACK).any() or (value > self.upper + LIMIT_SLACK).any():
            return self._refuse("out_of_range")
        if stamp_ns < self.stamp_ns:
            return self._refuse("stamp_back")
        self.q, self.stamp_ns = value.copy(), stamp_ns
        return None

    def stale(self, now_ns: int) -> bool:
        """Whether the last command is too old; before the first command nothing is stale."""
        return self.stamp_ns >= 0 and now_ns - self.stamp_ns > STALE_NS

    def _refuse(self, reason: str) -> str:
        self.refused[reason] = self.refused.get(reason, 0) + 1
        return reason

    def state(self) -> dict[str, Any]:
        """The last command and the counts."""
        return {"q": self.q.tolist(), "stamp_ns": self.stamp_ns, "refused": dict(self.refused)}

    def restore(self, state: dict[str, Any]) -> None:
        """Continue where `state` was taken."""
        self.q, self.stamp_ns = np.array(state["q"]), int(state["stamp_ns"])
        self.refused = dict(state["refused"])
