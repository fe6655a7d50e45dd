"""Remaining route of a walk command, and the next advance of the trunk along it from the dead-reckoned pose."""

import math
from dataclasses import dataclass, replace

from ..interface import Advance, BodyPose, MotionCommand
from .params import WalkerParams


@dataclass(frozen=True, slots=True)
class LeggedRoute:
    """Command with the pose and time at which it began; both are None until its first step is planned."""

    command: MotionCommand
    start: BodyPose | None
    walk_id: int
    began: float | None = None
    """Simulated time of the command's first step, s; None = it has not begun."""

    def begun(self, pose: BodyPose, now: float) -> "LeggedRoute":
        """Return the route with its start: `pose` at the time `now`, s, if it has not begun yet."""
        return self if self.start is not None else replace(self, start=pose, began=now)

    def over(self, now: float) -> bool:
        """Return True if the duration of the command has passed at the time `now`, s."""
        limit = self.command.duration
        return limit is not None and self.began is not None and now - self.began >= limit


def remaining(route: LeggedRoute, pose: BodyPose) -> float:
    """Return the signed remaining distance (m) or angle (rad); inf for an endless walk, 0 for stand and stop."""
    command, start = route.command, route.start or pose
    if command.action == "walk":
        if command.distance is None:
            return math.copysign(math.inf, command.velocity if command.velocity is not None else 1.0)
        c, s = math.cos(start.yaw), math.sin(start.yaw)
        return command.distance - (c * (pose.x - start.x) + s * (pose.y - start.y))
    if command.action == "turn":
        return (command.angle or 0.0) - (pose.yaw - start.yaw)
    return 0.0


def finished(route: LeggedRoute, pose: BodyPose, params: WalkerParams) -> bool:
    """Return True if the command is carried out; a distance that was overshot counts."""
    left = remaining(route, pose)
    if route.command.action == "walk":
        forward = (route.command.distance or 1.0) >= 0.0
        return (left if forward else -left) <= params.distance_tolerance_m and route.command.distance is not None
    return abs(left) <= params.angle_tolerance_rad


def stride(command: MotionCommand, params: WalkerParams, steps_per_cycle: int, step_s: float) -> float:
    """Return the trunk's distance in one step of `step_s` s, m, >= 0, for a gait of `steps_per_cycle` steps."""
    if command.velocity is None:
        return params.stride_m / steps_per_cycle
    return min(abs(command.velocity) * step_s, params.max_stride_m / steps_per_cycle)


def advance(
    route: LeggedRoute,
    pose: BodyPose,
    params: WalkerParams,
    steps_per_cycle: int,
    scale: float = 1.0,
    step_s: float | None = None,
) -> Advance:
    """Return the movement of the trunk in the next step, heading axes of `pose`.

    Cross-track and heading errors of a walk are corrected by `steer_gain` within limits; zero if the command is done.

    Args:
        route: the command and where it began.
        pose: place of the trunk now, map.
        params: settings.
        steps_per_cycle: steps until every leg has swung once.
        scale: 0..1, shortens the step.
        step_s: duration of a step, s; None = half a period.
    """
    command, start = route.command, route.start or pose
    if command.action not in ("walk", "turn") or finished(route, pose, params):
        return Advance()
    left = remaining(route, pose)
    limit = params.steer_limit_rad
    if command.action == "turn":
        step = params.turn_step_rad * 2.0 / steps_per_cycle
        return Advance(turn=scale * max(-step, min(step, left)))
    step = stride(command, params, steps_per_cycle, 0.5 * params.period_s if step_s is None else step_s)
    c, s = math.cos(start.yaw), math.sin(start.yaw)
    across = -s * (pose.x - start.x) + c * (pose.y - start.y)
    heading = (pose.yaw - start.yaw + math.pi) % (2.0 * math.pi) - math.pi  # in [-pi, pi)
    along = max(-step, min(step, left))
    side = max(-params.steer_limit_m, min(params.steer_limit_m, -params.steer_gain * across))
    ch, sh = math.cos(heading), math.sin(heading)
    return Advance(
        forward=scale * (ch * along + sh * side),
        left=scale * (-sh * along + ch * side),
        turn=scale * max(-limit, min(limit, -params.steer_gain * heading)),
    )


def moved(pose: BodyPose, step: Advance, part: float = 1.0) -> BodyPose:
    """Return a pose after `part` of an advance (1 = all, may be more); z is kept."""
    c, s = math.cos(pose.yaw), math.sin(pose.yaw)
    return BodyPose(
        x=pose.x + part * (c * step.forward - s * step.left),
        y=pose.y + part * (s * step.forward + c * step.left),
        z=pose.z,
        yaw=pose.yaw + part * step.turn,
    )
