"""Faults of the sensors of a leg that spoil the slip of its stances: encoders that stand still or jump, stuck switches.

A stance is the time in which a foot stands. It ends while its foot rises, so each joint that lifts it has moved within
the last tenths of a second, and each that carries the trunk on has moved in the stance: an encoder that has given one
and the same number for longer stands still. A joint cannot move farther between two samples than its motor turns. A
switch that stays closed while its foot rises is stuck.
"""

from collections.abc import Sequence

import numpy as np

from surefoot.arrays import Array, Flags, Ints
from surefoot.kernels.jit import kernel
from surefoot.robot.description import Robot

STILL_S = 0.35
"""Time without any change of its angle after which an encoder counts as frozen at the end of a stance, s."""
FASTEST = 12.0
"""Joint speed between two samples, rad/s, above which an encoder jumped: unloaded hobby servos turn by 8 to 10."""
KEPT_S = 1.0
"""Time after a jump of an encoder for which its leg counts as faulty, s: until the stance of the jump has ended."""
RISEN = 0.015
"""Rise of a foot over the begin of its stance, m, above which its closed switch counts as stuck."""


class LegFaults:
    """Detector of legs whose encoders or foot switches fail, so that slip is not learned from their stances.

    Args:
        joints: indices of the joints of each leg.
        count: number of joints nj.
    """

    def __init__(self, joints: Sequence[Sequence[int]], count: int) -> None:
        self._joints = np.full((len(joints), max(map(len, joints))), -1, dtype=np.int64)
        """Joints of each leg, (L, n); -1 fills the rows of legs with fewer."""
        for leg, own in enumerate(joints):
            self._joints[leg, : len(own)] = own
        self._still_s = np.zeros(count)
        """Time since the angle of each joint changed last, (nj,) s."""
        self._last = np.zeros(count)
        """Angles at the sample before, (nj,) rad."""
        self._jumped_s = np.full(len(joints), np.inf)
        """Time since an encoder of each leg jumped, or its switch was stuck, last, (L,) s."""
        self._stamp_ns: int | None = None

    def update(self, q: Array, stamp_ns: int, closed: Flags, risen: Array) -> Flags:
        """Take one sample; return True for legs, (L,), whose stance must not be learned from if it ends now.

        Args:
            q: joint angles, (nj,) rad.
            stamp_ns: time of the sample, ns.
            closed: foot switches, True = closed, (L,).
            risen: height of each foot over the begin of its stance, (L,) m; 0 in swing.
        """
        if self._stamp_ns is None:
            self._last[:], self._stamp_ns = q, stamp_ns
        dt_s, self._stamp_ns = 1e-9 * (stamp_ns - self._stamp_ns), stamp_ns
        return _faulty(self._joints, self._last, self._still_s, self._jumped_s, q, dt_s, closed, risen)


@kernel
def _faulty(
    joints: Ints, last: Array, still_s: Array, jumped_s: Array, q: Array, dt_s: float, closed: Flags, risen: Array
) -> Flags:
    """Update the memory of joints and legs with one sample, in place; return True for faulty legs, (L,).

    Args:
        joints: joints of each leg, (L, n), -1 = none.
        last: angles at the sample before, (nj,) rad; changed.
        still_s: time since each angle changed last, (nj,) s; changed.
        jumped_s: time since an encoder of each leg jumped, or its switch was stuck, last, (L,) s; changed.
        q: joint angles, (nj,) rad.
        dt_s: time since the sample before, s.
        closed: foot switches, True = closed, (L,).
        risen: height of each foot over the begin of its stance, (L,) m; 0 in swing.
    """
    moved = np.abs(q - last)
    for j in range(q.size):
        last[j], still_s[j] = q[j], 0.0 if moved[j] > 0.0 else still_s[j] + dt_s
    out = np.zeros(jumped_s.size, dtype=np.bool_)
    for leg in range(jumped_s.size):
        jumped, still = closed[leg] and risen[leg] > RISEN, False
        for j in joints[leg]:
            if j >= 0:
                jumped = jumped or moved[j] > FASTEST * max(dt_s, 1e-3)
                still = still or still_s[j] > STILL_S
        jumped_s[leg] = 0.0 if jumped else jumped_s[leg] + dt_s
        out[leg] = still or jumped_s[leg] < KEPT_S
    return out


def leg_faults(robot: Robot) -> LegFaults:
    """Return a new detector of failing encoders and foot switches for the legs of a robot."""
    return LegFaults([leg.joints for leg in robot.legs], robot.nj)
