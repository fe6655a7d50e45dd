"""Timing of the commands of a scenario, tick by tick, from observations. Pure: nothing is sent here.

The supervisor takes part in lockstep: while it works on tick t no service is further than t + ``WINDOW_TICKS``. An
order for the tick after that reaches every service in time, and the run is the same each time. The supervisor checks
the scenario only at the ticks that it reports.
"""

import math
from dataclasses import dataclass, replace
from typing import Any

from surefoot.lockstep.leader import REPORT_TICKS, WINDOW_TICKS
from surefoot.schemas.base import Request
from surefoot.schemas.cmd import WalkCommand
from surefoot.schemas.sim import PauseRequest
from surefoot.schemas.topics import SIM_PAUSE, STABILITY_CALIBRATE, TICK_S, Query

from .scenario import COMMANDS, GOALS, WALKING, Scenario, Step

LEAD_TICKS = WINDOW_TICKS + 1
"""Least number of control ticks between sending an order and the tick in which it takes effect."""
HORIZON_TICKS = LEAD_TICKS + REPORT_TICKS - 1
"""Number of control ticks ahead up to which due orders are sent now: at the next check it might be too late."""
TRIES = 6
"""Number of attempts to send an order that comes too late or reaches no service, each with twice the lead time."""
RESTING = ("standing", "refused")
"""States of the walker in which a walking command has ended: done (`standing`) or given up (`refused`)."""


@dataclass(frozen=True)
class TimedOrder:
    """Command of a scenario that is to be sent now.

    Attributes:
        text: description for notes and problems.
        query: query to which the request belongs; None for `kill`.
        request: the command with its tick.
        kill: name of the service that is to be ended at once.
        walking: True if the end of its walk is the moment `walk_done`.
        goal: True if the end of its goal is the moment `goal_done`.
        tries: number of times that the order has come too late.
    """

    text: str
    query: Query[Any, Any] | None = None
    request: Request | None = None
    kill: str = ""
    walking: bool = False
    goal: bool = False
    tries: int = 0


@dataclass
class WalkUnderWay:
    """Walk command under way: first tick, `walk_id`, remaining m or rad, and True once the walker has reported it."""

    command: WalkCommand
    from_tick: int
    id: int
    remaining: float | None = None
    seen: bool = False


class Director:
    """Progress of one scenario: which steps are due, and the replies to those that were sent."""

    def __init__(self, scenario: Scenario) -> None:
        self.scenario = scenario
        self.problems: list[str] = []
        self.notes: list[str] = []
        self.ended = False
        self._timed = [step for step in scenario.steps if step.at_tick is not None]
        self._waiting = [step for step in scenario.steps if step.at_tick is None]
        self._ready_at: int | None = None
        self._walk: WalkUnderWay | None = None
        self._walk_ended_at: int | None = None
        self._busy_until = 0
        self._resend = False
        self._late: list[tuple[int, TimedOrder]] = []
        """Orders to send again, each with the first control tick at which to send it."""
        self._goal = ""
        """Id of the navigator's goal under way; empty = none."""
        self._goal_ended_at: int | None = None

    def on_tick(
        self, tick: int, gait: Any | None, *, fallen: bool = False, feedback: Any | None = None
    ) -> list[TimedOrder]:
        """Return the orders to send now; called at least every ``REPORT_TICKS``.

        Args:
            tick: number of the control tick.
            gait: GaitState of this tick, None when the walker is absent.
            fallen: True if the robot has fallen, by the simulator's ground truth.
            feedback: the latest NavigationFeedback, None when there is none.
        """
        orders = self._again(tick)
        if self.ended:
            return orders
        if fallen and "no_fall" in self.scenario.limits:
            return [self._end(tick, "the robot has fallen")]
        self._note_moments(tick, gait)
        self._note_goal(tick, feedback)
        if self._resend and gait is not None and gait.state == "standing":
            orders.append(self._walk_again(tick))
        due = [step for step in self._timed if (step.at_tick or 0) <= tick + (HORIZON_TICKS if step.request else 0)]
        for step in due:
            self._timed.remove(step)
            orders.append(self._order(step, max(step.at_tick or 0, tick + LEAD_TICKS)))
        while self._waiting and not any(order.walking or order.goal for order in orders):
            at = self._time_of(self._waiting[0])
            if at is None or at > tick + HORIZON_TICKS:
                break
            orders.append(self._order(self._waiting.pop(0), max(at, tick + LEAD_TICKS)))
        if not orders and self._nothing_left(tick):
            orders.append(self._end(tick, "all steps are done"))
        return orders

    def answered(self, order: TimedOrder, reply: Any) -> None:
        """Record the reply of a service to an order of the scenario that was sent to it."""
        if not reply.accepted:
            self.problems.append(f"{order.text} was refused: {reply.reason}")
            self._waiting.clear()
        elif order.query is STABILITY_CALIBRATE and reply.reason:
            self.notes.append(f"calibration: {reply.reason}")
        elif order.walking and isinstance(order.request, WalkCommand):
            self._walk = WalkUnderWay(order.request, order.request.at_tick or 0, reply.id)
            self._walk_ended_at = None
        elif order.goal:
            self._goal, self._goal_ended_at = reply.goal_id, None

    def failed(self, order: TimedOrder, code: str, message: str) -> None:
        """Record that an order failed, or prepare to send it again.

        In paced time a service that was away for a moment receives an order only after its tick, and one that is
        started again receives none. An order refused as ``late``, or that reached no service (``absent``), is therefore
        sent again for a later tick, ``TRIES`` times; everything else is a problem of the run.
        """
        if code in ("late", "absent") and order.tries + 1 < TRIES:
            why = "came too late" if code == "late" else "reached no service"
            self.notes.append(f"{order.text} {why} and is sent again: {message}")
            at_tick = getattr(order.request, "at_tick", None) or 0
            self._late.append((0 if code == "late" else at_tick, replace(order, tries=order.tries + 1)))
            return
        self.problems.append(f"{order.text} failed: {message}")
        self._waiting.clear()

    def unfinished(self) -> tuple[str, ...]:
        """Return the parts of the scenario that a run has not finished within its time limit, in words."""
        left: list[str] = []
        if self._walk is not None:
            left.append(f"the {self._walk.command.action} was not finished in time")
        if self._goal:
            left.append(f"the goal {self._goal!r} was not reached in time")
        left += [f"{order.text} came too late" for _, order in self._late]
        steps = [*self._timed, *self._waiting]
        if steps:
            left.append(f"{len(steps)} steps were not reached, the first is {steps[0].do!r}")
        return tuple(left)

    def _note_moments(self, tick: int, gait: Any | None) -> None:
        if gait is None:
            return
        if self._ready_at is None and gait.state == "standing":
            self._ready_at = tick
        walk = self._walk
        if walk is None or tick < walk.from_tick:
            return
        if gait.walk_id == walk.id:
            walk.seen, self._resend = True, False  # it was only late
            if gait.state in RESTING:
                if gait.state == "refused":
                    self.problems.append(f"the walker gave up: {gait.reason or 'no reason given'}")
                self._walk, self._walk_ended_at = None, tick
            elif gait.state in ("walking", "turning"):
                walk.remaining = gait.remaining
        elif gait.walk_id < walk.id and (walk.seen or tick > walk.from_tick + LEAD_TICKS):
            self._resend = True  # it was started anew, and lost the command in its walk or before that began

    def _note_goal(self, tick: int, feedback: Any | None) -> None:
        if not self._goal or feedback is None or feedback.goal_id != self._goal:
            return
        if feedback.state in ("succeeded", "failed", "cancelled"):
            if feedback.state == "failed":
                self.problems.append(f"the goal {self._goal!r} failed: {feedback.error_code}: {feedback.error_msg}")
            self._goal, self._goal_ended_at = "", tick

    def _walk_again(self, tick: int) -> TimedOrder:
        """Return the order for the remaining distance or angle of a walk whose command a restarted walker has lost."""
        assert self._walk is not None
        command, left = self._walk.command, self._walk.remaining
        self._resend = False
        update: dict[str, Any] = {"at_tick": tick + LEAD_TICKS}
        if left is not None and command.distance is not None:
            update["distance"] = math.copysign(left, command.distance)
        if left is not None and command.angle is not None:
            update["angle"] = math.copysign(left, command.angle)
        self.notes.append(f"the walker was restarted; it got the rest of its way at tick {tick}")
        query, _ = COMMANDS[command.action]
        return TimedOrder(f"{command.action} (again)", query, command.model_copy(update=update), walking=True)

    def _again(self, tick: int) -> list[TimedOrder]:
        """Return the orders that came too late or reached no service and are due again, each for a later tick."""
        due = [order for from_tick, order in self._late if from_tick <= tick]
        self._late = [item for item in self._late if item[0] > tick]
        orders: list[TimedOrder] = []
        for order in due:
            assert order.request is not None
            at_tick = tick + LEAD_TICKS * 2**order.tries
            self._busy_until = max(self._busy_until, at_tick + _ticks_of(order.request))
            orders.append(replace(order, request=order.request.model_copy(update={"at_tick": at_tick})))
        return orders

    def _time_of(self, step: Step) -> int | None:
        """Return the control tick at which a waiting step is due, None before its moment."""
        moments = {"ready": self._ready_at, "walk_done": self._walk_ended_at, "goal_done": self._goal_ended_at}
        moment = moments.get(step.when or "")
        return None if moment is None else moment + round(step.after_s / TICK_S)

    def _order(self, step: Step, at_tick: int) -> TimedOrder:
        text = f"{step.do} at tick {at_tick}"
        if step.request is None:
            return TimedOrder(f"kill of {step.service}", kill=step.service)
        query, _ = COMMANDS[step.do]
        self._busy_until = max(self._busy_until, at_tick + _ticks_of(step.request))
        request = step.request.model_copy(update={"at_tick": at_tick})
        return TimedOrder(text, query, request, walking=step.do in WALKING, goal=step.do in GOALS)

    def _nothing_left(self, tick: int) -> bool:
        if self._late or self._timed or self._waiting or self._walk is not None or self._goal:
            return bool(self.problems) and self._walk is None and not self._goal
        last = max(self._busy_until, self._walk_ended_at or 0, self._goal_ended_at or 0)
        return tick + LEAD_TICKS >= last + round(self.scenario.settle_s / TICK_S)

    def _end(self, tick: int, reason: str) -> TimedOrder:
        self.ended = True
        return TimedOrder(reason, SIM_PAUSE, PauseRequest(at_tick=tick + LEAD_TICKS, end=True))


def _ticks_of(request: Request) -> int:
    """Return the number of control ticks that a request takes by its field `duration`; 0 without one."""
    return round((getattr(request, "duration", None) or 0.0) / TICK_S)
