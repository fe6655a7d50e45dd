"""Remaining route of a walk command of a biped, and the footsteps along it."""

import math
from dataclasses import dataclass, replace
from typing import NamedTuple

from surefoot.arrays import Array
from surefoot.schemas.topics import TICK_S

from ..interface import MotionCommand
from .params import BipedParams
from .plan import LEFT, RIGHT, advanced, between, placed

DONE = 1e-6  # m and rad, rest of a command that is nothing
LITTLE = 0.2  # of a step, rest of a walk that is not worth one
MAX_AHEAD = 32


class Footstep(NamedTuple):
    """Planned step: swinging foot, its landing `target` and the `body` pose, (3,) each: x, y (m), yaw (rad), odom."""

    swing: int
    target: Array  # (3,) x, y, yaw
    body: Array  # (3,)


class Standing(NamedTuple):
    """Poses of both feet on the floor, and the foot that swings next."""

    feet: Array  # (2, 3) x, y in m, yaw in rad, odom
    body: Array  # (3,) body pose they belong to
    swing: int


@dataclass(frozen=True)
class BipedRoute:
    """Remaining part of a walk command: straight line, arc or turn on the spot, with the size of a step."""

    forward: float
    """Remaining distance, m, negative = backward; inf = until another command."""
    turn: float
    """Remaining change of heading, rad, left positive."""
    step: float
    """Advance of the body in a full step, m, negative = backward."""
    step_turn: float
    """Change of heading in a full step, rad, left positive."""
    walk_id: int
    turning: bool
    """True if the robot turns on the spot, False if it walks straight or along an arc."""
    longest: float = math.inf
    """Largest advance of the body in one step, m."""
    widest: float = math.inf
    """Largest change of heading in one step, rad."""

    @property
    def remaining(self) -> float:
        """Remaining distance, m, or angle of a turn on the spot, rad; 0 for an endless walk."""
        left = abs(self.turn) if self.turning else abs(self.forward)
        return left if math.isfinite(left) else 0.0

    @property
    def finished(self) -> bool:
        """True if nothing of the command remains to be walked."""
        return abs(self.forward) < DONE and (abs(self.turn) < DONE or not self.turning)

    @property
    def steps(self) -> float:
        """Number of remaining full steps; inf for an endless walk."""
        if self.finished:
            return 0.0
        part = abs(self.forward / self.step) if abs(self.step) > 0.0 else abs(self.turn / self.step_turn)
        return max(1, math.ceil(part - LITTLE)) if math.isfinite(part) else math.inf

    def left(self, step_s: float, gait: str, duration: float | None) -> MotionCommand:
        """Return a command for the remaining route that leads to equal steps, each `step_s` s long.

        `duration`: time after which the walk ends, s, as in the first command; None = no limit.
        """
        if self.turning:
            return MotionCommand("turn", angle=self.turn, gait=gait, duration=duration)
        distance = self.forward if math.isfinite(self.forward) else None
        angle = None if distance is None or self.turn == 0.0 else self.turn
        return MotionCommand("walk", distance, self.step / step_s, angle, gait, duration)

    def next(self, scale: float) -> tuple[float, float, "BipedRoute"]:
        """Return distance (m) and turn (rad) of the next step, and the route after it; `scale`, 0 to 1, shortens it.

        After shortened steps less than 0.2 of a step may be left: the last step includes it if it may be so long, else
        it is dropped, for it would cost the time of a whole step.
        """
        rest = 0.0
        if abs(self.step) > 0.0:
            rest = abs(self.forward / self.step)
        elif abs(self.step_turn) > 0.0:
            rest = abs(self.turn / self.step_turn)
        part = min(scale, rest)
        longest = abs(self.step) * rest <= self.longest and abs(self.step_turn) * rest <= self.widest
        if scale == 1.0 and rest < 1.0 + LITTLE and longest:
            part = rest
        a, g = part * self.step, part * self.step_turn
        if rest - part < LITTLE:
            return a, g, replace(self, forward=0.0, turn=0.0)
        return a, g, replace(self, forward=self.forward - a, turn=self.turn - g)


def route_of(command: MotionCommand, params: BipedParams, walk_id: int) -> BipedRoute:
    """Return the route of a command, divided into equal steps that end exactly where the command does."""
    most = params.max_step_m, params.max_turn_rad
    if command.action == "turn":
        angle = command.angle or 0.0
        count = max(1, math.ceil(abs(angle) / params.turn_step_rad - 1e-6))
        return BipedRoute(0.0, angle, 0.0, angle / count, walk_id, True, *most)
    longest, distance = params.step_m, command.distance
    if command.velocity is not None:
        longest = abs(command.velocity) * params.step_s
    sign = 1.0
    if command.velocity is not None and command.velocity < 0.0:
        sign = -1.0
    if distance is None:
        return BipedRoute(sign * math.inf, 0.0, sign * longest, 0.0, walk_id, False, *most)
    angle = command.angle or 0.0
    count = max(1, math.ceil(abs(distance) / longest - 1e-6), math.ceil(abs(angle) / params.turn_step_rad - 1e-6))
    return BipedRoute(distance, angle, distance / count, angle / count, walk_id, False, *most)


def first_swing(route: BipedRoute, feet: Array) -> int:
    """Return the foot that steps first, 0 = left, 1 = right: the inner one of a turn, else the one behind.

    `feet`: left and right, x, y (m), yaw (rad), odom, (2, 3).
    """
    if route.step_turn != 0.0:
        return LEFT if route.step_turn > 0.0 else RIGHT
    body = between(feet)
    ahead = [math.cos(body[2]) * feet[i, 0] + math.sin(body[2]) * feet[i, 1] for i in (LEFT, RIGHT)]
    return LEFT if ahead[LEFT] * route.step < ahead[RIGHT] * route.step else RIGHT


def upcoming(
    route: BipedRoute | None, now: Standing, params: BipedParams, width: float, scale: float, gain: Array, ticks: int
) -> list[Footstep]:
    """Return the next footsteps: those of at least `ticks` control ticks, or all up to the closing step of the walk.

    Args:
        route: remaining route; None = only bring the feet together.
        now: the feet as they stand, or will stand after the present step.
        params: settings.
        width: half distance of the feet, m.
        scale: shortens the first step, 0..1.
        gain: (2,) ratio of measured to planned distance, and of measured to planned turn: the plan is divided by it.
        ticks: length of the preview.
    """
    steps: list[Footstep] = []
    (feet, body, swing), per_step = now, round(params.step_s / TICK_S)
    feet = feet.copy()
    while len(steps) < MAX_AHEAD and len(steps) * per_step < ticks:
        if route is not None and not route.finished:
            forward, turn, route = route.next(scale if not steps else 1.0)
            body = advanced(body, forward / gain[0], 0.0, turn / gain[1])
        elif together(feet, body, width, params):
            break
        elif not apart(feet[swing], placed(body, swing, width), params):
            swing = 1 - swing
            continue
        target = placed(body, swing, width)
        steps.append(Footstep(swing, target, body))
        feet[swing] = target
        swing = 1 - swing
    return steps


def together(feet: Array, body: Array, width: float, params: BipedParams) -> bool:
    """Return True if both feet (2, 3) stand `width` m beside the body pose (3,): x, y (m), yaw (rad), odom."""
    return not any(apart(feet[i], placed(body, i, width), params) for i in (LEFT, RIGHT))


def apart(foot: Array, wanted: Array, params: BipedParams) -> bool:
    """Return True if a foot is over `close_m` or `close_rad` from its wanted pose, both (3,): x, y (m), yaw (rad)."""
    turn = foot[2] - wanted[2]
    return bool(
        math.hypot(foot[0] - wanted[0], foot[1] - wanted[1]) > params.close_m
        or abs(math.atan2(math.sin(turn), math.cos(turn))) > params.close_rad
    )
