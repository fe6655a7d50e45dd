"""Calibration of the force cells of feet: zero by the forces in swing, scale by the weight of the robot."""

import numpy as np

from surefoot.arrays import Array
from surefoot.geometry.constants import GRAVITY

from ..statistics import Z95
from .calibrate import NARROW, CalibratedValue
from .log import Log

EDGE_S = 0.03
"""Time after lift-off and before touchdown that does not count as swing, s."""
BLOCK_S = 0.5
"""Length of the blocks over which foot forces are averaged and compared with the robot's weight, s."""
FEWEST_SWINGS, FEWEST_BLOCKS = 3, 6
"""`FEWEST_SWINGS`: number of swings of a foot below which the zero of its force cell is not observable;
`FEWEST_BLOCKS`: number of averaged blocks below which the scales of the cells are not observable."""
FIRST_NOISE = 0.05
"""Initial noise of the mean foot force of a block, standard deviation, as a share of the robot's weight."""
ZERO_SHARE, SCALE_RANGE = 0.1, 0.3
"""`ZERO_SHARE`: half width of the likely range of the zero of a force cell, share of the robot's weight; `SCALE_RANGE`:
half width of the likely range of its scale, ratio."""


def calibrate_forces(log: Log) -> list[CalibratedValue]:
    """Return zero (N) and scale (%) of each force cell, to be added to what is stated; none if there are no forces.

    Scales are against the weight of the robot, or, if that is unknown, against the mean of the feet.
    """
    if log.force is None or len(log.foot_ns) < 2:
        return []
    force = np.asarray(log.force, dtype=np.float64)
    weight = float(np.nanmedian(np.nansum(force, axis=1)))
    zeros = [_zero(log, f, force[:, f], weight) for f in range(log.feet_count)]
    offset = np.array([one.value if one.observable else 0.0 for one in zeros])
    return [*zeros, *_scales(log, force + offset)]


def _zero(log: Log, foot: int, force: Array, weight: float) -> CalibratedValue:
    """Return the correction of the zero of the force cell of `foot`: minus the mean over swings of the median in each.

    `force` (m,) N: of that cell; `weight`: usual sum of all cells, N, which bounds the zero.
    """
    edges = np.flatnonzero(np.diff(np.concatenate([[False], ~log.contact[:, foot], [False]]).astype(np.int8)))
    seen: list[float] = []
    for first, end in zip(edges[::2], edges[1::2], strict=True):
        stamps = log.foot_ns[first:end]
        inside = (stamps >= stamps[0] + 1e9 * EDGE_S) & (stamps <= stamps[-1] - 1e9 * EDGE_S)
        value = force[first:end][inside & np.isfinite(force[first:end])]
        if value.size:
            seen.append(float(np.median(value)))
    name, likely = f"force zero of foot {foot}", ZERO_SHARE * abs(weight)
    if len(seen) < FEWEST_SWINGS:
        return CalibratedValue(name, "N", 0.0, likely, False)
    half = Z95 * float(np.std(seen, ddof=1)) / len(seen) ** 0.5 * (1.0 + 2.0 / len(seen))  # about Student's
    return CalibratedValue(name, "N", -float(np.mean(seen)), half, half < NARROW * likely)


def _scales(log: Log, force: Array) -> list[CalibratedValue]:
    """Return the correction s of the scale of each force cell: sum of (1 + s) F = mass times specific force in blocks.

    `force` (m, F) N: forces F of the cells, their zeros corrected.
    """
    count = force.shape[1]
    rows = np.clip(np.searchsorted(log.stamp_ns, log.foot_ns), 0, len(log.stamp_ns) - 1)
    block = ((log.foot_ns - log.foot_ns[0]) / (1e9 * BLOCK_S)).astype(np.int64)
    good = np.isfinite(force).all(axis=1) & np.isfinite(log.q[rows]).all(axis=1)
    names = np.unique(block[good])[1:-1]
    a = np.array([force[good & (block == b)].mean(axis=0) for b in names]).reshape(len(names), count)
    pull = np.array([np.linalg.norm(log.q[rows][good & (block == b)].mean(axis=0)) for b in names])
    known = log.robot is not None
    mass = log.robot.mass if log.robot is not None else float(np.median(a.sum(axis=1))) / GRAVITY
    label = "force scale of foot" if known else "force scale, against the mean, of foot"
    if len(names) < FEWEST_BLOCKS or not mass > 0.0:
        return [CalibratedValue(f"{label} {f}", "%", 0.0, 100.0 * SCALE_RANGE, False) for f in range(count)]
    x, y = a / (mass * GRAVITY), pull / GRAVITY - a.sum(axis=1) / (mass * GRAVITY)
    prior = np.eye(count) * (2.0 / SCALE_RANGE) ** 2
    noise, scale, inverse = FIRST_NOISE, np.zeros(count), np.linalg.inv(prior)
    for _ in range(3):
        inverse = np.linalg.inv(x.T @ x / noise**2 + prior)
        scale = inverse @ (x.T @ y) / noise**2
        noise = max(float(np.std(y - x @ scale)), 1e-4)
    score = x * (y - x @ scale)[:, None] / noise**2
    spread = inverse @ (score.T @ score + prior) @ inverse
    if not known:
        turn = np.eye(count) - 1.0 / count
        scale, inverse, spread = turn @ scale, turn @ inverse @ turn, turn @ spread @ turn
    half = Z95 * np.sqrt(np.maximum(np.diag(inverse), np.diag(spread)))
    return [
        CalibratedValue(
            f"{label} {f}", "%", 100.0 * float(scale[f]), 100.0 * float(half[f]), bool(half[f] < NARROW * SCALE_RANGE)
        )
        for f in range(count)
    ]
