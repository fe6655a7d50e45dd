"""True motion of the IMU in a log of another program: from its columns, with velocities from positions if need be."""

import numpy as np

from surefoot.arrays import Array, Flags
from surefoot.errors import SurefootError
from surefoot.geometry.constants import GRAVITY
from surefoot.geometry.rotations import matrix_from_quat
from surefoot.record.columns import Columns

from .log import TrueMotion

WINDOWS_S = (0.0, 0.05, 0.09, 0.15, 0.25, 0.4, 0.6)
"""Candidate window lengths of the cubic fits that give velocity from captured positions, s; 0 = differences of
neighbours."""
APART_S = 0.1
"""Time over which changes of a velocity from captured positions are compared with the integrated accelerometer, s."""
HELD_S, HELD_TIMES = 0.1, 3.0
"""`HELD_S`: time, s; `HELD_TIMES`: multiple of the median time for which the log repeats a pose; a pose repeated for
longer than both is stale (capture lost the robot) if a neighbour differs by more than `HELD_M` or `HELD_RAD`."""
HELD_M, HELD_RAD = 0.005, 0.02
"""`HELD_M`: displacement, m; `HELD_RAD`: rotation, rad; above either, the robot moved while the capture repeated a
pose."""


def truth_of(columns: Columns, notes: list[str]) -> TrueMotion | None:
    """Return the true motion of the IMU if position and orientation are known, else None.

    Args:
        columns: arrays of the log; without `true_velocity` the velocity is that of the positions.
        notes: gets the window behind that velocity, and how much of the truth is not scored.

    Raises:
        SurefootError: numbers of the truth are not finite, or an orientation is no rotation.
    """
    if "true_position" not in columns or not ("true_rotation" in columns or "true_quat_wxyz" in columns):
        return None
    position = np.asarray(columns["true_position"], dtype=np.float64)
    if "true_rotation" in columns:
        rot = np.asarray(columns["true_rotation"], dtype=np.float64)
    else:
        rot = np.array([matrix_from_quat(q) for q in columns["true_quat_wxyz"]])
    seconds = 1e-9 * (columns["stamp_ns"] - columns["stamp_ns"][0])
    v, window = np.asarray(columns.get("true_velocity", 0.0), dtype=np.float64), 0.0
    if not (np.isfinite(position).all() and np.isfinite(rot).all() and np.isfinite(v).all()):
        raise SurefootError(
            "invalid", "the truth has numbers that are not finite; leave its columns out", "true_position"
        )
    off = np.abs(np.einsum("nji,njk->nik", rot, rot) - np.eye(3)).max(axis=(1, 2))
    if (off > 1e-2).any() or (np.linalg.det(rot) < 0.0).any():
        row = int(np.argmax((off > 1e-2) | (np.linalg.det(rot) < 0.0)))
        raise SurefootError("invalid", f"row {row}: the true orientation is no rotation", "true_rotation")
    if "true_velocity" not in columns:
        v, window = velocity_of(position, rot, seconds, np.asarray(columns["acc"], dtype=np.float64))
        if window > 0.0:
            notes.append(
                f"true velocity by the positions over {window:g} s, which agrees best with the accelerometer; "
                "estimates are compared with it over the same time"
            )
    held = held_rows(position, rot, seconds, window)
    if held.any():
        lost = float(np.median(np.diff(seconds)) * held.sum())
        notes.append(f"the truth repeats poses while the robot moves; {lost:.1f} s around them are not scored")
    return TrueMotion(position, rot, v, window, held if held.any() else None)


def held_rows(position: Array, rot: Array, seconds: Array, window_s: float) -> Flags:
    """Return the rows (n,) at which the truth repeats a pose of another time, or whose velocity comes from such a row.

    Args:
        position: positions of the IMU, (n, 3) m, world.
        rot: rotation from IMU to world, (n, 3, 3).
        seconds: times of the rows, (n,) s.
        window_s: time over which velocities are taken from positions, s.
    """
    held = np.zeros(len(seconds), dtype=np.bool_)
    poses = np.column_stack([position, rot.reshape(-1, 9)])
    new = np.flatnonzero(np.r_[True, (poses[1:] != poses[:-1]).any(axis=1)])  # row 0, then those with another pose
    turn = np.einsum("nji,nji->n", rot[new[:-1]], rot[new[1:]])  # trace of the rotation from one to the next
    jump = np.linalg.norm(np.diff(position[new], axis=0), axis=1) > HELD_M
    jump |= np.arccos(np.clip(0.5 * (turn - 1.0), -1.0, 1.0)) > HELD_RAD
    for_s = np.diff(seconds[new])
    long = (for_s > HELD_S) & (for_s > HELD_TIMES * np.median(for_s)) if len(for_s) else jump
    for k in np.flatnonzero(long & (jump | np.r_[False, jump[:-1]])).tolist():
        held |= np.abs(seconds - 0.5 * (seconds[new[k]] + seconds[new[k + 1]])) <= 0.5 * (for_s[k] + window_s)
    return held


def over_window(v: Array, seconds: Array, window_s: float) -> Array:
    """Return velocities smoothed as those of the truth are, (n, 3) m/s: slopes of cubics fitted to the path.

    A velocity from captured positions lacks motion faster than its window; smoothing makes an estimate comparable.

    Args:
        v: velocities, (n, 3) m/s, world.
        seconds: times of the rows, (n,) s.
        window_s: window of the truth's velocity, s; shorter than five rows: the velocities are returned unchanged.
    """
    period = float(np.median(np.diff(seconds))) if window_s > 0.0 and len(v) > 1 else 0.0
    if period == 0.0 or not 5 <= rows_of(window_s, period) <= len(v):
        return v
    steps = np.diff(seconds, prepend=seconds[0])[:, None]
    way = np.cumsum(0.5 * steps * (v + np.vstack([v[:1], v[:-1]])), axis=0)
    return slopes(way, rows_of(window_s, period), period)


def rows_of(window_s: float, period: float) -> int:
    """Return the odd number of rows of a window of `window_s` s; `period`: time between two rows, s."""
    return 2 * round(0.5 * window_s / period) + 1


def slopes(values: Array, rows: int, period: float) -> Array:
    """Return the derivative of equidistant values, (n, k), by a cubic that is fitted to the rows around each.

    The method is that of Savitzky and Golay; the cubics at both ends are those of the first and last whole window.
    scipy.signal is not used, because its import takes longer than all else that `surefoot estimate` does with a short
    log.

    Args:
        values: (n, k), any unit; the derivative is in that unit per s.
        rows: number of rows of a window, odd, 5 to n.
        period: between two rows, s.
    """
    half = rows // 2
    at = np.arange(-half, half + 1.0)
    fit = np.linalg.pinv(np.vander(at, 4, increasing=True))  # (4, rows): coefficients of the cubic from its values
    found = np.empty_like(values)
    for column, each in enumerate(values.T):
        found[half : len(each) - half, column] = np.correlate(each, fit[1], "valid")
    slope = np.stack([np.zeros(rows), np.ones(rows), 2.0 * at, 3.0 * at**2], axis=1) @ fit  # (rows, rows)
    found[:half], found[len(values) - half :] = slope[:half] @ values[:rows], slope[half + 1 :] @ values[-rows:]
    return found / period


def velocity_of(position: Array, rot: Array, seconds: Array, acc: Array) -> tuple[Array, float]:
    """Return the velocity of the IMU by cubic fits to its positions, (n, 3) m/s, world, and the window of the fits, s.

    Of the windows in `WINDOWS_S` it takes the one whose velocity changes over `APART_S` = 0.1 s are nearest to those by
    the accelerometer: short windows leave the scatter of the positions, long ones smooth the motion. Window 0 stands
    for differences of neighbours.

    Args:
        position: positions of the IMU, (n, 3) m, world.
        rot: rotation from IMU to world, (n, 3, 3).
        seconds: times of the rows, (n,) s.
        acc: specific force, (n, 3) m/s^2, IMU axes.
    """
    n, period = len(seconds), float(np.median(np.diff(seconds)))
    d = np.diff(seconds, prepend=seconds[0])[:, None]
    force = np.einsum("nij,nj->ni", rot, np.nan_to_num(acc)) - [0.0, 0.0, GRAVITY]
    gained = np.cumsum(force * d, axis=0)
    apart = max(1, round(APART_S / period))
    best, least, chosen = np.zeros_like(position), np.inf, 0.0
    for window in WINDOWS_S:
        rows = rows_of(window, period)
        if window > 0.0 and not 5 <= rows <= n:
            continue
        if window == 0.0:
            v = np.gradient(position, np.maximum.accumulate(seconds + 1e-9 * np.arange(n)), axis=0)
        else:
            v = slopes(position, rows, period)
        off = (v - gained)[apart:] - (v - gained)[:-apart]
        error = float(np.mean((off - off.mean(axis=0)) ** 2)) if len(off) else np.inf
        if error < least or window == 0.0:
            best, least, chosen = v, error, window
    return best, chosen
