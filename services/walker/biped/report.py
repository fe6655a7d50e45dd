"""Conversion of the biped walker's state to its outputs in a control tick: set-points, feet, progress, reasons."""

import math

import numpy as np

from surefoot.arrays import Array
from surefoot.schemas.topics import TICK_S

from ..interface import WalkerOutputs, WalkState
from .params import BipedParams
from .state import BipedState, Mode


def walk_state(s: BipedState) -> WalkState:
    """Return the state of the walk to publish; a fallen robot's is `refused`, with the fall as the reason."""
    if s.mode in (Mode.FOLD, Mode.FALLEN):
        return "refused"
    if s.mode in (Mode.WAIT, Mode.RISE) or not s.calibrated:
        return "recovering" if s.recovering else "waiting"
    if s.held or s.paused is not None:
        return "hold"
    if s.late is not None:
        route = s.late.route
        return "stopping" if route is None else "turning" if route.turning else "walking"
    if s.route is not None:
        return "turning" if s.route.turning else "walking"
    return "standing" if s.mode is Mode.STAND else "stopping"


def ends_in_s(s: BipedState, p: BipedParams, ticks_left: int) -> float | None:
    """Return the time until the last planned step of the present command lands, s; None = no command is under way.

    None also in the closing step, which follows the last planned one.

    Args:
        s: state.
        p: settings of the gait.
        ticks_left: control ticks of the present step, or of the shift of weight before the first.
    """
    route = s.route if s.late is None else s.late.route
    if route is None or s.mode not in (Mode.STAND, Mode.START, Mode.STEP):
        return None
    begins = TICK_S * ticks_left if s.mode is not Mode.STAND else p.start_s
    if s.late is not None:
        begins += p.start_s
    elif s.mode is Mode.STEP and route.finished and (s.undone is None or s.undone.finished):
        return None  # the closing step
    ends = begins + route.steps * p.step_s
    if s.duration is not None and s.late is None:
        rest = s.duration if s.began is None else max(0.0, s.began + s.duration - s.stamp - begins)
        ends = min(ends, begins + math.ceil(rest / p.step_s - 1e-9) * p.step_s)
    return round(ends, 6) if math.isfinite(ends) else None


def outputs(
    s: BipedState, soles: Array, phase: float, double: bool, height: float, ends: float | None = None
) -> WalkerOutputs:
    """Return the outputs of the biped walker in a tick.

    Args:
        s: state.
        soles: (2, 4) soles now: x, y, yaw, height, m and rad, odom; changed to the landing of a foot in swing.
        phase: phase of the present step, 0..1.
        double: True if both feet stand in the present step.
        height: height of base_link, m.
        ends: time until the last planned step lands, s; None = no command is under way, or unknown.
    """
    route = s.route if s.late is None else s.late.route
    stance = np.ones(2, dtype=np.bool_)
    if s.mode is Mode.STEP and s.step is not None:
        stance[s.step.swing] = double
        soles[s.step.swing, :3] = s.step.target
        soles[s.step.swing, 3] = 0.0
    return WalkerOutputs(
        command=s.command,
        state=walk_state(s),
        walk_id=s.walk_id,
        phase=phase,
        stance=stance,
        footholds=np.column_stack((soles[:, :2], soles[:, 3])),
        foothold_status=("nominal", "nominal"),
        trunk_height=height,
        remaining=0.0 if route is None else route.remaining,
        margin=None,
        reason=s.reason,
        steps=s.steps,
        unreachable=s.unreachable,
        ends_in_s=ends,
    )
