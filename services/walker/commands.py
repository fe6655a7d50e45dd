"""Commands judged before they are obeyed."""

import math

from services.walker.gaits import HEXAPOD_GAITS
from services.walker.interface import Command, CommandReply
from services.walker.params import WalkerParams


def refusal_of(command: Command, params: WalkerParams, calibrated: bool) -> CommandReply | None:
    """Why a command cannot be obeyed, or None.

    Args:
        command: as received.
        params: settings of the walker.
        calibrated: whether the estimator has been initialised.
    """
    values = (command.distance, command.velocity, command.angle)
    if any(value is not None and not math.isfinite(value) for value in values):
        return _no("bad_value", f"numbers must be finite, got {values}")
    if command.shift is not None and command.action != "stand":
        return _no("bad_value", f"shift goes with stand, got it with {command.action!r}")
    if command.gait is not None and command.gait not in HEXAPOD_GAITS:
        return _no("unknown_gait", f"gait must be one of {', '.join(HEXAPOD_GAITS)}, got {command.gait!r}")
    if command.action in ("stand", "stop"):
        return None
    if not calibrated:
        return _no("not_initialised", "the estimator has not finished its standstill calibration")
    if command.action == "turn" and command.angle is None:
        return _no("missing_field", "turn needs an angle")
    fastest = params.max_stride_m / params.period_s
    if command.velocity is not None and not 0.0 < abs(command.velocity) <= fastest:
        return _no("too_fast", f"velocity must be within 0 and {fastest:.3f} m/s, got {command.velocity:g}")
    return None


def _no(code: str, reason: str) -> CommandReply:
    return CommandReply(False, 0, code, reason)
