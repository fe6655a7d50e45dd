"""Docking: the last part of a goal, steered by what a standing robot measures of the goal's marker itself.

The robot stands, measures the marker, and moves so that it lies where it is wanted: m is its place in base_link, o the
wanted one. With a wanted heading, a turn `a` away by the belief, base_link has to move by t = m - R(a) o, then turn by
a. Without one it turns by b and walks d straight, so that R(-b) m = o + (d, 0). It measures again until the marker
surely lies within the tolerances, or gives up.
"""

import math
from collections import deque
from collections.abc import Callable

from surefoot.schemas.hw import LandmarkDetections

from .belief.tracker import PoseTracker
from .belief.ukf import wrap
from .goals import Act, End, GaitView, NavigationGoal
from .maps import Maps
from .marker import Dock, MarkerSight, Measured
from .orders import straight, turned, walked
from .policy.settings import Conduct

SETTLE_S = 1.0
"""Time after which the trunk of a robot that came to stand rests, s; frames before it do not count."""
LOOK_S = (1.0, 6.0)
"""Shortest and longest time of a look at the marker, s."""
LITTLE_M, LITTLE_RAD = 0.004, 0.012
"""Walk, m, and turn, rad, below which a move is left out, as feet so near to their place make no step."""
STEEP = math.radians(20.0)
"""Largest angle at which the robot walks obliquely to its place, rad; beyond it, it walks back first to come nearer."""
BACK_BY = 0.3
"""Longest such walk back, m."""
FAR_M = 0.6
"""Distance of the believed position from the place before the marker beyond which the robot walks there anew, m."""
TRIES = 3
"""Number of looks in a row without the marker after which the goal ends."""

Move = tuple[str, float]
"""Move of the robot: `turn`, rad, left positive, or `walk`, m, forward positive."""


class Docking:
    """Executor of the last part of a goal that docks on a marker.

    Args:
        acts: actions of the robot.
        move: orders an action.
        conduct: standard deviations between measurement and tolerance, number of approaches.
        ways: obstacles; None = there are none.
    """

    def __init__(self, acts: tuple[Act, ...], move: Callable[[Act], None], conduct: Conduct, ways: Maps | None) -> None:
        self._acts, self._move, self._conduct, self._ways = acts, move, conduct, ways
        self.begin()

    def begin(self) -> None:
        """Discard moves and sightings: the next look decides anew."""
        self._moves: deque[Move] = deque()
        self._sight = MarkerSight()
        self._stands_from: float | None = None
        """Simulated time since which the robot stands, s; None = it moves."""

    def see(self, frame: LandmarkDetections, goal: NavigationGoal | None, tracker: PoseTracker, now: float) -> None:
        """Take a frame of the camera at the simulated time `now`, s, if the robot has come to rest before a marker."""
        rests = self._stands_from is not None and now - self._stands_from >= SETTLE_S
        if rests and goal is not None and goal.dock is not None:
            self._sight.take(frame, goal.dock, tracker)

    def tick(
        self, goal: NavigationGoal, dock: Dock, now: float, gait: GaitView, tracker: PoseTracker, *, blocked: bool
    ) -> End | None:  # fmt: skip
        """Order the next move when it is due; return the end of the goal, None = it goes on.

        Args:
            goal: under way; its recoveries are counted.
            dock: its marker, whose progress is changed.
            now: simulated time, s.
            gait: state of the walker.
            tracker: belief.
            blocked: True = an obstacle is too near ahead to walk.
        """
        if gait.state != "standing" or gait.ends_in is not None:
            self._stands_from = None
            return None
        if self._moves:
            return self._go(blocked=blocked)
        if self._stands_from is None:
            self._stands_from, self._sight = now, MarkerSight()
        looked = now - self._stands_from - SETTLE_S
        found = self._sight.measured(tracker.standing, tracker.shared)
        if looked < LOOK_S[0] or (looked < LOOK_S[1] and self._looks_on(dock, found)):
            return None
        self._stands_from = None  # the next look is another one
        if found is None:
            return self._blind(goal, dock, tracker)
        dock.blind, dock.seen = 0, (found.forward, found.left)
        end = self._end(dock, found, tracker)
        if end is not None:
            return end
        dock.moves += 1
        self._moves.extend(self._way(dock, found, tracker))
        return None

    def _looks_on(self, dock: Dock, found: Measured | None) -> bool:
        """Return True while more frames may decide: the marker is measured coarsely, or perhaps in its place."""
        if found is None or self._conduct.sure * found.sd > 0.5 * dock.xy_tolerance:
            return True
        beside = math.hypot(found.forward - dock.offset[0], found.left - dock.offset[1])
        return dock.xy_tolerance - self._conduct.sure * found.sd < beside <= dock.xy_tolerance

    def _go(self, *, blocked: bool) -> None:
        """Order the next move; a walk ahead before an obstacle, and what comes after it, is dropped."""
        what, size = self._moves.popleft()
        if what == "turn":
            self._move(turned(self._acts, "dock", size))
        elif blocked and size > 0.0:
            self._moves.clear()
        else:
            self._move(walked(self._acts, "dock", size))

    def _off(self, dock: Dock, tracker: PoseTracker) -> tuple[float, float]:
        """Return the turn to the wanted heading and the standard deviation of the heading, rad; 0, 0 where any does."""
        if dock.yaw is None:
            return 0.0, 0.0
        return float(wrap(dock.yaw - tracker.pose[2])), math.sqrt(max(0.0, float(tracker.cov[2, 2])))

    def _end(self, dock: Dock, found: Measured, tracker: PoseTracker) -> End | None:
        """Return the end of the goal for a measured marker: surely in its place, or no more tries; None = neither."""
        conduct, (ox, oy) = self._conduct, dock.offset
        beside = math.hypot(found.forward - ox, found.left - oy)
        bearing = float(wrap(math.atan2(found.left, found.forward) - math.atan2(oy, ox)))
        turn, heading_sd = self._off(dock, tracker)
        off = max(abs(bearing), abs(turn) + conduct.sure * heading_sd)
        text = f"the marker lies {100.0 * beside:.1f} cm and {math.degrees(bearing):.1f} deg from where it is wanted"
        if dock.yaw is not None:
            text += f", the heading is {math.degrees(turn):.1f} deg off by the belief"
        if beside + conduct.sure * found.sd <= dock.xy_tolerance and off <= dock.yaw_tolerance:
            return "succeeded", "", text
        if dock.moves < conduct.dock_moves:
            return None
        asked = f"{100.0 * dock.xy_tolerance:g} cm and {math.degrees(dock.yaw_tolerance):.1f} deg"
        text += f", with a deviation of {100.0 * found.sd:.1f} cm after {dock.moves} approaches; surely within {asked} "
        return "failed", "arrived_unsure", text + "was asked for"

    def _way(self, dock: Dock, found: Measured, tracker: PoseTracker) -> list[Move]:
        """Return the moves after which the marker lies where it is wanted."""
        mx, my, (ox, oy) = found.forward, found.left, dock.offset
        if dock.yaw is None:
            ahead = math.sqrt(max(0.0, mx * mx + my * my - oy * oy))
            return moves((float(wrap(math.atan2(my, mx) - math.atan2(oy, ahead))), ahead - ox))
        a = self._off(dock, tracker)[0]
        c, s = math.cos(a), math.sin(a)
        tx, ty = mx - c * ox + s * oy, my - s * ox - c * oy
        along, left = c * tx + s * ty, c * ty - s * tx  # from here, in axes of the wanted heading
        if math.hypot(tx, ty) <= 0.4 * dock.xy_tolerance:
            return moves((a, 0.0))
        sign = 1.0 if along >= 0.0 else -1.0
        angle = math.atan2(sign * left, abs(along))
        if abs(angle) <= STEEP or abs(left) <= 0.4 * dock.xy_tolerance:
            angle = 0.0 if abs(left) <= 0.2 * dock.xy_tolerance else angle
            return moves((a + angle, sign * math.hypot(along, left) if angle else along), (-angle, 0.0))
        back = min(BACK_BY, abs(left) / math.tan(STEEP) - along)
        pose = tracker.pose
        behind = (pose[0] - back * math.cos(pose[2] + a), pose[1] - back * math.sin(pose[2] + a))
        if self._ways is not None and not self._ways.enterable(pose[:2], behind):
            back = 0.0  # the way there is closed: sideways over a turn
        angle = math.atan2(left, along + back)
        return moves((a, -back), (angle, math.hypot(along + back, left)), (-angle, 0.0))

    def _blind(self, goal: NavigationGoal, dock: Dock, tracker: PoseTracker) -> End | None:
        """Turn to where the marker should be, or step back, after a look that did not show it; end after three."""
        x, y, heading = tracker.pose
        gx, gy = goal.route[-1]
        if math.hypot(gx - x, gy - y) > FAR_M and dock.blind < TRIES:
            dock.begun, dock.blind, goal.index = False, dock.blind + 1, len(goal.route) - 1
            return None
        dock.blind += 1
        if dock.blind >= TRIES:
            return "failed", "arrived_unsure", f"the marker was not seen in {TRIES} looks near its place"
        goal.recoveries["look"] += 1
        dx, dy = dock.place[0] - x, dock.place[1] - y
        turn = float(wrap(math.atan2(dy, dx) - heading))
        self._moves.extend(moves((turn, 0.0), (0.0, -straight(self._acts).motion.forward)))
        return None


def moves(*legs: tuple[float, float]) -> list[Move]:
    """Return the turn, rad, and the walk, m, of each leg as moves, without those that are too small to step for."""
    return [
        (what, size)
        for leg in legs
        for what, size, least in (("turn", leg[0], LITTLE_RAD), ("walk", leg[1], LITTLE_M))
        if abs(size) >= least
    ]
