"""Execution of goals, apart from the bus: chooses actions in time, orders them from the walker, recovers, ends goals.

An action is decided while the one before still runs, on the belief predicted to the landing of its last step, so that
the walker goes on without a halt. Where the walker does not publish the end of its action, the pilot waits for it.
"""

import math
from collections.abc import Callable

from surefoot.arrays import Array
from surefoot.schemas.cmd import WalkCommand
from surefoot.schemas.navigation import Decision, GoalState

from .arrival import arrival, reach, stalled, sure_of_place
from .belief.tracker import PoseTracker
from .docking import Docking
from .goals import Act, End, GaitView, NavigationGoal, Point
from .maps import Maps
from .near import Near
from .orders import Orders, command_of, turned
from .policy.decider import Decider
from .policy.settings import Conduct
from .rerouting import Rerouting
from .searching import Aside, Search, no_way


class Pilot:
    """Executor of one goal at a time, which chooses actions by a policy and orders them from the walker.

    Args:
        acts: the actions of the policy.
        commands: the pilot moves the tracker by the commands; else odometry moves it.
        conduct: times, tolerances and recoveries; None = the defaults.
        ways: obstacles; None = routes stay as they are.
        record: called once for every goal that ends, with its end.
        aside: finds a walk of a lost robot to where its candidate poses differ.
    """

    def __init__(
        self,
        acts: tuple[Act, ...],
        *,
        commands: bool,
        conduct: Conduct | None = None,
        ways: Maps | None = None,
        record: Callable[[NavigationGoal, End], None] = lambda _goal, _end: None,
        aside: Aside = no_way,
    ) -> None:
        self.acts, self.commands, self.conduct = acts, commands, conduct or Conduct()
        self.ways, self.record = ways, record
        self.orders = Orders(self.conduct.lag)
        self.state: GoalState = "idle"
        self.error, self.message = "", ""
        self.goal: NavigationGoal | None = None
        self.decider: Decider | None = None
        self.decision: Decision | None = None
        self.decisions = 0
        self.ended, self._now = 0.0, 0.0
        self._stand_until = -1.0
        self._frames: int | None = None
        """Number of camera frames so far when the present stand for one began; None = no such stand."""
        self._halting: End | None = None
        self._search = Search(self, self.conduct, aside)
        self._near = Near(acts, self.conduct, ways)
        self._rerouting = Rerouting(self.conduct, ways)
        self.docking = Docking(acts, self.move, self.conduct, ways)

    # -- goals -------------------------------------------------------------------------------------------------

    def begin(self, goal: NavigationGoal, decider: Decider) -> None:
        """Begin a goal; one under way ends as replaced, without a stop of the walk."""
        if self.goal is not None and self.under_way:
            self.record(self.goal, self._halting or ("cancelled", "replaced", f"replaced by the goal {goal.id!r}"))
        self.goal, self.decider = goal, decider
        decider.begin()
        goal.nearest_at, goal.least_at = max(goal.nearest_at, goal.began), max(goal.least_at, goal.began)
        self.state, self.error, self.message = "navigating", "", ""
        self.decision, self._halting = None, None
        goal.since = [0, 0]
        self._set_out()

    def _set_out(self) -> None:
        """Forget waits and searches, at the begin of a goal and after a pause."""
        self._rerouting.begin()
        self.docking.begin()
        self._search.begin()
        self._near.begin()

    @property
    def under_way(self) -> bool:
        """True if a goal has begun and not ended."""
        return self.state in ("navigating", "stopping")

    @property
    def end(self) -> End:
        """Outcome of the goal (state, error code, message): the one due once the robot stands, else the present."""
        return self._halting or (self.state, self.error, self.message)

    def resume(self, goal: NavigationGoal, decider: Decider, state: GoalState, end: End) -> None:
        """Continue a goal of an earlier pilot.

        Args:
            goal: goal with its progress.
            decider: chooses its actions.
            state: state of the goal then: under way, stopping or ended.
            end: its outcome, so far as known.
        """
        self.begin(goal, decider)
        if state == "stopping":
            self.halt(*end)  # again: that order may have been lost
        elif state == "navigating" and goal.paused_at is not None:
            self.stop()  # likewise
        elif state != "navigating":
            self._finish(end)

    def cancel(self) -> bool:
        """End the goal; return False when there is none under way."""
        if self.state != "navigating":
            return False
        self.halt("cancelled", "cancelled", "cancelled by request")
        return True

    def pause(self) -> bool:
        """Let the robot stand until `go_on`; return False where no goal is under way that is not paused."""
        if self.goal is None or self.state != "navigating" or self.goal.paused_at is not None:
            return False
        self.goal.paused_at = self._now
        self.stop()
        return True

    def go_on(self) -> bool:
        """Continue a paused goal; return False where there is none."""
        if self.goal is None or self.state != "navigating" or self.goal.paused_at is None:
            return False
        self.goal.unpause(self._now)
        self._set_out()
        return True

    def halt(self, state: GoalState, error: str, message: str) -> None:
        """Order a stop; the goal has the given end (state, error code, message) as soon as the robot stands."""
        self._halting = (state, error, message)
        self.state = "stopping"
        if self.goal is not None:
            self.goal.unpause(self._now)
        self._give(WalkCommand(action="stop"), None)

    def fail(self, error: str, message: str) -> None:
        """End the goal at once, with error code and message: no order would be obeyed, or another client commands."""
        self._finish(("failed", error, message))
        self.orders.given, self._halting, self._search.look = None, None, None

    def _finish(self, end: End) -> None:
        """End the goal now, and record its outcome."""
        self.state, self.error, self.message = end
        self.ended = self._now
        self.orders.execution.stop()
        if self.goal is not None:
            self.record(self.goal, end)

    # -- ticks -------------------------------------------------------------------------------------------------

    def follow(self, now: float, gait: GaitView, tracker: PoseTracker) -> None:
        """Record the orders that the walker has started, and predict the belief by them if odometry does not.

        Args:
            now: simulated time, s.
            gait: state of the walker.
            tracker: belief, moved in place.
        """
        self._now = now
        self.orders.take_up(now, gait)
        moved = self.orders.execution.advance(now)
        if self.commands:
            for motion in moved:
                tracker.move(motion)

    def tick(
        self, now: float, gait: GaitView, tracker: PoseTracker, *, blocked: bool, close: bool = False,
        lost: bool = False, suspected: bool = False,
    ) -> None:  # fmt: skip
        """Execute the goal for one tick: check its limits, search a lost pose, order the next action when it is due.

        Args:
            now: simulated time, s.
            gait: state of the walker.
            tracker: belief now.
            blocked: True = an obstacle is too near ahead to walk.
            close: a bumper is pressed, or something that the map lacks is too near: the robot steps back or stands.
            lost: the belief is wrong: the robot alternately stands for camera frames and turns, until it is right.
            suspected: it may be wrong: the robot stands and turns likewise, but not as often.
        """
        goal = self.goal
        self._near.sense(now, close=close)
        if goal is None or not self.under_way:
            return
        failure = self.orders.failure(gait)
        if failure is not None:
            self.fail(*failure)
            return
        if self.state == "navigating" and goal.timeout is not None and goal.active(now) > goal.timeout:
            self.halt("failed", "timeout", f"not arrived after {goal.timeout:g} s")
            return
        if gait.order != self.orders.number:
            self.orders.remind(now, gait)
            return  # an order is on its way
        if self.state == "stopping":
            if gait.state == "standing" and self._halting is not None:
                self._stand(goal, tracker)
            return
        if goal.paused_at is not None:
            return
        searching = self._search.tick(
            goal, now, gait, tracker.pose[:2], blocked=blocked, lost=lost, suspected=suspected
        )
        if searching or self.state != "navigating":
            self.docking.begin()
        elif goal.dock is not None and goal.dock.begun:
            end = self.docking.tick(goal, goal.dock, now, gait, tracker, blocked=blocked)
            if end is not None:
                self._finish(end)
        elif self._is_time(now, gait, tracker):
            self._decide(now, gait, tracker, blocked=blocked)

    def _is_time(self, now: float, gait: GaitView, tracker: PoseTracker) -> bool:
        """Return True if the next action is to be decided at the time `now`, s: before a landing, or after a look."""
        if gait.ends_in is not None:
            return gait.ends_in <= self.conduct.lead and self._stand_until <= now
        if self._frames is not None and gait.state != "standing":
            self._frames = tracker.frames  # only a frame of a standing robot is a look
        looked = self._frames is not None and tracker.frames > self._frames
        return gait.state == "standing" and (now >= self._stand_until or looked)

    def _decide(self, now: float, gait: GaitView, tracker: PoseTracker, *, blocked: bool) -> None:
        goal, decider = self.goal, self.decider
        assert goal is not None
        assert decider is not None
        self._frames = None
        mean, cov = self.predicted(tracker)
        distance = self._pass_waypoints(goal, now, mean, cov)
        if distance is None:
            return
        if goal.index >= len(goal.route):
            self._arrive(goal, now, gait, mean)
            return
        back, stand = self._near.choose(goal, now, mean)
        if back is not None:
            self.move(back)
        elif stand:
            self._stand_until = now + (gait.ends_in or 0.0) + self.conduct.look
        if back is not None or stand or not self._way_is_open(goal, now, gait, mean):
            return
        goal.since = [goal.since[0] + blocked, goal.since[1] + 1]
        still = goal.stalled(goal.left(float(mean[0]), float(mean[1])), now, self.conduct.progress)
        if distance < goal.nearest - self.conduct.progress:
            goal.nearest, goal.nearest_at, goal.since = distance, now, [0, 0]
        if max(still, now - goal.nearest_at) > self.conduct.stuck:
            self._give_up(goal, now)
            return
        decision = decider.decide(mean, cov, goal.waypoint, blocked=blocked)
        act, reason = next(act for act in self.acts if act.name == decision.action), decision.reason
        if distance <= self._reach(goal, cov):  # there by the estimate, but not sure
            act = self._look(goal, now, gait, tracker) or act
            reason = f"at the waypoint by the estimate, but not sure of it: look ({goal.looks})"
        elif act.kind == "stand":
            self._stand_until = now + (gait.ends_in or 0.0) + act.duration
        self.decisions += 1
        self.decision = decision.model_copy(update={"number": self.decisions, "action": act.name, "reason": reason})
        if act.kind != "stand":
            goal.backs = 0 if act.kind == "walk" else goal.backs
            self.move(act)

    def _look(self, goal: NavigationGoal, now: float, gait: GaitView, tracker: PoseTracker) -> Act | None:
        """Stand until a frame of the standing robot comes; return the stand, None = the model has no such action."""
        stands = [act for act in self.acts if act.kind == "stand"]
        goal.looks += 1
        goal.recoveries["look"] += 1
        self._frames = tracker.frames
        self._stand_until = now + (gait.ends_in or 0.0) + self.conduct.look
        return stands[0] if stands else None

    def _way_is_open(self, goal: NavigationGoal, now: float, gait: GaitView, mean: Array) -> bool:
        """Return True if the next action may be decided; else plan around an obstacle, or wait until it has gone.

        `now` in s; `mean`: believed x, y (m) in the map first, (n,).
        """
        return self._goes_on(goal, now, gait, self._rerouting.closed(goal, now, (float(mean[0]), float(mean[1]))))

    def _goes_on(self, goal: NavigationGoal, now: float, gait: GaitView, why: str) -> bool:
        """Return True if no reason `why` closes the way at `now`, s; else wait, or end a goal that waited too long."""
        if not why:
            return True
        if not self._rerouting.waits(goal, now):
            self.halt("failed", "blocked", f"something that the map does not know closes the way: {why}")
        self._stand_until = now + (gait.ends_in or 0.0) + self.conduct.look
        return False

    def replan(self, goal: NavigationGoal, now: float, here: Point) -> str:
        """Plan a goal's route anew from a place; return the reason why that is not possible, empty = done.

        `now`: simulated time, s; `here`: the place, x, y in m, frame map.
        """
        return self._rerouting.replan(goal, now, here)

    def predicted(self, tracker: PoseTracker) -> tuple[Array, Array]:
        """Return the belief predicted to the end of the actions under way, by their expected motion.

        Returns:
            Mean (4,): x, y (m), heading (rad), frame map, drift (rad per m walked); its covariance (4, 4).
        """
        return tracker.after(self.orders.execution.rest())

    def _reach(self, goal: NavigationGoal, cov: Array) -> float:
        """Return the distance of the estimate at which the present waypoint counts as reached, m.

        `cov` (n, n): of x, y (m) and heading (rad) first.
        """
        conduct = self.conduct
        return reach(goal, cov, conduct.sure) if goal.at_last else conduct.waypoint_tolerance

    def _pass_waypoints(self, goal: NavigationGoal, now: float, mean: Array, cov: Array) -> float | None:
        """Pass the waypoints that are reached; return the distance to the present one, m, None = a turn is ordered.

        `mean` (n,), `cov` (n, n): of x, y (m) and heading (rad) in the map first.
        """
        while True:
            gx, gy = goal.waypoint
            distance = math.hypot(gx - float(mean[0]), gy - float(mean[1]))
            if distance > self._reach(goal, cov) or goal.index >= len(goal.route):
                return distance
            if not goal.at_last:
                if self._align(goal, mean):
                    return None
                goal.pass_on(now, float(mean[2]))
            elif goal.looks < self.conduct.looks and not sure_of_place(goal, mean, cov, self.conduct.sure):
                return distance
            else:
                goal.index += 1
                return distance

    def _align(self, goal: NavigationGoal, mean: Array) -> bool:
        """Order a turn to the heading that is wanted at the present waypoint; return False if none is needed.

        `mean`: believed x, y (m), heading (rad) in the map first, (n,).
        """
        error = goal.off_heading(float(mean[2]))
        turns = abs(error) > 0.5 * goal.yaw_tolerance and goal.turns < self.conduct.aligning_turns
        if turns:
            goal.turns += 1
            self.move(turned(self.acts, "align", error))
        return turns

    def _arrive(self, goal: NavigationGoal, now: float, gait: GaitView, mean: Array) -> None:
        """Turn to the wanted heading at the last waypoint and end the goal, standing, or begin its next round.

        `now` in s; `mean`: believed x, y (m), heading (rad) in the map first, (n,).
        """
        if goal.final:
            if not self._align(goal, mean):
                self.halt("succeeded", "", "")  # as far as is known before the robot stands
        elif not goal.reached:
            self.halt("failed", "stuck", f"no place was reached in round {goal.loop}")
        else:
            self._goes_on(goal, now, gait, self._rerouting.next_round(goal, now, (float(mean[0]), float(mean[1]))))

    def _stand(self, goal: NavigationGoal, tracker: PoseTracker) -> None:
        """End the goal of a standing robot, or continue it for another camera frame if its arrival is not certain."""
        assert self._halting is not None
        end = self._halting
        if end[0] == "succeeded" and goal.dock is not None:
            goal.dock.begun, self.state, self._halting = True, "navigating", None
            return
        if end[0] == "succeeded":
            end = arrival(goal, tracker.mean, tracker.cov, self.conduct.sure)
            if end[1] == "arrived_unsure" and goal.looks < self.conduct.looks:
                self.state, self._halting = "navigating", None
                goal.index, goal.looks = len(goal.route) - 1, goal.looks + 1
                return
        self._finish(end)

    def _give_up(self, goal: NavigationGoal, now: float) -> None:
        goal.recoveries["give_up"] += 1
        if goal.place >= len(goal.places) - 1 and (goal.final or not goal.reached):
            goal.miss()
            self.halt(*stalled(goal, self.conduct.stuck))
        else:
            goal.give_up(now)
        goal.since = [0, 0]

    def stop(self) -> None:
        """Order the walker to stop; the goal stays under way."""
        self._give(WalkCommand(action="stop"), None)

    def move(self, act: Act) -> None:
        """Order an action that moves the robot."""
        self._give(command_of(act), act)

    def _give(self, order: WalkCommand, act: Act | None) -> None:
        self.orders.give(order, act)
        self._stand_until = -1.0
