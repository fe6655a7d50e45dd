"""Conversion of velocity commands of ROS 2 to commands of the walker."""

import math

from surefoot.schemas.cmd import WalkCommand

HORIZON_S = 2.0
"""Duration of a walk command, s; it is renewed after half of it while velocity commands arrive."""
SILENT_S = 0.5
"""Time without a velocity command after which the robot is stopped, s."""
STILL_MPS, STILL_RADPS = 0.005, 0.02
"""Speeds below which a velocity command means stand: `STILL_MPS`, forward, m/s; `STILL_RADPS`, turning, rad/s."""
FASTEST_MPS, FASTEST_RADPS = 1.0, 10.0
"""Speeds to which faster commands are limited: `FASTEST_MPS`, forward, m/s; `FASTEST_RADPS`, turning, rad/s. The walker
refuses what exceeds its own limits."""
AGAIN_S = 0.2
"""Time after which a walk command without a reply is sent again, s."""
TURN_RAD = 0.2
"""Turn within `HORIZON_S` from which on a robot that cannot walk arcs turns on the spot first, rad."""


class Steering:
    """Converter from the newest velocity command to walk commands, which holds the command under way."""

    def __init__(self) -> None:
        self.arcs = True
        """True until the walker refuses an arc, then False: the robot walks and turns in alternation."""
        self._wanted = (0.0, 0.0)
        self._came_s = self._ordered_s = float("-inf")
        self._again_s = float("-inf")
        self._order: tuple[float, float] | None = (0.0, 0.0)
        """Forward speed, m/s, and turning speed, rad/s, of the command under way; None = unknown, as it was not
        answered."""

    def take(self, now_s: float, forward: float, turn: float) -> None:
        """Store a velocity command: `forward`, m/s, and `turn`, rad/s; one that is not finite makes the robot stand.

        `now_s`: time of its arrival, s.
        """
        if not (math.isfinite(forward) and math.isfinite(turn)):
            forward = turn = 0.0
        forward = min(max(forward, -FASTEST_MPS), FASTEST_MPS)
        turn = min(max(turn, -FASTEST_RADPS), FASTEST_RADPS)
        still = abs(forward) < STILL_MPS and abs(turn) < STILL_RADPS
        self._wanted, self._came_s = (0.0, 0.0) if still else (forward, turn), now_s

    def order(self, now_s: float) -> WalkCommand | None:
        """Return the walk command to send now; None: the one under way still holds."""
        if now_s < self._again_s:
            return None
        wanted = self._wanted if now_s - self._came_s <= SILENT_S else (0.0, 0.0)
        moving = wanted != (0.0, 0.0)
        if not moving and now_s - self._came_s > SILENT_S + HORIZON_S:
            self._order = wanted  # what was ordered last has ended by itself
        if wanted == self._order and not (moving and now_s - self._ordered_s >= 0.5 * HORIZON_S):
            return None
        self._order, self._ordered_s = wanted, now_s
        if not moving:
            return WalkCommand(action="stop")
        forward, angle = wanted[0], HORIZON_S * wanted[1]
        if abs(forward) < STILL_MPS or (not self.arcs and abs(angle) >= TURN_RAD):
            return WalkCommand(action="turn", angle=angle, duration=HORIZON_S)
        arc = angle if self.arcs and abs(wanted[1]) >= STILL_RADPS else None
        return WalkCommand(action="walk", velocity=forward, angle=arc, duration=HORIZON_S)

    def refused(self, code: str) -> None:
        """Handle the refusal of the last command: a refused arc is not tried again, others at the next renewal."""
        if code == "unsupported":
            self.arcs = False
            self._order = None

    def unanswered(self, now_s: float) -> None:
        """Record at `now_s`, s, that the last command may be lost: the next, also a stop, is due `AGAIN_S` later."""
        self._order, self._again_s = None, now_s + AGAIN_S
