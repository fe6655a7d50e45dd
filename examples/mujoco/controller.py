"""A controller of your own: sway over the feet. `control` is called before each step of MuJoCo and sets `data.ctrl`."""

import math
from typing import Any

import numpy as np


def control(model: Any, data: Any) -> None:
    """Hold the posture of keyframe 0, or the present one, by position actuators; thighs swing by 0.05 rad at 0.5 Hz."""
    if data.time == 0.0:
        control.home = np.array(data.qpos[model.jnt_qposadr[model.actuator_trnid[:, 0]]])  # type: ignore[attr-defined]
    sway = 0.05 * math.sin(math.pi * max(0.0, data.time - 2.0))
    names = [model.joint(int(joint)).name for joint in model.actuator_trnid[:, 0]]
    data.ctrl[:] = control.home + [sway if "femur" in name or "thigh" in name else 0.0 for name in names]  # type: ignore[attr-defined]
