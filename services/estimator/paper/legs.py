"""Velocity of the IMU by the legs, from two successive samples of the feet; equation numbers of Wawrzynski et al.

p_f, rot_f = position and orientation of the foot in IMU axes. With D the time between the samples, w the MEAN gyro over
it and p the mean of both positions, a foot that does not slide gives (identity proved in the tests against `chain`)

    v^KG = -(p_1 - p_0)/D - w x p                        (5)-(14), robust to a twisting foot
    v^K  = rot_1 (r_1 - r_0)/D,   r = -rot^T p           (5)-(10), right only if the foot keeps its orientation

A round foot rolls: its centre moves by w_foot x (radius * up), which is added to `v^KG`.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from surefoot.arrays import Array, Flags
from surefoot.kernels.jit import kernel

from ..feet.mount import FootSample, foot_turn
from ..params import EstimatorParams

MAX_INTERVAL = 3.5
"""Longest time between two samples of the feet for a velocity, in periods of the joints' samples; after more: none."""
MIN_SPREAD = 1e-4
"""Least spread of three feet that show a rotation, m^2: 1 cm beside one line; with less no rotation is computed."""


@kernel
def cross(a: Array, b: Array) -> Array:
    """Return the cross product a x b, (3,), of two vectors (3,), in the product of their units."""
    out = np.empty(3)
    out[0] = a[1] * b[2] - a[2] * b[1]
    out[1] = a[2] * b[0] - a[0] * b[2]
    out[2] = a[0] * b[1] - a[1] * b[0]
    return out


@kernel
def foot_velocities(
    last: FootSample, now: FootSample, used: Flags, w: Array, up: Array, radius: Array
) -> tuple[Array, Array]:
    """Return the velocity of the IMU by each foot between two samples, if that foot does not slide.

    Args:
        last: earlier sample of the feet.
        now: later sample of the feet.
        used: True for feet to compute, (L,); all other feet give 0.
        w: mean gyro between the samples, IMU axes, (3,) rad/s.
        up: upward unit vector, IMU axes, (3,).
        radius: radius of round feet, which roll, (L,) m; 0 = a sole.

    Returns:
        v^KG (L, 3), with the turn by the gyro, and v^K (L, 3), by kinematics alone, m/s, IMU axes.
    """
    p_0, p_1, rot_0, rot_1 = last.position, now.position, last.rot, now.rot
    feet, d = p_0.shape[0], 1e-9 * (now.stamp_ns - last.stamp_ns)
    v_kg, v_k = np.zeros((feet, 3)), np.zeros((feet, 3))
    arm, moved = np.empty(3), np.empty(3)
    for f in range(feet):
        if not used[f]:
            continue
        for i in range(3):
            arm[i] = 0.5 * (p_0[f, i] + p_1[f, i])
        sweep = cross(w, arm)
        for i in range(3):
            v_kg[f, i] = -(p_1[f, i] - p_0[f, i]) / d - sweep[i]
        if radius[f] > 0.0:
            turn = foot_turn(rot_0[f], rot_1[f])
            for i in range(3):
                turn[i] = w[i] + turn[i] / d
                arm[i] = radius[f] * up[i]
            rolled = cross(turn, arm)
            for i in range(3):
                v_kg[f, i] += rolled[i]
        for i in range(3):
            moved[i] = 0.0
            for k in range(3):
                moved[i] += rot_0[f, k, i] * p_0[f, k] - rot_1[f, k, i] * p_1[f, k]
        for i in range(3):
            for k in range(3):
                v_k[f, i] += rot_1[f, i, k] * moved[k] / d
    return v_kg, v_k


@kernel
def rigid_fit(last: FootSample, now: FootSample, used: Flags) -> tuple[Array, Array, bool]:
    """Return the twist of the IMU from three or more point feet, no gyro: min sum |v + w x p_f + (p_1 - p_0)/d|^2.

    The sum is over feet f, p_f the mean of p_0 and p_1. It is the kinematics-only estimate of a robot whose feet are
    points: equation (10) of Wawrzynski et al. needs the orientation of a foot, which a point does not have; three
    points that stay put have one.

    Args:
        last: earlier sample of the feet, at p_0.
        now: later sample of the feet, at p_1, d s after it.
        used: feet to take, (L,) bool.

    Returns:
        v (3,) m/s, w (3,) rad/s, IMU axes; True if three feet off one line were there.
    """
    p_0, p_1, d = last.position, now.position, 1e-9 * (now.stamp_ns - last.stamp_ns)
    feet = p_0.shape[0]
    n = 0
    centre, mean = np.zeros(3), np.zeros(3)
    for f in range(feet):
        if used[f]:
            n += 1
            for i in range(3):
                centre[i] += 0.5 * (p_0[f, i] + p_1[f, i])
                mean[i] -= (p_1[f, i] - p_0[f, i]) / d
    if n < 3:
        return np.zeros(3), np.zeros(3), False
    for i in range(3):
        centre[i] /= n
        mean[i] /= n
    a, b, arm, rate = np.zeros((3, 3)), np.zeros(3), np.empty(3), np.empty(3)
    for f in range(feet):
        if used[f]:
            for i in range(3):
                arm[i] = 0.5 * (p_0[f, i] + p_1[f, i]) - centre[i]
                rate[i] = -(p_1[f, i] - p_0[f, i]) / d - mean[i]
            moment = cross(arm, rate)
            for i in range(3):
                b[i] += moment[i]
            square = arm[0] * arm[0] + arm[1] * arm[1] + arm[2] * arm[2]
            for i in range(3):
                a[i, i] += square
                for k in range(3):
                    a[i, k] -= arm[i] * arm[k]
    w, ok = _solve_3(a, b)
    if not ok:
        return np.zeros(3), np.zeros(3), False
    swept = cross(w, centre)
    for i in range(3):
        mean[i] -= swept[i]
    return mean, w, True


@kernel
def leg_velocity(
    last: FootSample, now: FootSample, used: Flags, w: Array, up: Array, radius: Array, gate: float, v_now: Array
) -> tuple[Array, int, Array, int, Flags]:
    """Return one velocity of the IMU from two samples of the feet, with the gyro (v^KG) and without it (v^K).

    Args:
        last: earlier sample of the feet.
        now: later sample of the feet.
        used: feet to take, (L,).
        w: mean gyro between the samples, IMU axes, (3,) rad/s.
        up: upward unit vector, IMU axes, (3,).
        radius: radius of round feet, (L,) m; 0 = a sole.
        gate: largest distance of a foot's velocity from the median of the feet, m/s.
        v_now: velocity by the filter, IMU axes, (3,) m/s; one or two feet further than `gate` from it count as
            slipping.

    Returns:
        v^KG (3,) m/s, number of feet in it, v^K (3,) m/s, number of feet in it, IMU axes; slipping or uncertain feet
        (L,).
    """
    v_kg, v_k = foot_velocities(last, now, used, w, up, radius)
    mean_kg, slipping, feet_kg = combine(v_kg, used, gate)
    trusted, feet_k = np.empty(used.size, dtype=np.bool_), 0
    for f in range(used.size):
        trusted[f] = used[f] and not slipping[f]
        feet_k += 1 if trusted[f] else 0
    mean_k, _, fits = rigid_fit(last, now, trusted)
    if not fits:
        mean_k, _, feet_k = combine(v_k, trusted, np.inf)
    if 0 < feet_kg < 3:
        for f in range(used.size):
            off = 0.0
            for i in range(3):
                off += (v_kg[f, i] - v_now[i]) ** 2
            slipping[f] = used[f] and off > gate * gate
    return mean_kg, feet_kg, mean_k, feet_k, slipping


@kernel
def _solve_3(a: Array, b: Array) -> tuple[Array, bool]:
    """Return the solution (3,) of a x = b by cofactors, and False with zeros if a is near singular.

    `a`: symmetric, (3, 3) m^2, sum over feet of |r|^2 I - r r^T; `b`: (3,) m^2/s.
    """
    c = np.empty((3, 3))
    for i in range(3):
        i1, i2 = (i + 1) % 3, (i + 2) % 3
        for k in range(3):
            k1, k2 = (k + 1) % 3, (k + 2) % 3
            c[i, k] = a[i1, k1] * a[i2, k2] - a[i1, k2] * a[i2, k1]
    det = a[0, 0] * c[0, 0] + a[0, 1] * c[0, 1] + a[0, 2] * c[0, 2]
    if det < MIN_SPREAD**3:
        return np.zeros(3), False
    x = np.zeros(3)
    for i in range(3):
        for k in range(3):
            x[i] += c[k, i] * b[k] / det
    return x, True


@kernel
def order(values: Array) -> NDArray[np.int64]:
    """Return the indices (n,) that sort a handful of numbers (n,), equal ones in their order, NaN last."""
    ranked = np.empty(values.size, dtype=np.int64)
    for i in range(values.size):
        k = i
        while k > 0 and (values[i] < values[ranked[k - 1]] or math.isnan(values[ranked[k - 1]])):
            ranked[k] = ranked[k - 1]
            k -= 1
        ranked[k] = i
    return ranked


@kernel
def median(values: Array) -> float:
    """Return the median of a handful of numbers, (n,), n > 0, in their unit."""
    ranked = order(values)
    return float(0.5 * (values[ranked[(values.size - 1) // 2]] + values[ranked[values.size // 2]]))


@kernel
def combine(v: Array, used: Flags, gate: float) -> tuple[Array, Flags, int]:
    """Return one velocity from several feet, the feet that slip, and the number of feet in the mean.

    Median per axis, then the mean of the feet within `gate` of it: with three feet or more one sliding foot is left
    out, and the mean of the rest has the least encoder noise. Of two feet the mean is taken.

    Args:
        v: velocity by each foot, IMU axes, (L, 3) m/s.
        used: feet to take, (L,).
        gate: largest distance from the median, m/s.

    Returns:
        velocity (3,) m/s, slipping (L,), number of feet in the mean; 0 with the median if no two feet agree, or with
        zeros if none is used.
    """
    feet = v.shape[0]
    slipping = np.zeros(feet, dtype=np.bool_)
    n = 0
    for f in range(feet):
        n += 1 if used[f] else 0
    out = np.zeros(3)
    if n == 0:
        return out, slipping, 0
    middle = np.empty(3)
    values = np.empty(n)
    for i in range(3):
        k = 0
        for f in range(feet):
            if used[f]:
                values[k] = v[f, i]
                k += 1
        middle[i] = median(values)
    kept = 0
    for f in range(feet):
        if not used[f]:
            continue
        x, y, z = v[f, 0] - middle[0], v[f, 1] - middle[1], v[f, 2] - middle[2]
        if n > 2 and x * x + y * y + z * z > gate * gate:
            slipping[f] = True
            continue
        kept += 1
        for i in range(3):
            out[i] += v[f, i]
    if kept == 0:  # no two feet agree: the median is all there is
        return middle, slipping, 0
    for i in range(3):
        out[i] /= kept
    return out, slipping, kept


class LegVelocity(NamedTuple):
    """Mean velocity of the IMU between two samples by the stance feet, those in contact at both, IMU axes.

    stamp_ns: end of the interval, ns; v_kg: by kinematics and gyro, (3,) m/s, of feet_kg feet, 0 = no measurement; v_k:
    by kinematics only, (3,) m/s, of feet_k feet; stance: feet in contact at both samples, (L,); slipping: feet left
    out, or uncertain (of one or two stance feet), (L,).
    """

    stamp_ns: int  # end of the interval
    interval_s: float
    v_kg: Array  # (3,) m/s, kinematics and gyro, (14)
    feet_kg: int  # feet in v_kg; 0: no measurement
    v_k: Array  # (3,) m/s, kinematics only, (10)
    feet_k: int  # feet in v_k; 0: no measurement
    stance: Flags  # (L,) in contact at both samples
    slipping: Flags  # (L,) left out, or (one or two stance feet) uncertain


class LegTracker:
    """Tracker that stores the last sample of the feet and computes the velocity of the IMU from it and the next one.

    Args:
        feet: number L of feet.
        radius: radii of the foot spheres, (L,) m; 0 = a sole.
        params: switches of the method, and limits.
    """

    def __init__(self, feet: int, radius: Array, params: EstimatorParams) -> None:
        self._params = params
        self._radius = radius if params.rolling else np.zeros(feet)
        self._longest = MAX_INTERVAL * params.kinematics_period_ns
        self.reset()

    def reset(self) -> None:
        """Forget the last sample of the feet; the next gives no velocity."""
        self.last: FootSample | None = None
        self._support = -1

    def step(self, sample: FootSample, w: Array, up: Array, v_now: Array) -> LegVelocity | None:
        """Return the velocity of the IMU by the feet since the sample before; None for the first one and after a gap.

        A foot counts if it is in contact at BOTH samples.

        Args:
            sample: the feet now.
            w: mean gyro since the last sample (or the latest sample, as by Wawrzynski et al.), IMU axes, (3,) rad/s,
                bias removed.
            up: upward unit vector, IMU axes, (3,).
            v_now: velocity by the filter, IMU axes, (3,) m/s; of one or two feet it shows which slide.
        """
        last, self.last = self.last, sample
        if last is None or not 0 < sample.stamp_ns - last.stamp_ns <= self._longest:
            self._support = -1
            return None
        d = 1e-9 * (sample.stamp_ns - last.stamp_ns)
        stance = last.contact & sample.contact
        used = self._one(stance) if self._params.feet == "one" else stance
        v_kg, feet_kg, v_k, feet_k, slipping = leg_velocity(
            last, sample, used, w, up, self._radius, self._params.slip_speed, v_now
        )
        return LegVelocity(sample.stamp_ns, d, v_kg, feet_kg, v_k, feet_k, stance, slipping)

    def _one(self, stance: Flags) -> Flags:
        """Return the one foot to use, (L,) bool: the previous foot until it lifts, then the first that stands.

        `stance`: feet in contact at both samples, (L,).
        """
        if self._support < 0 or not stance[self._support]:
            standing = np.flatnonzero(stance)
            self._support = int(standing[0]) if len(standing) else -1
        used = np.zeros_like(stance)
        if self._support >= 0:
            used[self._support] = True
        return used
