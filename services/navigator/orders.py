"""Orders of the navigator to the walker: numbered, recorded once the walker starts them, repeated if it does not."""

from dataclasses import replace

from surefoot.schemas.cmd import WalkCommand

from .execution import Execution
from .goals import Act, GaitView
from .planning.zones import FREELY, SpeedLimit

REMIND_S = 1.0
"""Time after which an order that a standing walker has not started is repeated, s."""


class Orders:
    """Sender of numbered orders to the walker, which records the actions that the walker has started.

    Args:
        lag: delay between a foot's landing and the trunk reaching its place, s.
    """

    def __init__(self, lag: float) -> None:
        self.execution = Execution(lag)
        self.number = 0
        """Number of the last order to the walker; it rises by 1 with each order."""
        self.order: WalkCommand | None = None
        self.given: Act | None = None
        """Action of the last order until the walker starts it; None = started, or the order begins no action."""
        self.doing: Act | None = None
        """Action that the walker started last; None = none."""
        self.pace: SpeedLimit = FREELY
        """Limit of the speed of the walks that are ordered."""
        self._stops = False
        """True while the last order is a stop that the walker has not started, else False."""
        self._walk_id: int | None = None
        self._given_at: float | None = None
        """Simulated time since which the walker has not started the last order, s; None = started."""

    @property
    def match(self) -> float | None:
        """Share of the landmarks in view that a camera frame recognises in the present action; None = unknown."""
        return None if self.doing is None else self.doing.match

    def give(self, order: WalkCommand, act: Act | None) -> None:
        """Set the next order, under a new number; `act` is the action that it begins, None = a stop.

        A walk that is faster than `pace` allows is ordered with the velocity that it does.
        """
        order, act = slowed(order, act, self.pace)
        self.given, self.order, self._stops = act, order, order.action == "stop"
        self.number += 1
        self._walk_id = self._given_at = None

    def take_up(self, now: float, gait: GaitView) -> None:
        """Record from the walker's state that it has started the last order, and when its last step will land.

        `now`: simulated time, s.
        """
        given = self.given
        if self._stops and gait.order == self.number:
            self._stops = False
            self.execution.cut(now, gait.ends_in)
        if gait.state == "standing" and gait.ends_in is None:
            self.execution.settle(now)
        if self.number and gait.order == self.number and given is not None:
            self.given, self.doing = None, given
            if given.kind != "stand" and not gait.refused:
                self.execution.begin(given.motion, given.duration, now, gait.ends_in)
        elif given is None:
            self.execution.correct(now, gait.ends_in)

    def remind(self, now: float, gait: GaitView) -> None:
        """Repeat an order that a standing walker has not started within 1 s, as after a restart of the walker.

        A restarted navigator has no order to repeat: it goes on from the walker's order number and decides anew.
        Simulated time: `now`, s.
        """
        if self._given_at is None:
            self._given_at = now
        elif now - self._given_at > REMIND_S and gait.state == "standing":
            self.execution.stop()
            if self.order is None:
                self.number = gait.order
            else:
                self.give(self.order, self.given)

    def failure(self, gait: GaitView) -> tuple[str, str] | None:
        """Return error code and message if the walker obeys no order or another client commands it, else None."""
        if gait.state == "refused":
            return "fallen", gait.reason or "the robot has fallen"
        if gait.order == self.number and gait.refused:
            return "stopped" if "emergency stop" in gait.refused else "walker_refused", gait.refused
        if gait.order == self.number:
            if self._walk_id is None:
                self._walk_id = gait.walk_id
            elif gait.walk_id != self._walk_id:
                return "taken_over", "another client commands the walker (cmd/walk)"
        return None


def slowed(order: WalkCommand, act: Act | None, pace: SpeedLimit) -> tuple[WalkCommand, Act | None]:
    """Return order and action of a walk at a limited speed; others, and slower walks, are returned as they are."""
    if act is None or act.kind != "walk" or order.velocity is not None:
        return order, act
    own = abs(act.motion.forward) / act.duration
    speed = pace.of(own)
    if not 0.0 < speed < own:
        return order, act
    return order.model_copy(update={"velocity": speed}), replace(act, duration=act.duration * own / speed)


def command_of(act: Act) -> WalkCommand:
    """Return the motion command of an action that moves the robot."""
    m = act.motion
    if act.kind == "turn":
        return WalkCommand(action="turn", angle=m.turn if m.turn != 0.0 else None)
    return WalkCommand(action="walk", distance=m.forward, angle=m.turn if m.turn != 0.0 else None)


def straight(acts: tuple[Act, ...]) -> Act:
    """Return the action that walks ahead with the least turn."""
    return min((act for act in acts if act.kind == "walk"), key=lambda act: abs(act.motion.turn))


def turned(acts: tuple[Act, ...], name: str, angle: float) -> Act:
    """Return a turn on the spot by an angle, with noise and time of the model's turns.

    Args:
        acts: actions of the robot.
        name: name of the action.
        angle: angle of the turn, rad, left positive.
    """
    one = next(act for act in acts if act.kind == "turn")
    times = abs(angle / one.motion.turn)
    motion = replace(one.motion.part(times), turn=angle)
    return Act(name, "turn", motion, one.duration * max(1.0, times))


def walked(acts: tuple[Act, ...], name: str, distance: float) -> Act:
    """Return a straight walk of a distance, with noise and time of the model's walk.

    Args:
        acts: actions of the robot.
        name: name of the action.
        distance: length, m, negative = backward.
    """
    act = straight(acts)
    times = abs(distance / act.motion.forward)
    motion = replace(act.motion.part(times), forward=distance, walked=distance, turn=0.0)
    return Act(name, "walk", motion, act.duration * max(1.0, times))
