"""Checks of walk commands before they are carried out, for every kind of robot."""

import math
from dataclasses import dataclass

from .interface import CommandReply, MotionCommand, refused


@dataclass(frozen=True, slots=True)
class ArcLimits:
    """Limits of a walk along an arc."""

    step_m: float
    """Advance of the body in a step at the gait's own speed, m."""
    step_s: float
    """Duration of a step along an arc, s."""
    max_turn_rad: float
    """Largest change of heading in one step along an arc, rad."""


@dataclass(frozen=True, slots=True)
class Abilities:
    """Abilities of a gait against which a command is checked."""

    gaits: tuple[str, ...]
    """Names of the gaits that a command may request."""
    fastest: float
    """Largest walking speed of the robot, m/s; faster commands are refused."""
    shifts: bool = False
    """True if commands may shift the trunk over the standing feet; False = such commands are refused."""
    arcs: ArcLimits | None = None
    """Limits of walking along arcs; None = the robot turns on the spot only."""


def refusal_of(
    command: MotionCommand,
    can: Abilities,
    *,
    calibrated: bool,
    fallen: bool = False,
    stepping_gait: str | None = None,
) -> CommandReply | None:
    """Return the refusal of a command, or None if it may be carried out.

    Args:
        command: as received.
        can: abilities of the gait it asks for.
        calibrated: True if the estimator has finished its standstill calibration.
        fallen: True if the robot has fallen.
        stepping_gait: gait of the walk under way that has to end first; None: any gait may begin now.
    """
    for name in ("distance", "velocity", "angle"):
        value = getattr(command, name)
        if value is not None and not math.isfinite(value):
            return refused("bad_value", name, f"{name} must be finite, got {value}")
    if command.shift is not None and not can.shifts:
        return refused("unsupported", "shift", "shift is for robots with more than two legs")
    if command.shift is not None and command.action != "stand":
        return refused("bad_value", "shift", f"shift goes with stand, got it with {command.action!r}")
    if command.gait not in (None, *can.gaits):
        return refused("unknown_gait", "gait", f"gait must be one of {', '.join(can.gaits)}, got {command.gait!r}")
    if command.gait is not None and stepping_gait not in (None, command.gait):
        return refused("conflict", "gait", f"gait can change only while standing; {stepping_gait} is under way")
    if fallen:
        return refused("fallen", None, "the robot has fallen")
    if command.action in ("stand", "stop"):
        return None
    if command.action == "walk" and command.angle is not None and can.arcs is None:
        return refused("unsupported", "angle", "angle makes an arc, for robots with two legs; first turn, then walk")
    if not calibrated:
        return refused("not_initialised", None, "the estimator has not finished its standstill calibration")
    if command.action == "turn" and command.angle is None:
        return refused("missing_field", "angle", "angle is missing: turn needs one")
    if command.action == "turn" and can.arcs is not None:
        for field in ("distance", "velocity"):
            if getattr(command, field) is not None:
                return refused("conflict", field, f"{field} does not go with turn; walk with an angle is an arc")
    if command.velocity is not None and not 0.0 < abs(command.velocity) <= can.fastest:
        reason = f"velocity must be within 0 and {can.fastest:.3f} m/s, got {command.velocity:g}"
        return refused("too_fast", "velocity", reason)
    if command.action == "walk" and command.angle is not None and can.arcs is not None:
        return _too_tight(command, command.angle, can.arcs)
    return None


def _too_tight(command: MotionCommand, angle: float, arcs: ArcLimits) -> CommandReply | None:
    if command.distance is None or command.distance == 0.0:
        return refused("missing_field", "distance", "distance is missing: an arc needs one; turn turns on the spot")
    radius = abs(command.distance / angle) if angle else math.inf
    longest = arcs.step_m if command.velocity is None else abs(command.velocity) * arcs.step_s
    if longest / radius > arcs.max_turn_rad:
        least = longest / arcs.max_turn_rad
        return refused("too_tight", "angle", f"angle makes an arc of {radius:.3f} m radius, least is {least:.3f} m")
    return None
