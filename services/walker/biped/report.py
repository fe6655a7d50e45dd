"""What the biped walker says about itself in each tick."""

import numpy as np
from numpy.typing import NDArray

from surefoot.services.walker.biped.state import BipedState, Mode
from surefoot.services.walker.interface import WalkerOutputs, WalkState

Array = NDArray[np.float64]


def walk_state(s: BipedState) -> WalkState:
    """The state in the words of the wire; a fallen robot is `refused`, with the fall as the reason."""
    if s.mode in (Mode.FOLD, Mode.FALLEN):
        return "refused"
    if s.mode in (Mode.WAIT, Mode.RISE) or not s.calibrated:
        return "recovering" if s.recovering else "waiting"
    if s.held:
        return "hold"
    if s.route is not None:
        return "turning" if s.route.turning else "walking"
    return "standing" if s.mode is Mode.STAND else "stopping"


def outputs(s: BipedState, soles: Array, phase: float, double: bool, height: float) -> WalkerOutputs:
    """The walker's decision as it goes out.

    Args:
        s: state.
        soles: (2, 4) soles now: x, y, yaw, height; changed.
        phase: of the present step, 0..1.
        double: both feet stand in the present step.
        height: of base_link, m.
    """
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
        remaining=0.0 if s.route is None else s.route.remaining,
        margin=None,
        reason=s.reason,
        steps=s.steps,
        unreachable=s.unreachable,
    )
