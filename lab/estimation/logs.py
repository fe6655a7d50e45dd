"""Logs of others in one NumPy layout: two humanoids with truth (columns in the README beside the files)."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.signal import savgol_filter

from .log import Log, TrueMotion

Array = NDArray[np.float64]

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
        FileNotFoundError: the set is not there.
    """
    columns = np.load(data / f"{name}.npz")
    period = float(columns["t"][1] - columns["t"][0])
    v_world = np.asarray(
        savgol_filter(columns["p"], TRUTH_ROWS[name], 3, deriv=1, delta=period, axis=0), dtype=np.float64
    )
    return from_columns(
        name, columns, v_world, every, sensors=SENSORS, rest=(0, 30),
        begin_s=WALK_FROM_S if name == "icub3_gazebo_walk" else 0.5,
    )  # fmt: skip


def from_columns(name: str, columns: Mapping[str, Array], v_world: Array, every: int = 3, **more: Any) -> Log:
    """Return a log from the columns `t, w, a, pf, Rf, contact, fz, p, R` of a humanoid data set.

    Args:
        name: of the log.
        columns: arrays with n rows; `t` in s, the rest in SI, IMU axes; `p`, `R` the true pose of the IMU.
        v_world: true velocity, (n, 3) m/s.
        every: rows between two foot samples.
        more: other fields of the log.
    """
    stamp = 1 + np.round((columns["t"] - columns["t"][0]) * 1e9).astype(np.int64)
    rows = slice(0, len(stamp), every)
    position, rot, contact = (np.ascontiguousarray(columns[key][rows]) for key in ("pf", "Rf", "contact"))
    w, q = (np.ascontiguousarray(columns[key]) for key in ("w", "a"))
    at, turned = np.asarray(columns["p"]), np.asarray(columns["R"])
    force = np.ascontiguousarray(columns["fz"][rows]) if "fz" in columns else None
    feet = position.shape[1]
    return Log(
        name, stamp, w, q, np.ascontiguousarray(stamp[rows]), position, rot, contact.astype(np.bool_),
        TrueMotion(at, turned, v_world), force=force, points=np.repeat(SOLE[None], feet, axis=0),
        rot_base_from_imu=np.ascontiguousarray(turned[0]), **more,
    )  # fmt: skip
