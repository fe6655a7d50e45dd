"""Checks for wrong units and signs in a log, each with the factor that corrects them."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from surefoot.arrays import Array
from surefoot.errors import SurefootError
from surefoot.geometry.constants import GRAVITY

from .log import Log

UP_MEAN_S = 0.3
"""Averaging time of the accelerometer after which its mean shows the direction of gravity, s."""
FASTEST_GYRO = 35.0  # rad/s, 2000 deg/s: no unit of a legged robot reads more
ENOUGH = 0.02  # rad, rms turn of gravity by the gyro within 0.3 s that a judgement of its unit needs
QUIET_S, QUIET_SHARE = 0.5, 0.2
"""`QUIET_S`: length of the windows in which standard deviations of gyro and accelerometer are computed, s;
`QUIET_SHARE`: quantile of these over a log that counts as the noise of the sensor."""


@dataclass(frozen=True)
class Noise:
    """Noise of the inertial unit in the quiet part of a log."""

    sigma_w: float  # rad/s per row
    sigma_q: float  # m/s^2 per row


def check_units(log: Log) -> None:
    """Check gyro, accelerometer and feet against gravity and each other.

    Raises:
        SurefootError: a unit or sign is wrong; the text has the factor that corrects it.
    """
    good = np.asarray(np.isfinite(log.q).all(axis=1) & np.isfinite(log.w).all(axis=1), dtype=np.bool_)
    if not good.any():
        raise SurefootError("invalid", f"{log.name} has no inertial row whose numbers are all finite", "gyro")
    length = float(np.median(np.linalg.norm(log.q[good], axis=1)))
    if not 0.7 * GRAVITY < length < 1.4 * GRAVITY:
        hint = f"in g, multiply by {GRAVITY}" if 0.7 < length < 1.4 else f"factor {GRAVITY / max(length, 1e-12):.4g}?"
        raise SurefootError(
            "invalid", f"{log.name}: acc is {length:.3g} long, wanted is about 9.81 m/s^2: {hint}", "acc"
        )
    _check_sign(log, good)
    _check_gyro(log, good)


def _check_sign(log: Log, good: NDArray[np.bool_]) -> None:
    """Check that the feet that stand are below the IMU, by the specific force in rows that are `good` (rows,).

    Raises:
        SurefootError: the accelerometer has the other sign.
    """
    rows = np.clip(np.searchsorted(log.stamp_ns, log.foot_ns), 0, len(log.stamp_ns) - 1)
    stands = log.contact & np.isfinite(log.foot_position).all(axis=2) & good[rows][:, None]
    if not stands.any():
        return
    along = np.einsum("mfi,mi->mf", log.foot_position, log.q[rows])[stands]
    if np.median(along) > 0.0 and np.mean(along > 0.0) > 0.9:
        raise SurefootError(
            "invalid", f"{log.name}: the feet that stand are above the IMU; acc has the other sign, multiply by -1 "
            "(at rest it points up)", "acc",
        )  # fmt: skip


def _check_gyro(log: Log, good: NDArray[np.bool_]) -> None:
    """Raise SurefootError if the gyro seems to be in deg/s or of opposite sign, by q' = -w x q over means of 0.3 s.

    q specific force, m/s^2, w rate of turn, rad/s, both in axes of the inertial unit, in rows that are `good` (n,).
    """
    w, q = log.w[good], log.q[good]
    most = float(np.quantile(np.abs(w), 0.999))
    period = 1e-9 * float(np.median(np.diff(log.stamp_ns)))
    rows = max(1, round(UP_MEAN_S / period))
    degrees = f"in deg/s, multiply by {math.pi / 180.0:.6g}"
    if most > FASTEST_GYRO:
        raise SurefootError("invalid", f"{log.name}: gyro reaches {most:.3g} rad/s: {degrees}", "gyro")
    if len(w) < 4 * rows:
        return
    up = _means(q, rows)
    up /= np.linalg.norm(up, axis=1)[:, None]
    rate = _means(w - np.median(w, axis=0), rows)
    turn = -np.cross(rate[:-rows], 0.5 * (up[:-rows] + up[rows:])) * rows * period
    moved = up[rows:] - up[:-rows]
    size = float(np.sqrt(np.mean(np.sum(turn**2, axis=1))))
    slope = float(np.sum(turn * moved) / max(np.sum(turn**2), 1e-300))
    alike = float(np.sum(turn * moved) / math.sqrt(max(np.sum(turn**2) * np.sum(moved**2), 1e-300)))
    if size > ENOUGH * 180.0 / math.pi / 4.0 and abs(slope) < 0.1:
        raise SurefootError("invalid", f"{log.name}: gravity turns by {slope:.3f} of what gyro says: {degrees}", "gyro")
    if size > ENOUGH and slope < -0.5 and alike < -0.5:
        raise SurefootError("invalid", f"{log.name}: gravity turns against gyro: multiply by -1", "gyro")


def _means(x: Array, rows: int) -> Array:
    total = np.cumsum(np.vstack([np.zeros(3), x]), axis=0)
    return (total[rows:] - total[:-rows]) / rows


def quietest(log: Log) -> Noise:
    """Return the IMU noise in the quiet part of a log, limited to the range of real sensors."""
    good = np.isfinite(log.q).all(axis=1) & np.isfinite(log.w).all(axis=1)
    w, q = log.w[good], log.q[good]
    rows = max(10, round(QUIET_S / (1e-9 * float(np.median(np.diff(log.stamp_ns))))))
    if len(w) < rows:
        return Noise(0.01, 0.1)
    sd_w, sd_q = (float(np.quantile(_spread(x, rows), QUIET_SHARE)) for x in (w, q))
    return Noise(float(np.clip(sd_w, 1e-3, 0.01)), float(np.clip(sd_q, 0.01, 0.1)))


def _spread(x: Array, rows: int) -> Array:
    """Return the standard deviation of the noisiest axis of x (n, c) within each window of `rows` rows, unit of x."""
    centred = x - x.mean(axis=0)
    mean, square = _means(centred, rows), _means(centred**2, rows)
    return np.sqrt(np.maximum((square - mean**2).max(axis=1), 1e-12))
