"""Contacts of feet from forces, torques or heights, and the points of rolling feet that rest on the ground."""

from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from surefoot.arrays import Array, Flags, Ints
from surefoot.lockstep.intake import LOW_M

from .log import Log

USUAL, CARRIED = 90.0, 0.5
"""`USUAL`: percentile, %, of the total foot force over a log that counts as the usual force; `CARRIED`: share of the
usual force above which at least one foot stands (below: in flight, or lifted)."""
ALIKE_ON, ALIKE_OFF = 0.9, 0.6
"""`ALIKE_ON`: share of the force of the most loaded foot above which another foot stands, too; `ALIKE_OFF`: share below
which that foot stands no longer (hysteresis)."""
LEAST_ON, LEAST_OFF = 0.5, 0.3
"""`LEAST_ON`: share of the force of the most loaded foot below which a foot does not begin to stand; `LEAST_OFF`: share
below which a standing foot lifts; both hold however low the thresholds in N are."""
UP_S = 0.5
"""Averaging time of the accelerometer after which its mean shows the direction of gravity, s."""


def schmitt(force: Array, on: float | Array, off: float | Array) -> Flags:
    """Return contacts (m, F) of forces (m, F), N, by two thresholds: from `on` N on, until the force is below `off` N.

    The thresholds may differ from foot to foot, (F,) N.
    """
    out = np.zeros(force.shape, dtype=np.bool_)
    now = np.zeros(force.shape[1], dtype=np.bool_)
    for k, row in enumerate(force):
        now = (row > on) | (now & (row >= off))
        out[k] = now
    return out


def by_force(force: Array, on: float, off: float) -> tuple[Flags, float]:
    """Return contacts by two thresholds, which may be too high or too low for the robot.

    A foot that carries little beside the most loaded one does not stand. While the feet together carry half of what
    they usually do, and half of `off`, the most loaded one stands, and others that carry about as much.

    Args:
        force: forces on the feet, (m, F) N.
        on: force from which a foot stands, N.
        off: force below which it does not stand any more, N.

    Returns:
        Contacts (m, F), and the share of rows in which no foot stands by the thresholds but one does by this rule.
    """
    stated, total = schmitt(force, on, off), force.sum(axis=1)
    carried = total > CARRIED * max(off, float(np.percentile(total, USUAL)) if total.size else 0.0)
    most = np.maximum(force.max(axis=1, initial=0.0), 1e-9)
    share = force / most[:, None]
    alike = schmitt(np.where(carried[:, None], share, 0.0), ALIKE_ON, ALIKE_OFF)
    contact = stated & schmitt(share, LEAST_ON, LEAST_OFF) | alike
    saved = contact.any(axis=1) & ~stated.any(axis=1)
    return contact, float(saved.mean()) if saved.size else 0.0


def by_height(position: Array, up: Array) -> Flags:
    """Return contacts (m, F) by height: feet within 5 mm of the lowest of a sample.

    Args:
        position: feet, (m, F, 3) m.
        up: unit vectors that point up, in the axes of `position`, (m, 3).
    """
    height = np.einsum("mfi,mi->mf", position, up)
    return height < np.nanmin(height, axis=1, initial=np.inf)[:, None] + LOW_M


def mean_up(stamp_ns: Ints, acc: Array, foot_ns: Ints) -> Array:
    """Return the direction of the mean specific force around each foot sample, (m, 3), axes of the IMU.

    Args:
        stamp_ns: stamps of the inertial rows, (n,) ns.
        acc: specific force, (n, 3) m/s^2, axes of the IMU; rows that are not finite do not count.
        foot_ns: stamps of the foot samples, (m,) ns.
    """
    period = float(np.median(np.diff(stamp_ns))) if len(stamp_ns) > 1 else 1e9 * UP_S
    half = max(1, round(0.5e9 * UP_S / max(period, 1.0)))
    rows = np.clip(np.searchsorted(stamp_ns, foot_ns), 0, len(acc) - 1)
    total = np.nancumsum(np.vstack([np.zeros(3), acc]), axis=0)
    up = total[np.minimum(rows + half, len(acc))] - total[np.maximum(rows - half, 0)]
    return up / np.maximum(np.linalg.norm(up, axis=1), 1e-9)[:, None]


def without_rolling(log: Log) -> Log:
    """Return the log of round feet as fixed contact points, for estimators that model only point feet.

    The centre of a ball of radius r that rolls with the rate w_f moves by w_f x r up. Its displacement by rolling since
    touch-down, and r up, are subtracted from the foot's position; in a stance gravity is assumed fixed in IMU axes.
    """
    if log.radius is None or not log.radius.any():
        return log
    arm = log.radius[:, None] * mean_up(log.stamp_ns, log.q, log.foot_ns)[:, None]  # (m, F, 3) m
    gyro = np.vstack([np.zeros(3), np.cumsum(log.w[1:] * np.diff(log.seconds)[:, None], axis=0)])
    stamps = 1e-9 * (log.foot_ns - log.stamp_ns[0])
    turned = np.stack([np.interp(stamps, log.seconds, gyro[:, i]) for i in range(3)], axis=1)
    between = log.foot_rot[1:] @ np.swapaxes(log.foot_rot[:-1], -1, -2)
    turn = Rotation.from_matrix(between.reshape(-1, 3, 3)).as_rotvec().reshape(-1, log.feet_count, 3)
    step = np.cross(turn + np.diff(turned, axis=0)[:, None], arm[1:])
    rolled = np.zeros_like(arm)
    for k, stands in enumerate(log.contact[1:] & log.contact[:-1], start=1):
        rolled[k] = np.where(stands[:, None], rolled[k - 1] + step[k - 1], 0.0)
    return replace(log, foot_position=log.foot_position - arm - rolled, radius=None)
