"""Standing feet against the inertial unit, window by window: the residuals that calibration makes small.

The gyro turns, the accelerometer moves a frame of its own, whose axes do not turn in the world:
    R' = R [w - b_w],   p'' = R (q - b_q)
R rotation from IMU to that frame, p place of the IMU in it, gravity not removed; w rate of turn, q specific force, b_w
and b_q their biases. A foot f that stands at c is seen at f(t): R(t) f(t) + p(t) = c - v s - g s^2 / 2, s = time since
the window began. Within a window (v, g, one c per stance) are free; the rest is noise of foot, creep, gyro and
accelerometer, whose covariance is K. Rows Q^T L^-1, with K = L L^T and Q orthogonal to the free terms, leave
independent residuals.
"""

import math
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from scipy.linalg import solve_triangular
from scipy.optimize import minimize

from surefoot.arrays import Array, Ints
from surefoot.geometry.constants import GRAVITY
from surefoot.geometry.linear_kernels import times, times_vector
from surefoot.geometry.rotations import matrix_from_rotvec
from surefoot.kernels.jit import kernel

from .log import Log

WINDOW_S = 2.0
"""Length of a window, s: about one stride, so that the body's motion differs from a parabola."""
TIMES, SAMPLES, WINDOWS = 200, 80, 60
"""`TIMES`: most foot samples of a window, more are thinned; `SAMPLES`: most averaged samples of single feet in a
window; `WINDOWS`: most windows of a log."""
TRIM_S = 0.03
"""Time after touchdown and before lift-off that is left out, s: the foot loads and rolls there."""
GAP_S = 0.2
"""Time between two inertial rows, s, above which samples are missing: calibration windows near such a gap are not
used."""
FEWEST = 4
"""Fewest foot samples of a stance that is used; a calibration window needs twice as many."""
STILL_M = 1e-3
"""Motion of a standing foot relative to the body, m rms, below which a calibration window is not used."""
FACTORS = np.array([2.0, 2.0, 0.05])
"""Prior standard deviations of ln(noise / first guess), (3,): foot sample, creep of the foot, accelerometer."""
INFLATION = (0.3, 1e4)
"""Smallest and largest factor on the variance of a stance, relative to the variance of all stances."""
LEAST = 1e-5
"""Smallest noise of foot, m, creep, m/s^.5, and accelerometer, m/s^1.5, in calibration: a log may state none."""
NOISE_WINDOWS = 12
"""Number of calibration windows from which the noise of feet and IMU is estimated; rounding may give nearly twice as
many."""


class StanceNoise(NamedTuple):
    """Noise of standing feet and of the IMU in windows of stances, equal in all directions."""

    foot: float  # m, of one sample
    creep: float  # m/s^.5, random walk of a standing foot
    acc: float  # m/s^1.5, random walk of the velocity
    turn: float  # rad/s^.5, random walk of the attitude


@dataclass(frozen=True, eq=False)
class StanceWindow:
    """Samples of standing feet in a time window of a log, sorted by stance (a foot's time on the ground), in N blocks.

    The samples of each block are averaged.
    """

    start_ns: int
    sample: Ints  # (M,) foot sample
    foot: Ints  # (M,)
    block: Ints  # (N,) first of the samples that are averaged, M of them in N blocks
    stance: Ints  # (N,) number of the stance in this window
    s: Array  # (N,) s since the window began
    inflation: Array  # (N,) variance of its stance over the usual one

    def averaged(self, x: Array) -> Array:
        """Return the means over the N blocks, (N, ...), of values x of the M samples, (M, ...), any unit."""
        sizes = np.diff(self.block, append=len(self.sample))
        return np.add.reduceat(x, self.block, axis=0) / sizes.reshape(-1, *(1,) * (x.ndim - 1))

    @cached_property
    def _pairs(self) -> tuple[Array, Array, Array, Array]:
        """Covariance by creep, accelerometer, gyro of unit noise, (N, N) each; columns of the n free terms, (N, n)."""
        m, late = np.minimum.outer(self.s, self.s), np.maximum.outer(self.s, self.s)
        d, same = late - m, np.equal.outer(self.stance, self.stance)
        free = np.column_stack([self.s, self.s**2, np.equal.outer(self.stance, np.arange(self.stance.max() + 1))])
        first = np.minimum.reduceat(self.s, np.flatnonzero(np.diff(self.stance, prepend=-1)))[self.stance]
        gyro = GRAVITY**2 * m**3 * (m**2 / 20.0 + d * m / 8.0 + d**2 / 12.0)
        return np.where(same, m - first, 0.0), m**2 * (3.0 * late - m) / 6.0, gyro, free

    def foot_covariance(self, noise: StanceNoise) -> Array:
        """Return the covariance by sample noise and creep of the feet, (N, N) m^2, equal for each axis."""
        return noise.creep**2 * self.inflation * self._pairs[0] + np.diag(noise.foot**2 * self.inflation)

    def whitener(self, noise: StanceNoise) -> Array:
        """Return the matrix, (N - free, N) 1/m, that turns foot places into independent residuals of unit variance.

        The matrix eliminates the `free` unknowns of the window: velocity, gravity and the place of each stance.
        """
        _, acc, gyro, free = self._pairs
        factor = np.linalg.cholesky(self.foot_covariance(noise) + noise.acc**2 * acc + noise.turn**2 * gyro)
        q, _ = np.linalg.qr(solve_triangular(factor, free, lower=True), mode="complete")
        rows = solve_triangular(factor, q[:, free.shape[1] :], lower=True, trans=1).T
        return np.ascontiguousarray(rows)

    def misfit(self, noise: StanceNoise, y: Array) -> float:
        """Return minus the logarithm of the restricted likelihood of residuals y (N, 3) m, up to a constant."""
        return _misfit(self._pairs, self.inflation, noise, y)


@kernel
def _misfit(pairs: tuple[Array, Array, Array, Array], inflation: Array, noise: StanceNoise, y: Array) -> float:
    """Return minus the log of the restricted likelihood of residuals in a window, up to a constant.

    By elimination in [K, free terms, y]: K = U^T U the covariance of the residuals, L = U^T, then L^-1 of the others.

    Args:
        pairs: of the window: parts of K by creep, accelerometer and gyro, (N, N) each, and free terms, (N, n).
        inflation: factor of the variance of each sample, (N,).
        noise: of feet and IMU.
        y: residuals, (N, 3) m.
    """
    creep, acc, gyro, free = pairs
    count, terms = free.shape
    rows = np.empty((count, count + terms + 3))
    for i in range(count):
        for j in range(count):
            rows[i, j] = noise.creep**2 * inflation[j] * creep[i, j] + noise.acc**2 * acc[i, j]
            rows[i, j] += noise.turn**2 * gyro[i, j]
        rows[i, i] += noise.foot**2 * inflation[i]
        rows[i, count : count + terms], rows[i, count + terms :] = free[i], y[i]
    logs = 0.0
    for i in range(count):
        logs += 0.5 * math.log(rows[i, i])
        rows[i, i:] /= math.sqrt(rows[i, i])
        for k in range(i + 1, count):
            factor = rows[i, k]
            for j in range(k, rows.shape[1]):
                rows[k, j] -= factor * rows[i, j]
    left = np.ascontiguousarray(rows[:, count:].T)
    for i in range(terms):  # what the free terms explain is taken off the later ones and off y
        size = math.sqrt(np.sum(left[i] ** 2))
        logs += math.log(size)
        left[i] /= size
        for k in range(i + 1, terms + 3):
            left[k] -= np.sum(left[i] * left[k]) * left[i]
    return 3.0 * logs + 0.5 * np.sum(left[terms:] ** 2)


@kernel
def integrate(step: Array, w: Array, q: Array) -> tuple[Array, Array, Array]:
    """Return attitude, velocity and position by inertial rows, integrated from rest without gravity.

    Args:
        step: length of each row, (n,) s.
        w: mean rate of turn over it, (n, 3) rad/s, IMU axes.
        q: mean specific force over it, (n, 3) m/s^2, IMU axes.

    Returns:
        At the beginning of each row: rotation from IMU to frame (n, 3, 3), velocity (n, 3) m/s, position (n, 3) m,
        frame: axes of the IMU at the first row, which do not turn.
    """
    n = step.size
    rot, v, p = np.empty((n, 3, 3)), np.zeros((n, 3)), np.zeros((n, 3))
    rot[0] = np.eye(3)
    for i in range(n - 1):
        d = step[i]
        force = times_vector(rot[i], times_vector(matrix_from_rotvec(0.5 * d * w[i]), q[i]))
        v[i + 1] = v[i] + d * force
        p[i + 1] = p[i] + d * v[i] + 0.5 * d * d * force
        rot[i + 1] = times(rot[i], matrix_from_rotvec(d * w[i]))
    return rot, v, p


@dataclass(frozen=True, eq=False)
class InertialPath:
    """Attitude and position of the IMU by its own samples, in a frame that falls and does not turn."""

    begin: Array  # (n,) s, of each row
    w: Array  # (n, 3) rad/s
    q: Array  # (n, 3) m/s^2
    rot: Array  # (n, 3, 3)
    v: Array  # (n, 3)
    p: Array  # (n, 3)

    @classmethod
    def of(cls, log: Log, gyro_bias: Array, acc_bias: Array) -> "InertialPath":
        """Return the path by the inertial rows of a log, without these biases, (3,) rad/s and (3,) m/s^2, IMU axes."""
        ends = 1e-9 * (log.stamp_ns - log.stamp_ns[0])
        step = np.diff(ends, prepend=ends[0] - np.median(np.diff(ends)))
        w, q = np.nan_to_num(log.w) - gyro_bias, np.nan_to_num(log.q) - acc_bias
        return cls(ends - step, w, q, *integrate(step, w, q))

    def at(self, t: Array) -> tuple[Array, Array]:
        """Return rotation from IMU to frame (k, 3, 3) and position (k, 3) m at times t (k,) s since the first stamp."""
        i = np.clip(np.searchsorted(self.begin, t, side="right") - 1, 0, len(self.begin) - 1)
        return _ahead(t - self.begin[i], self.w[i], self.q[i], self.rot[i], self.v[i], self.p[i])


@kernel
def _ahead(s: Array, w: Array, q: Array, rot: Array, v: Array, p: Array) -> tuple[Array, Array]:
    turned, at = np.empty_like(rot), np.empty_like(p)
    for k in range(s.size):
        force = times_vector(rot[k], times_vector(matrix_from_rotvec(0.5 * s[k] * w[k]), q[k]))
        turned[k] = times(rot[k], matrix_from_rotvec(s[k] * w[k]))
        at[k] = p[k] + s[k] * v[k] + 0.5 * s[k] * s[k] * force
    return turned, at


def stances(log: Log) -> Ints:
    """Return the number of the stance (time on the ground) of each foot at each sample, (m, F); -1 where there is none.

    A foot has none in swing, just after it has landed, and just before it lifts.
    """
    good = log.contact & np.isfinite(log.foot_position).all(axis=2) & np.isfinite(log.foot_rot).all(axis=(2, 3))
    out = np.full(log.contact.shape, -1, dtype=np.int64)
    count, trim = 0, int(1e9 * TRIM_S)
    for f in range(log.feet_count):
        edges = np.flatnonzero(np.diff(np.concatenate([[False], good[:, f], [False]]).astype(np.int8)))
        for first, end in zip(edges[::2], edges[1::2], strict=True):
            rows = np.arange(first, end)
            begins = log.foot_ns[first] + (trim if first > 0 else 0)
            ends = log.foot_ns[end - 1] - (trim if end < len(good) else 0)
            rows = rows[(log.foot_ns[rows] >= begins) & (log.foot_ns[rows] <= ends)]
            out[rows, f] = count
            count += 1
    return out


def stance_windows(log: Log, most: int = WINDOWS, seconds: float = WINDOW_S) -> list[StanceWindow]:
    """Return at most `most` windows of `seconds` s of a log in which the body moves over standing feet."""
    if len(log.stamp_ns) < FEWEST or len(log.foot_ns) < FEWEST:
        return []
    number = stances(log)
    bad = np.asarray(~(np.isfinite(log.w) & np.isfinite(log.q)).all(axis=1), dtype=np.bool_)
    if log.saturated is not None:
        bad |= log.saturated
    bad[1:] |= np.diff(log.stamp_ns) > 1e9 * GAP_S
    holes, length, span = log.stamp_ns[bad], int(1e9 * seconds), log.stamp_ns[[0, -1]]
    margin = int(1e8)  # ns, room for the offset in time
    starts = np.arange(span[0] + margin, span[1] - margin - length // 2, length)
    out: list[StanceWindow] = []
    for start in starts[:: max(1, -(-len(starts) // most))]:
        end = min(start + length, span[1] - margin)
        if ((holes > start - margin) & (holes <= end + margin)).any():
            continue
        rows = np.flatnonzero((log.foot_ns >= start) & (log.foot_ns < end))
        rows = rows[:: max(1, -(-len(rows) // TIMES))]
        window = _window(log, number, rows, int(start))
        if window is not None:
            out.append(window)
    return out


def _window(log: Log, number: Ints, rows: Ints, start: int) -> StanceWindow | None:
    seen = number[rows]
    names, counts = np.unique(seen[seen >= 0], return_counts=True)
    names = names[counts >= FEWEST]
    at, foot = np.nonzero(np.isin(seen, names))
    if len(at) < 2 * FEWEST:
        return None
    stance = np.searchsorted(names, seen[at, foot])
    order = np.lexsort((at, stance))
    at, foot, stance = at[order], foot[order], stance[order]
    each = -(-len(at) // SAMPLES)
    place = at // each + len(rows) * stance
    block = np.flatnonzero(np.diff(place, prepend=-1))
    s = np.asarray(1e-9 * (log.foot_ns[rows[at]] - start), dtype=np.float64)
    window = StanceWindow(start, rows[at], foot, block, stance[block], s, np.ones(len(block)))
    seen = window.averaged(log.foot_position[rows[at], foot])
    moved = [seen[window.stance == j].std(axis=0) for j in range(len(names))]
    return None if np.max(np.linalg.norm(moved, axis=1)) < STILL_M else replace(window, s=window.averaged(s))


def find_noise(windows: list[StanceWindow], residuals: list[Array], start: StanceNoise, sensor: float) -> StanceNoise:
    """Return the noise of feet and IMU that has the largest restricted likelihood.

    Args:
        windows: stances of a log.
        residuals: positions of the standing feet in each window, (N, 3) m, in a frame that falls and does not turn.
        start: first guess of foot, creep and accelerometer; `turn` is not fitted.
        sensor: known noise of the accelerometer, m/s^1.5.
    """
    some = slice(None, None, max(1, len(windows) // NOISE_WINDOWS))
    pairs = list(zip(windows[some], residuals[some], strict=True))

    def cost(logs: Array) -> float:
        noise = _noise(logs, start.turn)
        total = float(np.sum(((logs - likely) / FACTORS) ** 2)) / 2.0
        for window, y in pairs:
            total += window.misfit(noise, y)
        return total

    likely, first = np.log(np.array([1e-3, 1e-3, max(sensor, LEAST)])), np.log(np.maximum(start[:3], LEAST))
    found = minimize(cost, first, method="Nelder-Mead", options={"maxfev": 40, "xatol": 0.05, "fatol": 0.5})
    return _noise(np.clip(found.x, np.log(LEAST), 0.0), start.turn)


def _noise(logs: Array, turn: float) -> StanceNoise:
    foot, creep, acc = (float(x) for x in np.exp(logs))
    return StanceNoise(foot, creep, acc, turn)


def with_inflation(windows: list[StanceWindow], residuals: list[Array], noise: StanceNoise) -> list[StanceWindow]:
    """Return the windows with the variance of stances that do not fit (a foot slides, a flag is false) made larger.

    Args:
        windows: windows of the log.
        residuals: places of the standing feet in each window, (N, 3) m, in a frame that falls and does not turn.
        noise: noise of stances that fit.
    """
    out: list[StanceWindow] = []
    for window, y in zip(windows, residuals, strict=True):
        rows = window.whitener(noise)
        misfit = rows.T @ (rows @ y)  # K^-1 times the residual that the free terms leave
        share = np.einsum("ij,ij->j", rows, rows)
        inflation = window.inflation.copy()
        for j in range(int(window.stance.max()) + 1):
            part = window.stance == j
            size = float(np.mean(np.sum(misfit[part] ** 2, axis=1)) / (3.0 * max(np.mean(share[part]), 1e-12)))
            inflation[part] = np.clip(inflation[part] * size, *INFLATION)
        out.append(replace(window, inflation=inflation))
    return out
