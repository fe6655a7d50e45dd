"""Ordered actions as motions in time, predicted for a robot without odometry.

An action counts as walked at constant rate from the landing of the last step before it to the landing of its own last
step; both times come from `state/gait`. The trunk follows the feet by a lag.
"""

import math
from dataclasses import dataclass, replace

from .belief.tracker import Motion
from .policy.settings import Conduct

LANDING_S = 0.9
"""Longest time from a stop order to the landing of the swinging foot, s: the duration of one step."""


@dataclass
class Piece:
    """Motion of one action that the walker carries out, at constant rate from start to end."""

    motion: Motion
    """Expected motion of the whole action."""
    start: float
    """Simulated time at which the action begins, s."""
    end: float
    """Simulated time at which the action ends, s."""
    done: float = 0.0
    """Share of the action's motion, 0 to 1, that the belief has already been predicted over."""


class Execution:
    """Actions under way, the oldest first: at most the one that ends and the one that follows.

    Args:
        lag: delay between a foot's landing and the trunk reaching its place, s.
    """

    def __init__(self, lag: float = Conduct().lag) -> None:
        self.lag = lag
        self.pieces: list[Piece] = []

    def begin(self, motion: Motion, duration: float, now: float, ends_in: float | None) -> None:
        """Record that the walker started an action.

        Args:
            motion: motion of the whole action.
            duration: duration of the action's steps, s.
            now: simulated time, s.
            ends_in: time until its last step lands, s; None = not published, `duration` counts.
        """
        end = now + (duration if ends_in is None else ends_in)
        last = self.pieces[-1].end - self.lag if self.pieces else now
        start = max(min(last, end), end - duration, now)
        self.pieces.append(Piece(motion, start + self.lag, end + self.lag))

    def correct(self, now: float, ends_in: float | None) -> None:
        """Set the end of the last action to the landing of its last foot, `ends_in` s after `now`; None = no change."""
        if self.pieces and ends_in is not None:
            last = self.pieces[-1]
            last.end = max(now + ends_in + self.lag, last.start + 1e-3)

    def cut(self, now: float, ends_in: float | None) -> None:
        """Shorten the last action of a walker that obeys a stop: what is left of it after the last landing is dropped.

        Args:
            now: simulated time, s.
            ends_in: time until that landing, s; None = not published: 0.45 s, half a step, is assumed.
        """
        if not self.pieces:
            return
        last, sd = self.pieces[-1], LANDING_S / math.sqrt(12.0) if ends_in is None else 0.0
        end = now + (0.5 * LANDING_S if ends_in is None else ends_in) + self.lag
        if end < last.end:
            span, whole = last.end - last.start, last.motion
            reached = last.start + last.done * span  # what was returned until there stays
            end = max(end, reached + 1e-3)
            rest = whole.part(min(1.0 - last.done, (end - reached) / span))
            along, heading = (sd * whole.forward / span) ** 2, (sd * whole.turn / span) ** 2
            motion = replace(rest, along=rest.along + along, heading=rest.heading + heading)
            self.pieces[-1] = Piece(motion, reached, end)

    def settle(self, now: float) -> None:
        """Record at `now`, s, that the walker stands: all actions end then, or at most the trunk's lag later."""
        for piece in self.pieces:
            piece.end = min(piece.end, max(now + self.lag, piece.start + 1e-3))
            piece.start = min(piece.start, now)

    def advance(self, now: float) -> list[Motion]:
        """Return the motions of the body since the last call, up to the time `now`, s."""
        moved: list[Motion] = []
        for piece in self.pieces:
            share = min(1.0, max(0.0, (now - piece.start) / max(piece.end - piece.start, 1e-3)))
            if share > piece.done:
                moved.append(piece.motion.part(share - piece.done))
                piece.done = share
        self.pieces = [piece for piece in self.pieces if piece.done < 1.0]
        return moved

    def rest(self) -> Motion:
        """Return the motion of the actions under way that is still to come."""
        total = Motion()
        for piece in self.pieces:
            left = piece.motion.part(1.0 - piece.done)
            total = Motion(*(a + b for a, b in zip(vars(total).values(), vars(left).values(), strict=True)))
        return total

    def stop(self) -> None:
        """Drop the actions under way: the robot halts, or another client commands it."""
        self.pieces.clear()
