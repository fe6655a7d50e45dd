"""Takes goals to their end: decides at the right moment, gives orders to the walker, recovers, reports. No bus.

An action is decided while the one before still runs, `LEAD_S` before its last step lands, on the belief predicted to
that moment, so that the walker goes on without a halt. A walker that cannot say when it ends is waited for.
"""

import math

from .belief.tracker import Motion, PoseTracker
from .belief.ukf import entropy, wrap
from .execution import Execution
from .goals import (
    Act,
    Array,
    Choice,
    Decided,
    End,
    GaitView,
    Goal,
    Order,
    Policy,
    Searching,
    State,
)

LEAD_S = 0.30
"""Before the last step of an action lands; the walker asks for 0.25 s and an order takes 0.02 s."""
SURE = 2.0
"""Standard deviations that must fit between the estimate and the edge of what counts as arrived."""
REACHED = 0.15
"""m, a waypoint is reached when the estimate is so near,"""
ARRIVED_WITHIN = 0.20
"""m, and the last one when the true distance is surely less than this."""
LOOKS, LOOK_FOR_S = 3, 2.0
"""Stands in a row to become sure of having arrived, then the estimate decides; each lasts until a frame has come, or so
long, s."""
STUCK_S, PROGRESS_M = 120.0, 0.10
"""A waypoint that has not become nearer by so much in so long is given up."""
ALIGNED = math.radians(8.0)
"""Error of the last heading that is good enough."""
REMIND_S = 1.0
"""An order that a standing walker has not taken up for so long is given again."""
LOOK_S = 3.0
"""How long a lost robot looks in one direction."""
LOOK_TURN, TURNS = math.radians(46.0), 7
"""Then it turns by this, so many times."""


class Pilot:
    """Conducts one goal at a time.

    Args:
        acts: the actions, in the order of the policy's values.
        commands: the tracker follows the commands; else somebody else moves it.
    """

    def __init__(self, acts: tuple[Act, ...], *, commands: bool) -> None:
        self.acts, self.commands = acts, commands
        self.execution = Execution()
        self.state: State = "idle"
        self.error, self.message = "", ""
        self.goal: Goal | None = None
        self.policy: Policy | None = None
        self.number = 0
        self.order: Order | None = None
        self.decision: Decided | None = None
        self.decisions = 0
        self.ended = 0.0
        self._given: Act | None = None
        """The act of the last order, until the walker has taken it up."""
        self._walk_id: int | None = None
        self._given_at: float | None = None
        """s, when an order was first missed in what the walker says."""
        self._stand_until = -1.0
        self._frames: int | None = None
        """Frames that had been taken when a look at the goal began."""
        self._halting: End | None = None
        self._searching: Searching | None = None

    # -- goals -------------------------------------------------------------------------------------------------

    def begin(self, goal: Goal, policy: Policy) -> None:
        """Take up a goal; one under way ends as replaced, and the walk goes on."""
        self.goal, self.policy = goal, policy
        policy.begin()
        goal.nearest_at = max(goal.nearest_at, goal.began)
        self.state, self.error, self.message = "navigating", "", ""
        self.decision, self._halting, self._searching = None, None, None

    @property
    def end(self) -> End:
        """How the goal ends or has ended; of one under way, its present state."""
        return self._halting or (self.state, self.error, self.message)

    def resume(self, goal: Goal, policy: Policy, state: State, end: End) -> None:
        """Take up a goal as a pilot before left it, in `state` and with its `end`: under way, halting or ended."""
        self.begin(goal, policy)
        if state == "stopping":
            self.halt(*end)  # again: that order may have been lost
        elif state != "navigating":
            self.state, self.error, self.message = end

    def cancel(self) -> bool:
        """End the goal; returns False when there is none under way."""
        if self.state != "navigating":
            return False
        self.halt("cancelled", "cancelled", "cancelled by request")
        return True

    def halt(self, state: State, error: str, message: str) -> None:
        """Order a stop; the goal has the given end as soon as the robot stands."""
        self._halting = (state, error, message)
        self.state = "stopping"
        self._give(Order("stop"), None)

    def fail(self, error: str, message: str) -> None:
        """End the goal at once: no order would be obeyed, or somebody else commands the robot."""
        self.state, self.error, self.message = "failed", error, message
        self.execution.stop()
        self._given, self._halting, self._searching = None, None, None

    # -- ticks -------------------------------------------------------------------------------------------------

    def follow(self, now: float, gait: GaitView, tracker: PoseTracker) -> None:
        """Notice what the walker took up, and carry the belief along where commands are the control."""
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
        """Decide, if it is time to.

        Args:
            now: simulated time, s.
            gait: of this tick.
            tracker: belief now.
            blocked: something is too near ahead to walk.
            lost: the belief is not to be trusted: stand and look, then turn and look, until it is, or give up.
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
        if gait.ends_in is None:
            if self._frames is not None and gait.state != "standing":
                self._frames = tracker.frames  # only what it sees standing is a look
            looked = self._frames is not None and tracker.frames > self._frames
            if gait.state != "standing" or (now < self._stand_until and not looked):
                return
        elif gait.ends_in > LEAD_S or self._stand_until > now:
            return
        self._decide(now, gait, tracker, blocked=blocked)

    def _remind(self, now: float, gait: GaitView) -> None:
        """Give an order again that a standing walker has not taken up, for one of the two was started again.

        Where the pilot is the one, it has no order to repeat and decides anew.
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
        goal, policy = self.goal, self.policy
        assert goal is not None
        assert policy is not None
        self._frames = None
        mean, cov = self.predicted(tracker)
        distance = self._pass_waypoints(now, mean, cov)
        if goal.index >= len(goal.route):
            self._arrive(now, gait, mean, distance)
            return
        if distance < goal.nearest - PROGRESS_M:
            goal.nearest, goal.nearest_at = distance, now
        elif now - goal.nearest_at > STUCK_S:
            self._give_up(now)
            return
        to_look = distance <= REACHED  # there by the estimate, but not sure
        choice = policy.decide(mean, cov, goal.waypoint, blocked=blocked)
        act = self.acts[choice.index]
        reason = choice.reason
        if to_look:
            stand = [a for a in self.acts if a.kind == "stand"]
            if stand:
                act, reason = stand[0], f"at the waypoint by the estimate, but not sure of it: look ({goal.looks + 1})"
                goal.looks += 1
                goal.recoveries["look"] += 1
                self._frames = tracker.frames
        self._note(act, reason, choice, mean, cov)
        if act.kind == "stand":
            self._stand_until = now + (gait.ends_in or 0.0) + (LOOK_FOR_S if to_look else act.duration)
            return
        self._given = act
        m = act.motion
        turn = m.turn if m.turn != 0.0 else None
        self._give(Order("turn", None, turn) if act.kind == "turn" else Order("walk", m.forward, turn), act)

    def _search(self, now: float, gait: GaitView, *, lost: bool) -> None:
        """While the robot is lost: halt, look, turn, look; `LOOK_S` each, once around."""
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
                self._give(Order("stop"), None)
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
                self._give(Order("turn", None, LOOK_TURN), turn)

    def predicted(self, tracker: PoseTracker) -> tuple[Array, Array]:
        """Return mean (4,) and covariance (4, 4) as they will be when the actions under way have ended."""
        rest = self.execution.rest()
        if not rest:
            return tracker.after(Motion())
        total = rest[0]
        for motion in rest[1:]:
            total = Motion(*(a + b for a, b in zip(vars(total).values(), vars(motion).values(), strict=True)))
        return tracker.after(total)

    def _pass_waypoints(self, now: float, mean: Array, cov: Array) -> float:
        """Go on to the next waypoint as long as one is reached; returns the distance to the present one, m."""
        goal = self.goal
        assert goal is not None
        while True:
            gx, gy = goal.waypoint
            distance = math.hypot(gx - float(mean[0]), gy - float(mean[1]))
            last = goal.index >= len(goal.route) - 1
            if distance > REACHED or goal.index >= len(goal.route):
                return distance
            spread = math.sqrt(max(0.0, _largest(cov)))
            if last and distance + SURE * spread > ARRIVED_WITHIN and goal.looks < LOOKS:
                return distance
            goal.index += 1
            goal.nearest, goal.nearest_at, goal.looks = math.inf, now, 0
            if goal.index >= len(goal.route):
                return distance

    def _arrive(self, now: float, gait: GaitView, mean: Array, distance: float) -> None:
        """At the last waypoint: turn to the wanted heading, then end on both feet."""
        goal = self.goal
        assert goal is not None
        error = 0.0 if goal.yaw is None else float(wrap(goal.yaw - float(mean[2])))
        if abs(error) > ALIGNED:
            turn = Act("align", "turn", Motion(turn=error, heading=0.02 * abs(error)), 1.8 * max(1.0, abs(error) / 0.4))
            self._given = turn
            self._give(Order("turn", None, error), turn)
            return
        message = f"arrived, {distance:.2f} m beside the goal by the estimate"
        if gait.state == "standing" and gait.ends_in is None:
            self.state, self.error, self.message, self.ended = "succeeded", "", message, now
        else:
            self.halt("succeeded", "", message)

    def _give_up(self, now: float) -> None:
        goal = self.goal
        assert goal is not None
        goal.missed.append(goal.index)
        goal.recoveries["give_up"] += 1
        if goal.index >= len(goal.route) - 1:
            self.halt("failed", "stuck", f"no progress towards the goal for {STUCK_S:g} s")
            return
        goal.index += 1
        goal.nearest, goal.nearest_at, goal.looks = math.inf, now, 0

    def _note(self, act: Act, reason: str, choice: Choice, mean: Array, cov: Array) -> None:
        goal = self.goal
        assert goal is not None
        gx, gy = goal.waypoint
        dx, dy = gx - float(mean[0]), gy - float(mean[1])
        values = {a.name: v for a, v in zip(self.acts, choice.values, strict=False) if math.isfinite(v)}
        self.decisions += 1
        self.decision = Decided(
            self.decisions, act.name, reason, values, math.hypot(dx, dy),
            float(wrap(math.atan2(dy, dx) - float(mean[2]))), float(entropy(cov)),
        )  # fmt: skip

    def _give(self, order: Order, act: Act | None) -> None:
        self._given = act
        self.number += 1
        self.order = order
        self._walk_id = None
        self._given_at = None
        self._stand_until = -1.0


def _largest(cov: Array) -> float:
    """Return the largest variance of the position in any direction, m^2."""
    a, b, c = float(cov[0, 0]), float(cov[0, 1]), float(cov[1, 1])
    return 0.5 * (a + c) + math.hypot(0.5 * (a - c), b)
