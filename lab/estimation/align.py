"""Alignment of a log's truth with its sensors: time offset, rotation, lever arm and scale, each with its interval.

The truth's rate of turn b and the gyro's a are compared over 0.1 s: a(t - offset) = C b(t), C the rotation from the
truth's axes to the IMU's. Of all offsets, that with the largest fit is taken; the fit is the sum of the singular values
of sum a b^T, whose factors give C (Kabsch 1976). A foot that stands is a fixed place, so that with its position y in
IMU axes and R the rotation from IMU to world by the truth

    (1/scale) dp_truth - dR lever = -d(R y)         (d: change over a part of the stance)

is linear in 1/scale and the lever arm (the truth's point from the IMU); p_truth is the true position. Intervals: 95 %,
by leaving out one tenth of the time after the other.
"""

from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation, Slerp

from surefoot.arrays import Array

from ..statistics import Z95
from .log import Log

WINDOW_S = 0.1
"""Time over which the angular rates of truth and gyro are averaged before they are compared, s."""
LAGS_S = 5.0
"""Largest time offset between truth and sensors that the search covers, s, in either direction."""
GRID_S, MOST_ROWS = 0.005, 50_000
"""`GRID_S`: shortest step of the time grid on which angular rates are correlated, s; `MOST_ROWS`: most rows of that
grid."""
BLOCKS, QUANTILE = 10, 2.26
"""`BLOCKS`: parts of a log that the jackknife leaves out in turn; `QUANTILE`: 97.5 % point of Student's t with
`BLOCKS` - 1 degrees of freedom."""
FINEST, FINEST_DEG = 0.05, 0.05
"""`FINEST`: smallest half width of the 95 % interval of the time offset, in steps of the time grid; `FINEST_DEG`:
smallest half width of that of the rotation, deg."""
TURNS = 0.02
"""Angular rate, rad/s rms, below which time offset and rotation of the truth are not observable in a log."""
ALIKE = 0.5
"""Correlation of the angular rates of truth and gyro below which the truth belongs to another recording or clock;
lever arm and scale are then not estimated."""
STANCE_S, STANCES = (0.4, 0.2, 0.1), 20
"""`STANCE_S`: times between two compared samples of a standing foot, s: the longest of which a log has `STANCES` pairs
that do not overlap is used; `STANCES`: also the fewest pairs for estimating lever arm and scale."""
LIMITS = {"offset_s": 0.02, "rotation_deg": 3.0, "lever_m": 0.04, "scale": 0.03}
"""Half width of the 95 % interval, by quantity (s, deg, m, ratio), above which a log does not show that quantity."""
NOTED = {"rotation_deg": 2.0, "scale": 0.01}
"""Departure of the truth's rotation, deg, and scale, ratio, less the half width of its interval, above which a note
reports the truth as misaligned."""


STRANGE = 0.2
"""Departure of the scale of the truth from 1, ratio, above which a note reports another unit or another robot instead
of a misalignment."""


class Found(NamedTuple):
    """Quantity estimated by the alignment (offset, rotation, lever arm or scale), with the half width of its 95 %
    interval."""

    value: Array  # (k,)
    within: Array  # (k,), inf = not observable


@dataclass(frozen=True)
class Alignment:
    """Alignment of the ground truth of a log with its sensors: time offset, rotation, lever arm and scale."""

    offset_s: Found  # (1,) time by which the truth is late
    rotation_deg: Found  # (3,) rotation vector of rot_imu_from_truth_axes
    lever_m: Found  # (3,) point of the truth from the IMU, IMU axes
    scale: Found  # (1,) length by the truth over length by the legs
    correlation: float  # of the rates of turn, aligned; NaN: it hardly turns

    def known(self, name: str) -> bool:
        """Return True if quantity `name` is observable and differs from an aligned truth beyond its interval."""
        found = getattr(self, name)
        off = found.value - (1.0 if name == "scale" else 0.0)
        return bool((found.within < LIMITS[name]).all() and np.linalg.norm(off) > np.linalg.norm(found.within))

    def report(self) -> dict[str, Any]:
        """Return values and half widths of the 95 % intervals as plain numbers; None: not observable."""
        out: dict[str, Any] = {"correlation_of_turn": self.correlation}
        for name in LIMITS:
            value, within = getattr(self, name)
            seen = bool((within < LIMITS[name]).all())
            for key, part in ((name, value), (f"{name}_within", within)):
                out[key] = None if not seen else part.tolist() if len(part) > 1 else float(part[0])
        return out | {"applied": [name for name in LIMITS if self.known(name)]}

    def notes(self, period: float) -> tuple[str, ...]:
        """Return a sentence for each misalignment of the truth, () if none; `period`: time between samples, s."""
        if self.correlation < ALIKE:
            text = f"the truth does not turn as the gyro does (correlation {self.correlation:.2f} within {LAGS_S:g} s)"
            return (f"{text}: another clock, or another recording?",)
        offset, turn = float(self.offset_s.value[0]), float(np.linalg.norm(self.rotation_deg.value))
        longer, out = float(self.scale.value[0]) - 1.0, []
        if self.known("offset_s") and abs(offset) - self.offset_s.within[0] > period:
            out.append(f"{1e3 * offset:+.0f} ms late")
        if self.known("rotation_deg") and turn - np.linalg.norm(self.rotation_deg.within) > NOTED["rotation_deg"]:
            out.append(f"turned by {turn:.1f} deg")
        if self.known("scale") and abs(longer) > STRANGE:
            text = f"ways by the truth are {1.0 + longer:.2f} of those by the legs"
            return (f"{text}: another unit, or the description of another robot?",)
        if self.known("scale") and abs(longer) - self.scale.within[0] > NOTED["scale"]:
            out.append(f"{100.0 * longer:+.1f} % longer than by the legs (or feet roll or slide)")
        return (f"the truth is {', '.join(out)}; --align takes that out before scoring",) if out else ()


def align(log: Log) -> Alignment:
    """Return time offset, rotation, lever arm and scale of a log's ground truth relative to its sensors."""
    offset, rotation, correlation = _by_gyro(log)
    known = Alignment(offset, rotation, _unknown(3), _unknown(1), correlation)
    if correlation < ALIKE:
        return known
    lever, scale = _by_feet(_moved(log, known))
    return replace(known, lever_m=lever, scale=scale)


def aligned(log: Log, found: Alignment) -> Log:
    """Return a log with its truth corrected by all that `found` shows; rows that lose their truth are not scored."""
    out = _moved(log, found)
    truth, scale = out.known(), float(found.scale.value[0]) if found.known("scale") else 1.0
    lever = found.lever_m.value if found.known("lever_m") else np.zeros(3)
    position = truth.position / scale - truth.rot @ lever
    v = truth.v_world / scale - np.einsum("nij,nj->ni", truth.rot, np.cross(log.w, lever))
    offset = float(found.offset_s.value[0]) if found.known("offset_s") else 0.0
    base = out.rot_base_from_imu if log.robot is not None else np.ascontiguousarray(truth.rot[0])
    return replace(
        out, truth=replace(truth, position=position, v_world=v), rot_base_from_imu=base,
        begin_s=max(log.begin_s, -offset), end_s=max(log.end_s, offset),
    )  # fmt: skip


def _moved(log: Log, found: Alignment) -> Log:
    """Return a log with its truth moved in time and turned to the IMU's axes, by what `found` shows of both."""
    truth, seconds = log.known(), log.seconds
    if found.known("offset_s"):
        at = seconds + float(found.offset_s.value[0])
        position, v = _at(seconds, truth.position, at), _at(seconds, truth.v_world, at)
        truth = replace(truth, position=position, rot=_turned(seconds, truth.rot, at).as_matrix(), v_world=v)
    if found.known("rotation_deg"):
        turn = Rotation.from_rotvec(found.rotation_deg.value, degrees=True).as_matrix()
        truth = replace(truth, rot=truth.rot @ turn.T)
    return replace(log, truth=truth)


def _unknown(size: int) -> Found:
    return Found(np.full(size, 1.0 if size == 1 else 0.0), np.full(size, np.inf))


def _at(seconds: Array, x: Array, at: Array) -> Array:
    """Return columns x (n, 3), known at times `seconds` (n,), at other times `at` (k,) s, (k, 3)."""
    return np.stack([np.interp(at, seconds, column) for column in x.T], axis=1)


def _turned(seconds: Array, rot: Array, at: Array) -> Rotation:
    """Return orientations `rot` (n, 3, 3), known at times `seconds` (n,), at other times `at` (k,) s."""
    first = np.unique(seconds, return_index=True)[1]
    return Slerp(seconds[first], Rotation.from_matrix(rot[first]))(np.clip(at, seconds[0], seconds[-1]))


def _by_gyro(log: Log) -> tuple[Found, Found, float]:
    """Return time offset, rotation and correlation of the angular rates of truth and gyro; NaN: hardly any rotation."""
    seconds = log.seconds
    period = max(float(np.median(np.diff(seconds))), GRID_S)
    half = 0.5 * max(WINDOW_S, 2.0 * period)
    t = np.arange(half, seconds[-1] - half, period)[:MOST_ROWS]
    if len(t) < 2 * BLOCKS:
        return Found(np.zeros(1), np.full(1, np.inf)), _unknown(3), float("nan")
    angle = np.cumsum(np.nan_to_num(log.w) * np.diff(seconds, prepend=seconds[0])[:, None], axis=0)
    a = (_at(seconds, angle, t + half) - _at(seconds, angle, t - half)) / (2.0 * half)
    turn = _turned(seconds, log.rot, t - half).inv() * _turned(seconds, log.rot, t + half)
    b = turn.as_rotvec() / (2.0 * half)
    a, b = a - a.mean(axis=0), b - b.mean(axis=0)
    size = np.sqrt(np.mean(np.sum(a**2, axis=1)) * np.mean(np.sum(b**2, axis=1)))
    if not size > TURNS**2:
        return Found(np.zeros(1), np.full(1, np.inf)), _unknown(3), float("nan")
    most = min(round(LAGS_S / period), len(t) // 2)
    fits = _fit(correlations(a, b, most))
    lag = int(np.argmax(fits)) - most
    near = lag + np.arange(-2, 3)
    parts = np.array_split(np.arange(2 + abs(lag), len(t) - 2 - abs(lag)), BLOCKS)
    sums = np.array([[a[rows - k].T @ b[rows] for k in near] for rows in parts])  # (blocks, 5, 3, 3)
    total = sums.sum(axis=0)
    without = [_peak(total - part, near) for part in sums]
    offset, rot = _peak(total, near)
    offsets = np.array([[each[0]] for each in without])
    turns = np.degrees([Rotation.from_matrix(each[1] @ rot.T).as_rotvec() for each in without])
    rotvec = Rotation.from_matrix(rot).as_rotvec(degrees=True)
    fit = float(fits.max()) / (len(t) * size)
    return (
        Found(period * np.array([offset]), period * np.hypot(_jackknife(offsets), FINEST)),
        Found(rotvec, np.hypot(_jackknife(turns), FINEST_DEG)),
        fit,
    )


def correlations(a: Array, b: Array, most: int) -> Array:
    """Return the sums over the common rows of a_i(t) b_j(t + lag), (2 most + 1, 3, 3), for lags of -most to most rows.

    Args:
        a: rates of turn by one source, (n, 3), any unit.
        b: rates of turn by another, (n, 3), any unit; the sums are in the product of both.
        most: largest lag, rows, less than n.
    """
    size = 2 ** int(np.ceil(np.log2(len(a) + most + 1)))  # so that no lag wraps around
    spectra = np.conj(np.fft.rfft(a, size, axis=0))[:, :, None] * np.fft.rfft(b, size, axis=0)[:, None, :]
    whole = np.fft.irfft(spectra, size, axis=0)
    return np.concatenate([whole[size - most :], whole[: most + 1]])


def _fit(sums: Array) -> Array:
    """Return the largest trace of C^T S over rotations C, (k,), for each S of `sums` (k, 3, 3), sums of a_i b_j."""
    s = np.linalg.svd(sums, compute_uv=False)
    return s[:, 0] + s[:, 1] + np.sign(np.linalg.det(sums)) * s[:, 2]


def _peak(sums: Array, lags: Array | NDArray[np.int64]) -> tuple[float, Array]:
    """Return the lag with the best fit, between rows, and the rotation C (3, 3) there.

    `sums` (k, 3, 3): sums of a_i b_j at `lags` (k,), in whose unit the lag is.
    """
    fits = _fit(sums)
    k = min(max(int(np.argmax(fits)), 1), len(lags) - 2)
    left, middle, right = fits[k - 1 : k + 2]
    bend = left - 2.0 * middle + right
    u, _, vt = np.linalg.svd(sums[k])
    rot = u @ np.diag([1.0, 1.0, np.linalg.det(u @ vt)]) @ vt
    return float(lags[k] + (0.5 * (left - right) / bend if bend < 0.0 else 0.0)), rot


def _jackknife(values: Array) -> Array:
    """Return half widths of 95 % intervals, (k,), from the values (blocks, k) found without one block each."""
    blocks = len(values)
    return QUANTILE * np.sqrt((blocks - 1) / blocks * np.sum((values - values.mean(axis=0)) ** 2, axis=0))


def _by_feet(log: Log) -> tuple[Found, Found]:
    """Return lever arm and scale from stances, with a truth that is aligned in time and rotation."""
    matrix, wanted, when, overlap = _stances(log)
    active = np.arange(4)
    lever, scale = _unknown(3), _unknown(1)
    if len(wanted) < STANCES:
        return lever, scale
    while len(active):  # what cannot be seen leaves the equations
        x, within = _solve(matrix[:, :, active], wanted, when, overlap)
        limit = np.where(active == 0, LIMITS["scale"], LIMITS["lever_m"])
        if (within < limit).all():
            break
        worst = int(np.argmax(within / limit))
        if active[worst] == 0:
            wanted = wanted - matrix[:, :, 0]
        active = np.delete(active, worst)
    else:
        return lever, scale
    for column, value, width in zip(active, x, within, strict=True):
        if column == 0:
            scale = Found(np.array([1.0 / value]), np.array([width / value**2]))
        else:
            lever.value[column - 1], lever.within[column - 1] = value, width
    return lever, scale


def _stances(log: Log) -> tuple[Array, Array, Array, float]:
    """Return linear equations of (1/scale, lever x, y, z), one for each pair of samples of a standing foot.

    They are matrices (k, 3, 4), right sides (k, 3) m, times (k,) s, and how many of them overlap in time.
    """
    seconds = 1e-9 * (log.foot_ns - log.stamp_ns[0])
    inside = (seconds >= 0.0) & (seconds <= log.seconds[-1])
    seconds, contact = seconds[inside], log.contact[inside]
    seen, rot = log.foot_position[inside], _turned(log.seconds, log.rot, seconds).as_matrix()
    position = _at(log.seconds, log.position, seconds)
    period = float(np.median(np.diff(seconds))) if len(seconds) > 4 else 0.0
    if period <= 0.0:
        return np.empty((0, 3, 4)), np.empty((0, 3)), np.empty(0), 1.0
    place = np.einsum("mij,mfj->mfi", rot, seen)
    firm = contact & np.isfinite(place).all(axis=2) & np.isfinite(log.foot_rot[inside]).all(axis=(2, 3))
    stands = np.cumsum(np.vstack([np.zeros(firm.shape[1]), firm]), axis=0)
    pairs: list[tuple[int, int, int]] = []
    k = 1
    for part in STANCE_S:
        k = max(1, round(part / period))
        first = np.arange(1, len(seconds) - k - 1)
        whole = stands[first + k + 2] - stands[first - 1] == k + 3  # with a sample before and after
        pairs = [(int(first[i]), int(first[i]) + k, int(f)) for i, f in np.argwhere(whole)]
        if len(pairs) >= STANCES * k:
            break
    if not pairs:
        return np.empty((0, 3, 4)), np.empty((0, 3)), np.empty(0), 1.0
    i, j, f = np.array(pairs).T
    moved, turned, stayed = position[j] - position[i], rot[j] - rot[i], place[i, f] - place[j, f]
    if log.radius is not None and log.radius.any():  # the centre of a round foot rolls along
        feet = np.einsum("mij,mfjk->mfik", rot, log.foot_rot[inside])
        roll = Rotation.from_matrix(np.einsum("kij,klj->kil", feet[j, f], feet[i, f])).as_rotvec()
        stayed = stayed + np.cross(roll, log.radius[f][:, None] * [0.0, 0.0, 1.0])
    return np.concatenate([moved[:, :, None], -turned], axis=2), stayed, seconds[i], float(k)


def _solve(matrix: Array, wanted: Array, when: Array, overlap: float) -> tuple[Array, Array]:
    """Return the robust least-squares solution x (p,) of matrix x = wanted, and half widths of its 95 % intervals (p,).

    `matrix`: (k, 3, p); `wanted`: right sides, (k, 3); `when`: times of the equations, (k,) s, by which blocks are left
    out; `overlap`: number of equations that share their time.
    """
    weight = np.ones(len(wanted))
    x = np.zeros(matrix.shape[2])

    def solved(rows: Any) -> Array:
        a = (weight[rows, None, None] * matrix[rows]).reshape(-1, matrix.shape[2])
        return np.asarray(np.linalg.lstsq(a, (weight[rows, None] * wanted[rows]).ravel(), rcond=None)[0], np.float64)

    size = np.zeros(len(wanted))
    for _ in range(10):
        x = solved(slice(None))
        size = np.linalg.norm(wanted - matrix @ x, axis=1)
        weight = np.sqrt(np.minimum(1.0, 1.5 * max(float(np.median(size)), 1e-9) / np.maximum(size, 1e-12)))
    order = np.argsort(when, kind="stable")
    parts = np.array_split(order, BLOCKS)
    without = [solved(np.concatenate([p for k, p in enumerate(parts) if k != left])) for left in range(BLOCKS)]
    a = (weight[:, None, None] * matrix).reshape(-1, matrix.shape[2])
    normal = a.T @ a
    variance = overlap * np.mean((weight * size) ** 2) / 3.0
    bad = np.linalg.cond(normal) > 1e12
    spread = np.full(len(x), np.inf) if bad else Z95 * np.sqrt(variance * np.diag(np.linalg.inv(normal)))
    return x, np.maximum(spread, _jackknife(np.array(without)))
