"""Faults of the sensors of a leg that spoil the slip of its stances: encoders that stand still or jump, stuck switches.

A stance is the time in which a foot stands. It ends while its foot rises, so each joint that lifts it has moved within
the last tenths of a second, and each that carries the trunk on has moved in the stance: an encoder that has given one
and the same number for longer stands still. A joint cannot move farther between two samples than its motor turns. A
switch that stays closed while its foot rises is stuck.
"""

from dataclasses import dataclass, field

import numpy as np

from surefoot.arrays import Array, Flags
from surefoot.robot.description import Robot

STILL_S = 0.35
"""Time without any change of its angle after which an encoder counts as frozen at the end of a stance, s."""
FASTEST = 12.0
"""Joint speed between two samples, rad/s, above which an encoder jumped: unloaded hobby servos turn by 8 to 10."""
KEPT_S = 1.0
"""Time after a jump of an encoder for which its leg counts as faulty, s: until the stance of the jump has ended."""
RISEN = 0.015
"""Rise of a foot over the begin of its stance, m, above which its closed switch counts as stuck."""


@dataclass(eq=False)
class LegFaults:
    """Detector of legs whose encoders or foot switches fail, so that slip is not learned from their stances."""

    joints: tuple[tuple[int, ...], ...]
    count: int
    still_s: Array = field(init=False)
    """Time since the angle of each joint changed last, (nj,) s."""

    def __post_init__(self) -> None:
        self.still_s = np.zeros(self.count)
        self._last: Array | None = None
        self._stamp_ns = 0
        self._jumped_s = np.full(len(self.joints), np.inf)

    def update(self, q: Array, stamp_ns: int, closed: Flags, risen: Array) -> Flags:
        """Take one sample; return True for legs whose stance, if it ends now, is not to be learned from, (L,).

        Args:
            q: joint angles, (nj,) rad.
            stamp_ns: time of the sample, ns.
            closed: foot switches, True = closed, (L,).
            risen: height of each foot over the begin of its stance, (L,) m; 0 in swing.
        """
        moved = np.zeros(self.count) if self._last is None else np.abs(q - self._last)
        dt_s = 0.0 if self._last is None else 1e-9 * (stamp_ns - self._stamp_ns)
        self._last, self._stamp_ns = q.copy(), stamp_ns
        self.still_s = np.where(moved > 0.0, 0.0, self.still_s + dt_s)
        self._jumped_s += dt_s
        out = closed & (risen > RISEN)
        for leg, own in enumerate(self.joints):
            at = list(own)
            if (moved[at] > FASTEST * max(dt_s, 1e-3)).any() or out[leg]:
                self._jumped_s[leg] = 0.0
            out[leg] |= bool(self._jumped_s[leg] < KEPT_S or (self.still_s[at] > STILL_S).any())
        return out


def leg_faults(robot: Robot) -> LegFaults:
    """Return a new detector of failing encoders and foot switches for the legs of a robot."""
    return LegFaults(tuple(tuple(leg.joints) for leg in robot.legs), robot.nj)
