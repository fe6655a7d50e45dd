"""Logs of others in one NumPy layout: two humanoids with truth (columns in the README beside the files)."""

from dataclasses import replace
from pathlib import Path

import numpy as np
from scipy.signal import savgol_filter

from .files import open_log
from .log import Log

DATA = Path(__file__).resolve().parents[3] / "shared" / "data"
TRUTH_ROWS = {"icub3_gazebo_walk": 15, "icub_real_com": 61}
"""Rows of the Savitzky-Golay window (order 3) behind the true velocity of each set."""
SENSORS: dict[str, float | int] = {
    "sigma_w": 0.01, "sigma_q": 0.09, "standstill_samples": 30, "standstill_gyro_sd": 0.05, "standstill_acc_sd": 0.5,
    "acc_bias_sd": 0.05,
}  # fmt: skip
"""Parameters of their inertial units, noise per sample; the same for both."""
SOLE = np.array([[0.07, 0.03, 0.0], [0.07, -0.03, 0.0], [-0.04, 0.0, 0.0]])
"""Three points of a sole in its own axes, m: inside the outline of both robots' soles."""
WALK_FROM_S = 16.2
"""The simulated robot stands until then; its scores are those of the walk."""


def humanoid(name: str, every: int = 3, data: Path = DATA) -> Log:
    """Read a set: inertial samples of every row, feet of every third.

    Args:
        name: `icub3_gazebo_walk` or `icub_real_com`.
        every: rows between two foot samples.
        data: folder of the files.

    Raises:
        SurefootError: the set is not there.
    """
    log = open_log(data / f"{name}.npz").log
    period = float(np.median(np.diff(log.seconds)))
    v_world = savgol_filter(log.position, TRUTH_ROWS[name], 3, deriv=1, delta=period, axis=0)
    log = replace(log, stamp_ns=1 + log.stamp_ns, foot_ns=1 + log.foot_ns)  # filters of the paper skip feet at 0 ns
    return replace(
        log.with_feet(np.arange(0, len(log.foot_ns), every)), sensors=SENSORS, rest=(0, 30),
        truth=replace(log.known(), v_world=np.asarray(v_world, dtype=np.float64)),
        points=np.repeat(SOLE[None], log.feet_count, axis=0),
        begin_s=WALK_FROM_S if name == "icub3_gazebo_walk" else log.begin_s,
    )  # fmt: skip
