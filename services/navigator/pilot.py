"""Execution of goals, apart from the bus: chooses actions in time, orders them from the walker, recovers, ends goals.

An action is decided while the one before still runs, on the belief predicted to the landing of its last step, so that
the walker goes on without a halt. Where the walker does not publish the end of its action, the pilot waits for it.
"""

import math
from collections.abc import Callable
from dataclasses import replace

from surefoot.arrays import Array
from surefoot.errors import Refusal
from surefoot.schemas.cmd import WalkCommand
from surefoot.schemas.navigation import Decision, GoalState

from .arrival import arrival, reach, sure_of_place
from .belief.tracker import Motion, PoseTracker
from .belief.ukf import wrap
from .goals import Act, End, GaitView, NavigationGoal, Point
from .maps import Maps
from .near import Near
from .orders import Orders, command_of, straight
from .policy.decider import Decider
from .policy.settings import Conduct
from .searching import Aside, Search, no_way

BLOCKED_SHARE = 0.25
"""Share of the decisions without progress at which a near echo forbade walking, from which on a stuck goal ends as
blocked."""


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
        self._since = [0, 0]
        """Number of decisions without progress: those that a near echo restricted to turns, and all."""
        self._waiting: float | None = None
        """Simulated time of the last decision at which no path led around an obstacle, s; None = the path is open."""

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
        self._since, self._waiting = [0, 0], None
        self._search.begin()
        self._near.begin()

    @property
    def under_way(self) -> bool:
        """True if a goal has begun and not ended."""
        return self.state in ("navigating", "stopping")

    @property
    def end(self) -> End:
        """Outcome of the goal (state, error code, message): the one due once the robot stands, else the present one."""
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
        elif state != "navigating":
            self._finish(end)

    def cancel(self) -> bool:
        """End the goal; return False when there is none under way."""
        if self.state != "navigating":
            return False
        self.halt("cancelled", "cancelled", "cancelled by request")
        return True

    def halt(self, state: GoalState, error: str, message: str) -> None:
        """Order a stop; the goal has the given end (state, error code, message) as soon as the robot stands."""
        self._halting = (state, error, message)
        self.state = "stopping"
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
        if self.state == "navigating" and goal.timeout is not None and now - goal.began > goal.timeout:
            self.halt("failed", "timeout", f"not arrived after {goal.timeout:g} s")
            return
        if gait.order != self.orders.number:
            self.orders.remind(now, gait)
            return  # an order is on its way
        if self.state == "stopping":
            if gait.state == "standing" and self._halting is not None:
                self._stand(goal, tracker)
            return
        searching = self._search.tick(
            goal, now, gait, tracker.pose[:2], blocked=blocked, lost=lost, suspected=suspected
        )
        if not searching and self.state == "navigating" and self._is_time(now, gait, tracker):
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
        if goal.index >= len(goal.route):
            self._arrive(goal, mean)
            return
        back, stand = self._near.choose(goal, now, mean)
        if back is not None:
            self._give(command_of(back), back)
        elif stand:
            self._stand_until = now + (gait.ends_in or 0.0) + self.conduct.look
        if back is not None or stand or not self._way_is_open(goal, now, gait, mean):
            return
        self._since = [self._since[0] + blocked, self._since[1] + 1]
        still = goal.stalled(goal.left(float(mean[0]), float(mean[1])), now, self.conduct.progress)
        if distance < goal.nearest - self.conduct.progress:
            goal.nearest, goal.nearest_at, self._since = distance, now, [0, 0]
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
            self._give(command_of(act), act)

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
        here = (float(mean[0]), float(mean[1]))
        if self.ways is None or self.ways.free(here, goal.route[goal.index :]):
            self._waiting = None
            return True
        why = f"planned around obstacles {goal.recoveries['replan']} times"
        if goal.recoveries["replan"] < self.conduct.replans:
            why = self.replan(goal, now, here)
            if not why:
                goal.recoveries["replan"] += 1
                self._waiting = None
                return True
        if self._waiting is None:
            self._waiting = now
            goal.recoveries["wait"] += 1
        goal.waited += now - self._waiting
        self._waiting = now
        if goal.waited > self.conduct.wait:
            self.halt("failed", "blocked", f"something that the map does not know closes the way: {why}")
        self._stand_until = now + (gait.ends_in or 0.0) + self.conduct.look
        return False

    def replan(self, goal: NavigationGoal, now: float, here: Point) -> str:
        """Plan the remaining route of a goal from a place; return the reason why that is not possible, empty = done.

        Args:
            goal: its waypoints are replaced.
            now: simulated time, s.
            here: x, y in m, frame map.
        """
        if self.ways is None:
            return ""
        why = ""
        for bold in (False, True)[: 1 + goal.bold]:
            try:
                goal.lead(self.ways.follow(here, goal.places[goal.place :], bold=bold), now)
                goal.dared |= bold
                return ""
            except Refusal as refusal:
                why = why or refusal.message
        return why

    def predicted(self, tracker: PoseTracker) -> tuple[Array, Array]:
        """Return the belief predicted to the end of the actions under way, by their expected motion.

        Returns:
            Mean (4,): x, y (m), heading (rad), frame map, drift (rad per m walked); its covariance (4, 4).
        """
        total = Motion()
        for motion in self.orders.execution.rest():
            total = Motion(*(a + b for a, b in zip(vars(total).values(), vars(motion).values(), strict=True)))
        return tracker.after(total)

    def _reach(self, goal: NavigationGoal, cov: Array) -> float:
        """Return the distance of the estimate at which the present waypoint counts as reached, m.

        `cov` (n, n): of x, y (m) and heading (rad) first.
        """
        conduct = self.conduct
        return reach(goal, cov, conduct.sure) if goal.at_last else conduct.waypoint_tolerance

    def _pass_waypoints(self, goal: NavigationGoal, now: float, mean: Array, cov: Array) -> float:
        """Pass the waypoints that are reached; return the distance to the present one, m.

        `mean` (n,), `cov` (n, n): of x, y (m) and heading (rad) in the map first.
        """
        while True:
            gx, gy = goal.waypoint
            distance = math.hypot(gx - float(mean[0]), gy - float(mean[1]))
            if distance > self._reach(goal, cov) or goal.index >= len(goal.route):
                return distance
            if not goal.at_last:
                goal.go_on(now)
            elif goal.looks < self.conduct.looks and not sure_of_place(goal, mean, cov, self.conduct.sure):
                return distance
            else:
                goal.index += 1
                return distance

    def _arrive(self, goal: NavigationGoal, mean: Array) -> None:
        """Turn to the wanted heading at the last waypoint, then end the goal, standing on all feet.

        `mean`: believed x, y (m), heading (rad) in the map first, (n,).
        """
        error = 0.0 if goal.yaw is None else float(wrap(goal.yaw - float(mean[2])))
        if abs(error) > 0.5 * goal.yaw_tolerance and goal.turns < self.conduct.aligning_turns:
            goal.turns += 1
            self.turn("align", error)
        else:
            self.halt("succeeded", "", "")  # as far as is known before the robot stands

    def _stand(self, goal: NavigationGoal, tracker: PoseTracker) -> None:
        """End the goal of a standing robot, or continue it for another camera frame if its arrival is not certain."""
        assert self._halting is not None
        end, sure = self._halting, self.conduct.sure
        if end[0] == "succeeded":
            end = arrival(goal, tracker.mean, tracker.cov, sure)
            if end[1] == "arrived_unsure" and goal.looks < self.conduct.looks:
                self.state, self._halting = "navigating", None
                goal.index, goal.looks = len(goal.route) - 1, goal.looks + 1
                return
        self._finish(end)

    def _give_up(self, goal: NavigationGoal, now: float) -> None:
        goal.recoveries["give_up"] += 1
        blocked, decisions = self._since
        if goal.place >= len(goal.places) - 1:
            goal.missed.append(goal.place)
            text, routes = f"no progress towards the goal for {self.conduct.stuck:g} s", goal.recoveries["replan"]
            close = blocked >= BLOCKED_SHARE * decisions
            if close:
                text += f", with an obstacle close ahead in {blocked} of {decisions} decisions"
            elif routes:
                text += f", on {routes} routes around what the map does not know"
            self.halt("failed", "blocked" if close or routes else "stuck", text)
        else:
            goal.give_up(now)
        self._since = [0, 0]

    def stop(self) -> None:
        """Order the walker to stop; the goal stays under way."""
        self._give(WalkCommand(action="stop"), None)

    def advance(self, name: str) -> float:
        """Order the action that walks ahead with the least turn; return its length, m. `name`: for its record."""
        act = straight(self.acts)
        self._give(command_of(act), replace(act, name=name))
        return act.motion.forward

    def turn(self, name: str, angle: float) -> None:
        """Order a turn on the spot by an angle, rad, left positive; noise and time are those of the model's turns.

        Args:
            name: name of the action.
            angle: angle of the turn, rad, left positive.
        """
        one = next(act for act in self.acts if act.kind == "turn")
        times = abs(angle / one.motion.turn)
        motion = replace(one.motion.part(times), turn=angle)
        turn = Act(name, "turn", motion, one.duration * max(1.0, times))
        self._give(command_of(turn), turn)

    def _give(self, order: WalkCommand, act: Act | None) -> None:
        self.orders.give(order, act)
        self._stand_until = -1.0
