"""Conduct of goals without a bus: decides in time, orders actions of the walker, recovers, ends.

An action is decided while the one before still runs, `LEAD_S` before its last step lands, on the belief predicted to
that moment, so that the walker goes on without a halt. A walker that does not publish its end is waited for.
"""

import math

import numpy as np
from numpy.typing import NDArray

from surefoot.schemas.cmd import WalkCommand
from surefoot.schemas.navigation import Decision, GoalState

from .belief.tracker import Motion, PoseTracker
from .belief.ukf import entropy, wrap
from .execution import Execution
from .goals import Act, End, GaitView, NavigationGoal, Searching
from .policy.policies import Decider, PolicyDecision

Array = NDArray[np.float64]

LEAD_S = 0.30
"""Time before the landing of an action's last step at which the next is decided, s: the walker needs 0.25 s, an order
takes 0.02 s."""
SURE = 2.0
"""Standard deviations that must fit between the estimate and the edge of the arrival zone."""
REACHED = 0.15
"""Distance of the estimate at which a waypoint counts as reached, m."""
ARRIVED_WITHIN = 0.20
"""Distance that surely contains the robot at the last waypoint, m."""
LOOKS, LOOK_FOR_S = 3, 2.0
"""Stands in a row to make sure of an arrival before the estimate decides; longest time of each without a frame, s."""
STUCK_S, PROGRESS_M = 120.0, 0.10
"""A waypoint is given up after this time, s, without coming nearer by this distance, m."""
ALIGNED = math.radians(8.0)
"""Largest error of the heading at the last waypoint that is not corrected by another turn, rad."""
REMIND_S = 1.0
"""Time after which an order is repeated that a standing walker has not taken up, s."""
LOOK_S = 3.0
"""Duration of a look of a lost robot in one direction, s."""
LOOK_TURN, TURNS = math.radians(46.0), 7
"""Turn between two looks of a lost robot, rad, and number of turns."""


class Pilot:
    """Conducts one goal at a time.

    Args:
        acts: the actions, in the order of the policy's values.
        commands: the pilot moves the tracker by the commands; else odometry moves it.
    """

    def __init__(self, acts: tuple[Act, ...], *, commands: bool) -> None:
        self.acts, self.commands = acts, commands
        self.execution = Execution()
        self.state: GoalState = "idle"
        self.error, self.message = "", ""
        self.goal: NavigationGoal | None = None
        self.decider: Decider | None = None
        self.number = 0
        self.order: WalkCommand | None = None
        self.decision: Decision | None = None
        self.decisions = 0
        self.ended = 0.0
        self._given: Act | None = None
        """Action of the last order, until the walker has taken it up."""
        self._walk_id: int | None = None
        self._given_at: float | None = None
        """Simulated time since which the walker has not taken up the order, s."""
        self._stand_until = -1.0
        self._frames: int | None = None
        """Number of frames at the begin of a look at the goal."""
        self._halting: End | None = None
        self._searching: Searching | None = None

    # -- goals -------------------------------------------------------------------------------------------------

    def begin(self, goal: NavigationGoal, decider: Decider) -> None:
        """Begin a goal; one under way ends as replaced, and the walk goes on."""
        self.goal, self.decider = goal, decider
        decider.begin()
        goal.nearest_at = max(goal.nearest_at, goal.began)
        self.state, self.error, self.message = "navigating", "", ""
        self.decision, self._halting, self._searching = None, None, None

    @property
    def end(self) -> End:
        """End of the goal, coming or past; of one under way, its present state."""
        return self._halting or (self.state, self.error, self.message)

    def resume(self, goal: NavigationGoal, decider: Decider, state: GoalState, end: End) -> None:
        """Continue a goal of an earlier pilot in `state` with its `end`: under way, halting or ended."""
        self.begin(goal, decider)
        if state == "stopping":
            self.halt(*end)  # again: that order may have been lost
        elif state != "navigating":
            self.state, self.error, self.message = end

    def cancel(self) -> bool:
        """End the goal; return False when there is none under way."""
        if self.state != "navigating":
            return False
        self.halt("cancelled", "cancelled", "cancelled by request")
        return True

    def halt(self, state: GoalState, error: str, message: str) -> None:
        """Order a stop; the goal has the given end as soon as the robot stands."""
        self._halting = (state, error, message)
        self.state = "stopping"
        self._give(WalkCommand(action="stop"), None)

    def fail(self, error: str, message: str) -> None:
        """End the goal at once: no order would be obeyed, or another client commands the robot."""
        self.state, self.error, self.message = "failed", error, message
        self.execution.stop()
        self._given, self._halting, self._searching = None, None, None

    # -- ticks -------------------------------------------------------------------------------------------------

    def follow(self, now: float, gait: GaitView, tracker: PoseTracker) -> None:
        """Record the orders that the walker took up, and move the belief where commands are the control."""
        given = self._given
        if self.number and gait.order == self.number and given is not None:
            self._given = None
            if given.kind != "stand" and not gait.refused:
                self.execution.begin(given.motion, given.duration, now, gait.ends_in)
        elif given is None:
            self.execution.correct(now, gait.ends_in)
        moved = self.execution.advance(now)
        if self.commands:
            for motion in moved:
                tracker.move(motion)

    def tick(self, now: float, gait: GaitView, tracker: PoseTracker, *, blocked: bool, lost: bool = False) -> None:
        """Decide, if it is time.

        Args:
            now: simulated time, s.
            gait: of this tick.
            tracker: belief now.
            blocked: something is too near ahead to walk.
            lost: the belief is wrong: the robot stands and looks, then turns and looks, until it is right again.
        """
        if self.goal is None or self.state not in ("navigating", "stopping"):
            return
        if self._went_wrong(gait):
            return
        if gait.order != self.number:
            self._remind(now, gait)
            return  # an order is on its way
        if self.state == "stopping":
            if gait.state == "standing" and self._halting is not None:
                self.state, self.error, self.message = self._halting
                self.execution.stop()
                self.ended = now
            return
        if lost or self._searching is not None:
            self._search(now, gait, lost=lost)
            if self._searching is not None or self.state != "navigating":
                return
        if self._is_time(now, gait, tracker):
            self._decide(now, gait, tracker, blocked=blocked)

    def _is_time(self, now: float, gait: GaitView, tracker: PoseTracker) -> bool:
        """Return whether the next action has to be decided now."""
        if gait.ends_in is not None:
            return gait.ends_in <= LEAD_S and self._stand_until <= now
        if self._frames is not None and gait.state != "standing":
            self._frames = tracker.frames  # only a frame of a standing robot is a look
        looked = self._frames is not None and tracker.frames > self._frames
        return gait.state == "standing" and (now >= self._stand_until or looked)

    def _remind(self, now: float, gait: GaitView) -> None:
        """Repeat an order that a standing walker has not taken up: walker or navigator was started again.

        A pilot that was started again has no order to repeat and decides anew.
        """
        if self._given_at is None:
            self._given_at = now
        elif now - self._given_at > REMIND_S and gait.state == "standing":
            self.execution.stop()
            if self.order is None:
                self.number = gait.order
            else:
                self._give(self.order, self._given)

    def _went_wrong(self, gait: GaitView) -> bool:
        if gait.state == "refused":
            self.fail("fallen", gait.reason or "the robot has fallen")
        elif gait.order == self.number and gait.refused:
            stopped = "emergency stop" in gait.refused
            self.fail("stopped" if stopped else "walker_refused", gait.refused)
        elif gait.order == self.number:
            if self._walk_id is None:
                self._walk_id = gait.walk_id
            elif gait.walk_id != self._walk_id:
                self.fail("taken_over", "another client commands the walker (cmd/walk)")
        return self.state == "failed"

    def _decide(self, now: float, gait: GaitView, tracker: PoseTracker, *, blocked: bool) -> None:
        goal, decider = self.goal, self.decider
        assert goal is not None
        assert decider is not None
        self._frames = None
        mean, cov = self.predicted(tracker)
        distance = self._pass_waypoints(goal, now, mean, cov)
        if goal.index >= len(goal.route):
            self._arrive(goal, now, gait, mean, distance)
            return
        if distance < goal.nearest - PROGRESS_M:
            goal.nearest, goal.nearest_at = distance, now
        elif now - goal.nearest_at > STUCK_S:
            self._give_up(goal, now)
            return
        choice = decider.decide(mean, cov, goal.waypoint, blocked=blocked)
        act, reason = self.acts[choice.index], choice.reason
        stands = [a for a in self.acts if a.kind == "stand"]
        to_look = distance <= REACHED  # there by the estimate, but not sure
        if to_look and stands:
            act, reason = stands[0], f"at the waypoint by the estimate, but not sure of it: look ({goal.looks + 1})"
            goal.looks += 1
            goal.recoveries["look"] += 1
            self._frames = tracker.frames
        self._note(goal, act, reason, choice, mean, cov)
        if act.kind == "stand":
            self._stand_until = now + (gait.ends_in or 0.0) + (LOOK_FOR_S if to_look else act.duration)
        else:
            self._give(_command(act), act)

    def _search(self, now: float, gait: GaitView, *, lost: bool) -> None:
        """Halt while the robot is lost, then look and turn in alternation, once around."""
        goal = self.goal
        assert goal is not None
        if not lost:
            self._searching = None
            goal.recoveries["relocalise"] += 1
            goal.nearest, goal.nearest_at = math.inf, now
        elif self._searching is None:
            self._searching = Searching(math.inf)
            goal.recoveries["stand_and_look"] += 1
            if gait.ends_in is not None or gait.state != "standing":
                self._give(WalkCommand(action="stop"), None)
        elif gait.state == "standing" and gait.ends_in is None:
            search = self._searching
            if math.isinf(search.until):
                search.until = now + LOOK_S
            elif now >= search.until and search.turns >= TURNS:
                self._searching = None
                self.halt("failed", "lost", f"the pose was not found again in {TURNS + 1} looks around")
            elif now >= search.until:
                search.until, search.turns = math.inf, search.turns + 1
                goal.recoveries["turn_and_look"] += 1
                turn = Act("look", "turn", Motion(turn=LOOK_TURN, heading=0.01), 4.0)
                self._give(_command(turn), turn)

    def predicted(self, tracker: PoseTracker) -> tuple[Array, Array]:
        """Return mean (4,) and covariance (4, 4) as they will be when the actions under way have ended."""
        rest = self.execution.rest()
        if not rest:
            return tracker.after(Motion())
        total = rest[0]
        for motion in rest[1:]:
            total = Motion(*(a + b for a, b in zip(vars(total).values(), vars(motion).values(), strict=True)))
        return tracker.after(total)

    def _pass_waypoints(self, goal: NavigationGoal, now: float, mean: Array, cov: Array) -> float:
        """Pass the waypoints that are reached; return the distance to the present one, m."""
        while True:
            gx, gy = goal.waypoint
            distance = math.hypot(gx - float(mean[0]), gy - float(mean[1]))
            if distance > REACHED or goal.index >= len(goal.route):
                return distance
            spread = math.sqrt(max(0.0, _largest(cov)))
            last = goal.index >= len(goal.route) - 1
            if last and distance + SURE * spread > ARRIVED_WITHIN and goal.looks < LOOKS:
                return distance
            goal.go_on(now)
            if goal.index >= len(goal.route):
                return distance

    def _arrive(self, goal: NavigationGoal, now: float, gait: GaitView, mean: Array, distance: float) -> None:
        """Turn to the wanted heading at the last waypoint, then end on both feet."""
        error = 0.0 if goal.yaw is None else float(wrap(goal.yaw - float(mean[2])))
        if abs(error) > ALIGNED:
            turn = Act("align", "turn", Motion(turn=error, heading=0.02 * abs(error)), 1.8 * max(1.0, abs(error) / 0.4))
            self._give(_command(turn), turn)
            return
        message = f"arrived, {distance:.2f} m beside the goal by the estimate"
        if gait.state == "standing" and gait.ends_in is None:
            self.state, self.error, self.message, self.ended = "succeeded", "", message, now
        else:
            self.halt("succeeded", "", message)

    def _give_up(self, goal: NavigationGoal, now: float) -> None:
        goal.missed.append(goal.index)
        goal.recoveries["give_up"] += 1
        if goal.index >= len(goal.route) - 1:
            self.halt("failed", "stuck", f"no progress towards the goal for {STUCK_S:g} s")
        else:
            goal.go_on(now)

    def _note(
        self, goal: NavigationGoal, act: Act, reason: str, choice: PolicyDecision, mean: Array, cov: Array
    ) -> None:
        """Keep a decision for the feedback."""
        gx, gy = goal.waypoint
        dx, dy = gx - float(mean[0]), gy - float(mean[1])
        values = {a.name: v for a, v in zip(self.acts, choice.values, strict=False) if math.isfinite(v)}
        self.decisions += 1
        self.decision = Decision(
            number=self.decisions, action=act.name, reason=reason, values=values, distance=math.hypot(dx, dy),
            bearing=float(wrap(math.atan2(dy, dx) - float(mean[2]))), entropy=max(float(entropy(cov)), -1e3),
        )  # fmt: skip

    def _give(self, order: WalkCommand, act: Act | None) -> None:
        self._given = act
        self.number += 1
        self.order = order
        self._walk_id = None
        self._given_at = None
        self._stand_until = -1.0


def _command(act: Act) -> WalkCommand:
    """Return the command of an action that moves."""
    m = act.motion
    if act.kind == "turn":
        return WalkCommand(action="turn", angle=m.turn if m.turn != 0.0 else None)
    return WalkCommand(action="walk", distance=m.forward, angle=m.turn if m.turn != 0.0 else None)


def _largest(cov: Array) -> float:
    """Return the largest variance of the position in any direction, m^2."""
    a, b, c = float(cov[0, 0]), float(cov[0, 1]), float(cov[1, 1])
    return 0.5 * (a + c) + math.hypot(0.5 * (a - c), b)
