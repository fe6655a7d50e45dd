"""A whole log smoothed: forward and backward estimates of `best`, fused at each row by their covariances.

The backward estimate is that of the reversed log. At row k the forward one has rows and feet up to its stamp, the
backward one those after it: no sample counts twice. With x = (g, v, b_w, b_q) in IMU axes, P its covariance and the
difference d = x_f - x_b,

    K = P_f (P_f + P_b)^-1,   x = x_f - K d,   P = D (P_f - K P_f) D       (Fraser & Potter 1969)

The biases are part of x because the samples show tilt and accelerometer bias mostly as a sum, hardly each by
itself. D is diagonal: where the two passes differ by more than their covariances allow, chi^2 of d over its degrees
of freedom, as a mean over a second, is above 1; the published covariance of g, v and each bias grows by that factor.

Heading is the sum of the changes in both passes, each weighted by the inverse variance of its gyro bias about the
vertical. The path is the integral of the fused velocity, which over `LASTING_S` and longer follows the path of the
forward pass; the velocity is corrected so that its integral is the path.
"""

import math
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from scipy.ndimage import gaussian_filter1d, uniform_filter1d

from surefoot.arrays import Array, Flags
from surefoot.errors import SurefootError
from surefoot.geometry.constants import GRAVITY
from surefoot.services.estimator.stream import BEST

from .log import Log
from .reverse import follows, reversed_log
from .scores import base_rot
from .track import FLAGS, Track, check_name, track


class _Block(NamedTuple):
    """Part of the smoothed state as a slice, with the degrees of freedom of its error (2 for gravity of known
    length)."""

    part: slice
    freedom: int


BLOCKS = (_Block(slice(0, 3), 2), _Block(slice(3, 6), 3), _Block(slice(6, 9), 3), _Block(slice(9, 12), 3))
"""Parts of the smoothed state: specific force at rest, velocity, gyro bias, accelerometer bias."""
AGREED_S = 1.0
"""Time over which the differences of the two passes are averaged, s: longer than a step, shorter than a slide."""

LASTING_S = 2.0
"""Standard deviation of a Gaussian window, s: over longer times the smoothed path follows the forward pass, over
shorter ones the integral of the fused velocity."""


def smooth(name: str, log: Log, **options: Any) -> Track:
    """Return the smoothed track of a log; rows before the start of the forward pass have an estimate, too.

    A pass has no weight at rows where it has not started or its `filter_ok` is false, unless this holds of both passes.
    Heading and position are those of the forward pass at its start.

    Args:
        name: name of the estimator; `best` alone has a covariance of all that is fused.
        log: what to run over, in the order of its stamps.
        options: changes of the parameters of the estimator.

    Raises:
        SurefootError: another estimator, or a log whose stamps go backwards.
    """
    check_name(name)
    if name != BEST:
        raise SurefootError("invalid", f"--smooth goes with the estimator {BEST}, got {name!r}", "estimator")
    if (np.diff(log.stamp_ns) < 0).any() or (np.diff(log.foot_ns) < 0).any():
        raise SurefootError("invalid", f"stamps of {log.name} go backwards; the whole log needs one clock", "smooth")
    ahead = track(name, replace(log, order=None), joint=True, **options)
    # the slope of the ground is stated for the start of the log, not for its end
    back = track(name, reversed_log(log), **{**options, "start_slope_sd": math.inf, "joint": True})
    return fused(log, ahead, mirrored(back, follows(log)))


def mirrored(found: Track, known: Flags) -> Track:
    """Return a track over a reversed log with its rows in the order and signs of the log itself.

    `known`: True for rows that the reversed log has as well, (n,); at others the track counts as not started.
    """
    order = np.append(np.arange(len(known) - 2, -1, -1), 0)
    sign = np.repeat([1.0, -1.0, -1.0, 1.0], 3)
    flags = {flag: found.flags[flag][order] & known for flag in FLAGS}
    changed = {name: None if values is None else values[order] for name, values in (
        ("g", found.g), ("position", found.position), ("yaw", found.yaw), ("nis", found.nis),
        ("slipping", found.slipping), ("acc_bias", found.acc_bias),
    )}  # fmt: skip
    gyro_bias, joint = _whole(found.gyro_bias), _whole(found.joint)
    return replace(
        found, v=-found.v[order], p=sign[:6, None] * found.p[order] * sign[:6], v_odom=-found.v_odom[order],
        flags=flags, gyro_bias=-gyro_bias[order], joint=sign[:, None] * joint[order] * sign, **changed,
    )  # fmt: skip


def _whole(values: Array | None) -> Array:
    if values is None:
        raise ValueError("a track without biases and their covariance")
    return values


def _state(found: Track) -> Array:
    """Return estimates (g m/s^2, v m/s, gyro bias rad/s, accelerometer bias m/s^2) of n rows, (n, 12), IMU axes."""
    return np.hstack([found.g, found.v, _whole(found.gyro_bias), _whole(found.acc_bias)])


def fused(log: Log, ahead: Track, back: Track) -> Track:
    """Return the track of a log whose forward and backward estimates are fused by their covariances."""
    good = [one.flags["initialised"] & one.flags["filter_ok"] for one in (ahead, back)]
    none = ~(good[0] | good[1])
    used = [ok | (none & one.flags["initialised"]) for ok, one in zip(good, (ahead, back), strict=True)]
    x, p, p_back = _state(ahead), _whole(ahead.joint).copy(), _whole(back.joint)
    both, alone = np.flatnonzero(used[0] & used[1]), used[1] & ~used[0]
    x[alone], p[alone] = _state(back)[alone], p_back[alone]
    total = p[both] + p_back[both]
    off = x[both] - _state(back)[both]
    gain = np.linalg.solve(total, p[both]).swapaxes(1, 2)  # P_f S^-1, both symmetric
    x[both] -= np.einsum("nij,nj->ni", gain, off)
    p[both] -= gain @ p[both]
    grown = _disagreement(off, total, float(np.median(np.diff(log.seconds))))
    p[both] = grown[:, :, None] * 0.5 * (p[both] + p[both].swapaxes(1, 2)) * grown[:, None, :]
    p[:, :3, :3] += ahead.p[:, :3, :3] - _whole(ahead.joint)[:, :3, :3]  # of hidden slopes, alike both ways
    g = x[:, :3] * (GRAVITY / np.maximum(np.linalg.norm(x[:, :3], axis=1, keepdims=True), 1e-9))
    out = replace(
        ahead, g=g, v=x[:, 3:6], gyro_bias=x[:, 6:9], acc_bias=x[:, 9:], p=p[:, :6, :6], joint=p, pose=None,
        flags=_flags(ahead, back, good), slipping=_mean(ahead.slipping, back.slipping, used),
    )  # fmt: skip
    return _with_path(log, out, ahead, back, used)


def _disagreement(off: Array, total: Array, period: float) -> Array:
    """Return the factors, (k, 12), >= 1, on the standard deviations of (g, v, gyro bias, accelerometer bias).

    `off`: differences of forward and backward pass, (k, 12); `total`: their covariances, (k, 12, 12); `period`: time
    between two rows, s.
    """
    out = np.ones_like(off)
    rows = max(1, round(AGREED_S / period))
    for part, freedom in BLOCKS:
        d = off[:, part]
        chi = np.einsum("ni,ni->n", d, np.linalg.solve(total[:, part, part], d[..., None])[..., 0])
        if len(chi):
            chi = uniform_filter1d(chi, rows, mode="nearest")
        out[:, part] = np.sqrt(np.maximum(chi / freedom, 1.0))[:, None]
    return out


def _flags(ahead: Track, back: Track, good: list[Flags]) -> dict[str, Flags]:
    """Return the flags of both passes as one: one is enough for `initialised` and `filter_ok`, the others need both.

    `good`: rows of each pass that has started and whose filter is sound, (n,).
    """
    a, b = ahead.flags, back.flags
    out = {flag: np.where(a["initialised"], a[flag], b[flag]) for flag in FLAGS}
    started = a["initialised"] & b["initialised"]
    for flag in ("inputs_ok", "sensors_ok"):
        out[flag] = np.where(started, a[flag] & b[flag], out[flag])
    out["initialised"], out["filter_ok"] = a["initialised"] | b["initialised"], good[0] | good[1]
    return out


def _mean(one: Array | None, other: Array | None, used: list[Flags]) -> Array | None:
    """Return the mean probability of sliding (n, F) of two passes where in use; NaN where neither has a standing foot.

    `one`, `other`: probabilities of each pass, (n, F), NaN = the foot does not stand; `used`: its rows in use, (n,).
    """
    if one is None or other is None:
        return one
    both = np.stack([np.where(use[:, None], values, np.nan) for use, values in zip(used, (one, other), strict=True)])
    count = np.isfinite(both).sum(axis=0)
    return np.where(count > 0, np.nansum(both, axis=0) / np.maximum(count, 1), np.nan)


def _with_path(log: Log, out: Track, ahead: Track, back: Track, used: list[Flags]) -> Track:
    """Return a track with heading, position and velocity in odom by its fused velocity and attitude.

    `out`: fused track; `ahead`, `back`: its passes; `used`: rows of each that are in use, (n,).
    """
    first = int(np.argmax(used[0])) if used[0].any() else 0
    yaw = np.concatenate([[0.0], np.cumsum(_turns(ahead, back, used))])
    yaw += ahead.yaw[first] - yaw[first]
    base = base_rot(log, replace(out, yaw=yaw), slice(None))
    rot = base @ log.rot_base_from_imu
    d = np.diff(log.seconds)[:, None]
    v = np.einsum("nij,nj->ni", rot, out.v)
    steps = 0.5 * d * (v[1:] + v[:-1]) - np.diff(base @ log.imu_position, axis=0)
    gap = _gap(steps, ahead, yaw, used[0], LASTING_S / float(np.median(d)))
    position = np.vstack([np.zeros(3), np.cumsum(steps, axis=0)]) + gap  # base_link
    position += ahead.position[first] - position[first]
    if len(gap) > 1:  # so that the integral of the velocity is the path
        v = v + np.diff(gap, axis=0, append=gap[-1:]) / np.append(d, d[-1:], axis=0).clip(1e-9)
    w = np.nan_to_num(log.w) - _whole(out.gyro_bias)
    v_odom = v - np.einsum("nij,nj->ni", rot, np.cross(w, log.rot_base_from_imu.T @ log.imu_position))
    return replace(out, v=np.einsum("nji,nj->ni", rot, v), yaw=yaw, position=position, v_odom=v_odom)


def _gap(steps: Array, ahead: Track, yaw: Array, used: Flags, rows: float) -> Array:
    """Return the low-pass difference of forward path and integral of the fused velocity at each row, (n, 3) m.

    The forward pass corrects its position with each foot, so that errors that come with every stride cancel; changes
    over more than 2 s are taken from it.

    Args:
        steps: of the integral from row to row, (n - 1, 3) m.
        ahead: the forward pass.
        yaw: fused heading, (n,) rad.
        used: rows of the forward pass in use, (n,).
        rows: standard deviation of the window, inertial rows.
    """
    turn = yaw[:-1] - ahead.yaw[:-1]
    c, s, (x, y, z) = np.cos(turn), np.sin(turn), np.diff(ahead.position, axis=0).T
    own = np.stack([c * x - s * y, s * x + c * y, z], axis=1)
    more = np.where((used[1:] & used[:-1])[:, None], own - steps, 0.0)
    return gaussian_filter1d(np.vstack([np.zeros(3), np.cumsum(more, axis=0)]), rows, axis=0, mode="nearest")


def _turns(ahead: Track, back: Track, used: list[Flags]) -> Array:
    """Return the fused change of heading from row to row, (n - 1,) rad, weighted by the gyro biases' variances.

    `used`: rows of each pass that are in use, (n,).
    """
    seen: list[Array] = []
    weights: list[Array] = []
    for one, use in zip((ahead, back), used, strict=True):
        up = one.g / GRAVITY
        variance = np.einsum("ni,nij,nj->n", up, _whole(one.joint)[:, 6:9, 6:9], up)
        weight = use / np.maximum(variance, 1e-12)
        seen.append(np.diff(one.yaw))
        weights.append(np.minimum(weight[1:], weight[:-1]))
    total = weights[0] + weights[1]
    mean = (weights[0] * seen[0] + weights[1] * seen[1]) / np.maximum(total, 1e-12)
    return np.where(total > 0.0, mean, 0.0)
