"""Commands judged before they are obeyed."""

import math

from surefoot.services.walker.hexapod.params import WalkerParams
from surefoot.services.walker.hexapod.patterns import HEXAPOD_GAITS
from surefoot.services.walker.interface import Command, CommandReply, refused


def refusal_of(command: Command, params: WalkerParams, calibrated: bool) -> CommandReply | None:
    """Why a command cannot be obeyed, or None.

    Args:
        command: as received.
        params: settings of the walker.
        calibrated: whether the estimator has been initialised.
    """
    for name in ("distance", "velocity", "angle"):
        value = getattr(command, name)
        if value is not None and not math.isfinite(value):
            return refused("bad_value", name, f"{name} must be finite, got {value}")
    if command.shift is not None and command.action != "stand":
        return refused("bad_value", "shift", f"shift goes with stand, got it with {command.action!r}")
    if command.gait is not None and command.gait not in HEXAPOD_GAITS:
        return refused("unknown_gait", "gait", f"gait must be one of {', '.join(HEXAPOD_GAITS)}, got {command.gait!r}")
    if command.action in ("stand", "stop"):
        return None
    if command.action == "walk" and command.angle is not None:
        return refused("unsupported", "angle", "angle makes an arc, for robots with two legs; first turn, then walk")
    if not calibrated:
        return refused("not_initialised", None, "the estimator has not finished its standstill calibration")
    if command.action == "turn" and command.angle is None:
        return refused("missing_field", "angle", "turn needs an angle")
    fastest = params.max_stride_m / params.period_s
    if command.velocity is not None and not 0.0 < abs(command.velocity) <= fastest:
        reason = f"velocity must be within 0 and {fastest:.3f} m/s, got {command.velocity:g}"
        return refused("too_fast", "velocity", reason)
    return None
