"""Checks for wrong units and signs in a log, each with the factor that corrects them."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from surefoot.arrays import Array
from surefoot.errors import SurefootError
from surefoot.geometry.constants import GRAVITY

from .checks import steps_of
from .log import Log

UP_MEAN_S = 0.3
"""Averaging time of the accelerometer after which its mean shows the direction of gravity, s."""
MOST_ACC = 8.0 * GRAVITY
"""Length of the accelerometer's samples, m/s^2, above which they count as that long in their mean."""
FASTEST_GYRO = 35.0  # rad/s, 2000 deg/s: no unit of a legged robot reads more
ENOUGH = 0.02  # rad, rms turn of gravity by the gyro within 0.3 s that a judgement of its unit needs
PAIRS, LIKE = 100, 0.5
"""`PAIRS`: number of pairs of samples of the feet, and `LIKE`: correlation, from which on they decide about the gyro's
sign."""
LIKE_GRAVITY = 0.9
"""Correlation from which on gravity decides where the feet do not: a trunk that sways looks as if it rolled."""
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
    lengths = np.linalg.norm(log.q[good], axis=1)
    length = float(np.median(lengths))  # of a robot that hops the mean alone is near that of gravity
    if not any(0.7 * GRAVITY < some < 1.4 * GRAVITY for some in (length, np.minimum(lengths, MOST_ACC).mean())):
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
        raise SurefootError(
            "invalid", f"{log.name}: gravity turns by {slope:.3f} of what gyro shows: {degrees}", "gyro"
        )
    if size <= ENOUGH:
        return
    by_feet = turned_by_feet(log)
    if by_feet < 0.0 if abs(by_feet) > LIKE else slope < -0.5 and alike < -LIKE_GRAVITY:
        raise SurefootError("invalid", f"{log.name}: gravity turns against gyro: multiply by -1", "gyro")


def turned_by_feet(log: Log) -> float:
    """Return the correlation of the turns of feet that stand with those of the gyro: 1 = alike, -1 = opposite.

    A vector c from one standing foot to another is at rest in the world, so that in axes of the IMU it becomes R^T c, R
    the rotation of the IMU by its gyro, whatever its acceleration. Soles show the same by their own axes, taken as
    vectors of 0.1 m. 0: in fewer than `PAIRS` pairs of samples 0.15 s apart do two feet, or a sole, stand.
    """
    if len(log.foot_ns) < 2 or not log.contact.any():
        return 0.0
    steps = steps_of(log)
    soles = not np.array_equal(log.foot_rot, np.broadcast_to(np.eye(3), log.foot_rot.shape))
    shared, predicted, seen, pairs = 0.0, 0.0, 0.0, np.zeros(len(steps.first), dtype=np.bool_)

    def compare(before: Array, after: Array, turn: Array) -> None:
        nonlocal shared, predicted, seen
        expected, change = np.einsum("mji,mj->mi", turn, before) - before, after - before
        shared, predicted, seen = (
            total + float(np.sum(a * b))
            for total, a, b in ((shared, change, expected), (predicted, expected, expected), (seen, change, change))
        )

    for f in range(log.feet_count):
        for g in range(f + 1, log.feet_count):
            at = steps.stands[:, f] & steps.stands[:, g]
            before, after = (log.foot_position[row[at], g] - log.foot_position[row[at], f] for row in steps[:2])
            compare(before, after, steps.turn[at])
            pairs |= at
        for axis in range(3 if soles else 0):
            at = steps.stands[:, f]
            before, after = (0.1 * log.foot_rot[row[at], f, :, axis] for row in steps[:2])
            compare(before, after, steps.turn[at])
            pairs |= at
    return shared / math.sqrt(max(predicted * seen, 1e-300)) if np.count_nonzero(pairs) >= PAIRS else 0.0


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
