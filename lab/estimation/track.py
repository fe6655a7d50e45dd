"""Tracks (estimates at each inertial row) over logs, of the estimators of the service and of referees.

Referees are estimators of others, for comparison. Only `LogRunner` feeds the estimator of the service.
"""

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from surefoot.arguments import choice
from surefoot.arrays import Array, Flags, Ints
from surefoot.services.estimator.feet.contact import (
    LEVER,
    SOLE_POINTS,
    at_switches,
    contact_points,
    line_feet,
    sole_feet,
)
from surefoot.services.estimator.feet.mount import FootMount
from surefoot.services.estimator.filter.best import ExternalUse
from surefoot.services.estimator.filter.log import FLAGS, NAMED, LogInputs, LogRows
from surefoot.services.estimator.output import OdometryPose, VelocityAndTilt
from surefoot.services.estimator.params import EstimatorParams
from surefoot.services.estimator.stream import BEST, NAMES, PAPER, Estimator

from .log import Log
from .peers.inekf import InekfNoise, PeerTrack, inekf
from .peers.linear import LinearNoise, linear

LINE_POINTS = 2  # ends of a foot that touches the ground along a line
LEVEL_SD = 0.003  # rad, how level the ground at the start of a simulated walk is: what the service assumes


@dataclass(frozen=True, eq=False)
class Track:
    """Estimates of velocity, tilt and path at the n inertial rows of a log; a refused row repeats the one before it."""

    name: str
    v: Array  # (n, 3) m/s, IMU in IMU axes
    g: Array  # (n, 3) m/s^2, specific force at rest, IMU axes, points up
    p: Array  # (n, 6, 6) covariance of (g, v)
    position: Array  # (n, 3) m, base_link in odom
    yaw: Array  # (n,) rad, heading in odom, not wrapped
    v_odom: Array  # (n, 3) m/s, base_link, odom axes
    flags: Mapping[str, Flags]  # name -> (n,)
    nis: Array  # (n,) of the last correction, NaN = none
    refused: Mapping[str, int]  # refusals and gaps by name
    slipping: Array | None = None  # (n, F) share or probability of sliding
    contact: Array | None = None  # (n, F) probability of contact, where it is estimated
    gyro_bias: Array | None = None  # (n, 3) rad/s
    acc_bias: Array | None = None  # (n, 3) m/s^2
    joint: Array | None = None  # (n, 12, 12) covariance of g, v, gyro and accelerometer bias, IMU axes, if wanted
    pose: Array | None = None  # (n, 6, 6) covariance of x, y, z and the rotation about x, y, z, odom axes
    externals: ExternalUse | None = None  # what has become of samples from elsewhere
    named: Mapping[str, Ints] | None = None  # `NAMED` -> (n,) sensors that are wrong, of `best`


def track(name: str, log: Log, **options: Any) -> Track:
    """Return the track of one estimator over a log, whose inputs are taken in the order of arrival.

    Args:
        name: an estimator of the service or a referee (`PEERS`).
        log: what to run over.
        options: options by name. Of a service estimator: changes of its parameters, `hypotheses` = False, `joint` =
            True for `best`; of a referee: changes of its noise.

    Raises:
        SurefootError: there is no such estimator.
    """
    return next(follow(name, log, **options))[1]


def names() -> tuple[str, ...]:
    """Return the names of the estimators of the service, then those of the referees they are compared with."""
    return (*NAMES, *PEERS)


def check_name(name: str) -> None:
    """Check the name of an estimator.

    Raises:
        SurefootError: no estimator has this name; the text lists the names.
    """
    choice(name, "estimator", names())


def default() -> str:
    """Return the name of the default estimator."""
    return BEST


class LogRunner:
    """Runner of an estimator of the service, which feeds it with the inputs of a log."""

    def __init__(self, name: str, log: Log, options: Mapping[str, Any]) -> None:
        self.name, self.feet_count = name, log.feet_count
        changes = {**log.sensors, **options}
        hypotheses, self.joint = bool(changes.pop("hypotheses", True)), bool(changes.pop("joint", False))
        if log.robot is not None:
            params = EstimatorParams.from_robot(log.robot, start_slope_sd=LEVEL_SD)
            points = contact_points(log.robot)
        else:
            params, points = EstimatorParams(), None
            if log.points is not None and log.points.shape[1] == LINE_POINTS:
                points = line_feet(log.points)
            elif log.points is not None and log.points.shape[1] >= SOLE_POINTS:
                normals = np.cross(log.points[:, 1] - log.points[:, 0], log.points[:, 2] - log.points[:, 0])
                normals *= np.where(normals[:, 2:] < 0.0, -1.0, 1.0) / np.linalg.norm(normals, axis=1, keepdims=True)
                reach = np.linalg.norm(log.foot_position, axis=-1)
                reach = reach[np.isfinite(reach)]
                points = sole_feet(normals, LEVER * float(np.median(reach)) if reach.size else 0.0, log.points)
        params = replace(params, **changes)
        if name == PAPER:
            # without the mean gyro of the rest a turn-on bias of 1 deg/s swamps it; the paper does not mention one
            params = replace(params, **({"remove_gyro_bias": True, "refine_gyro_bias": True} | changes))
        radius = np.zeros(log.feet_count) if log.radius is None else log.radius
        mount = FootMount(None, np.ascontiguousarray(log.rot_base_from_imu.T), log.imu_position, radius)
        self._estimator = Estimator(
            mount, params, names=(name,),
            points=points if params.soles else None, hypotheses=hypotheses,
        )  # fmt: skip

    def imu(self, stamp_ns: int, w: Array, q: Array, clipped: bool = False) -> None:
        """Feed an inertial sample: gyro w (3,) rad/s, accelerometer q (3,) m/s^2, IMU axes; `clipped`: at its limit."""
        self._estimator.imu(stamp_ns, w, q, clipped)

    def feet(self, stamp_ns: int, position: Array, rot: Array, contact: Flags | Array) -> None:
        """Feed a foot sample.

        Args:
            stamp_ns: time of the sample, ns.
            position: foot centres, (F, 3) m, IMU axes.
            rot: rotation from each foot to the IMU, (F, 3, 3).
            contact: flag or probability of each foot, (F,), or at each of its S switches, (F, S).
        """
        self._estimator.feet(stamp_ns, position, rot, contact)

    def estimate(self) -> VelocityAndTilt:
        """Return the estimate after the last sample that was fed."""
        return self._estimator.estimate(self.name)

    def pose(self) -> OdometryPose:
        """Return the odometry after the last sample that was fed."""
        return self._estimator.pose()

    def whole(self, log: Log, part: Ints, first: int, n: int) -> LogRows:
        """Feed inputs of a log to the filter `best` in one compiled loop; return n estimates from row `first` on.

        `part`: inputs in the order of arrival, (k,): index of an inertial row, or number of all rows + index of a foot
        sample.
        """
        clipped = np.zeros(len(log.stamp_ns), dtype=np.bool_) if log.saturated is None else log.saturated
        inputs = LogInputs(
            np.ascontiguousarray(log.stamp_ns), np.ascontiguousarray(log.w), np.ascontiguousarray(log.q), clipped,
            np.ascontiguousarray(log.foot_ns), np.ascontiguousarray(log.foot_position),
            np.ascontiguousarray(log.foot_rot), at_switches(log.switches.astype(np.float64), self._estimator.switches),
        )  # fmt: skip
        if log.external is not None:
            inputs = inputs._replace(external_ns=log.external.stamp_ns, external=log.external.rows)
        return self._estimator.follow(inputs, part, first, n, self.joint)

    @property
    def externals(self) -> ExternalUse:
        """Counts of the samples of other sources, such as a camera, and the turn of their frame against odom."""
        return self._estimator.externals

    @property
    def refused(self) -> dict[str, int]:
        """Number of refused inputs and of gaps so far, by name of the reason."""
        return dict(self._estimator.check.counts)

    @property
    def refusals(self) -> int:
        """Number of inputs refused so far."""
        return self._estimator.check.refused


def follow(name: str, log: Log, rows_each: int | None = None, **options: Any) -> Iterator[tuple[slice, Track]]:
    """Run an estimator over a log, and yield its track piece by piece; a referee runs in one piece.

    Args:
        name: name of the estimator or referee.
        log: what to run over. In pieces only if its inertial rows arrive in their order.
        rows_each: inertial rows of a piece; None = all in one.
        options: options of the estimator by name, as of `track`.

    Yields:
        The rows, and the track over them; `refused` counts from the beginning.

    Raises:
        SurefootError: there is no such estimator.
    """
    check_name(name)
    if name != BEST:
        log = replace(log, external=None)  # of `best` alone
    if name in PEERS:
        yield slice(0, len(log.stamp_ns)), PEERS[name](log, options)
        return
    running = LogRunner(name, log, options)
    n, arrival, at = len(log.stamp_ns), log.arrival(), np.zeros(4)
    cuts = np.flatnonzero(arrival < n)[rows_each::rows_each] if rows_each else []
    for part in np.split(arrival, cuts):
        rows = part[part < n]
        if len(rows) == 0:
            continue
        first, end = int(rows.min()), int(rows.max()) + 1
        if name == BEST:
            yield slice(first, end), _whole(running, name, log, part, first, end - first)
        else:
            at, track = _reckoned(log, first, at, _piece(running, name, log, part, first, end - first))
            yield slice(first, end), track


def _whole(running: LogRunner, name: str, log: Log, part: Ints, first: int, n: int) -> Track:
    """Return the track of n estimates from inertial row `first` on, computed in one compiled loop.

    `part`: inputs in the order of arrival, (k,): index of an inertial row, or number of all rows + index of a foot
    sample.
    """
    rows = running.whole(log, part, first, n)
    nis = np.ascontiguousarray(rows.vectors[:, 7, 0])
    g, v, position, v_odom, gyro_bias, acc_bias = (np.ascontiguousarray(rows.vectors[:, i]) for i in range(6))
    flags = {flag: np.ascontiguousarray(rows.flags[:, i]) for i, flag in enumerate(FLAGS)}
    return Track(
        name, v, g, rows.covariance, position, rows.yaw, v_odom, flags, nis, running.refused, rows.more[:, 4:],
        None, gyro_bias, acc_bias, rows.joint if running.joint else None, rows.pose,
        None if log.external is None else running.externals, dict(zip(NAMED, rows.named.T, strict=True)),
    )  # fmt: skip


def _piece(running: LogRunner, name: str, log: Log, part: Ints, first: int, n: int) -> Track:
    """Feed inputs in the given order, one by one; return the track over `n` inertial rows from `first` on.

    Its yaw is the rate of heading, rad/s, and `v_odom` the velocity in heading axes, still to be integrated. `part`:
    inputs in the order of arrival, (k,): index of an inertial row, or number of all rows + index of a foot sample.
    """
    feet, rows = log.feet_count, len(log.stamp_ns)
    v, g, p, nis = np.zeros((n, 3)), np.zeros((n, 3)), np.zeros((n, 6, 6)), np.full(n, np.nan)
    yaw, v_odom = np.zeros(n), np.zeros((n, 3))
    flags = {flag: np.zeros(n, dtype=np.bool_) for flag in FLAGS}
    slipping, gyro_bias, acc_bias = np.zeros((n, feet)), np.zeros((n, 3)), np.zeros((n, 3))
    to_imu, clipped, row, switches = log.rot_base_from_imu.T, log.saturated, -1, log.switches

    def note(k: int) -> None:
        e = running.estimate()
        v[k], g[k], p[k], v_odom[k] = e.velocity_imu, to_imu @ e.g_up, e.covariance, e.velocity_heading
        _, side, up = e.angular_velocity
        yaw[k] = (math.sin(e.roll) * side + math.cos(e.roll) * up) / max(math.cos(e.pitch), 0.1)
        nis[k] = np.nan if e.nis is None else e.nis
        slipping[k], gyro_bias[k], acc_bias[k] = e.sliding, e.gyro_bias, e.acc_bias
        for flag in FLAGS:
            flags[flag][k] = getattr(e, flag)

    order = part.tolist()
    for i, at in enumerate(order):
        if at < rows:
            running.imu(int(log.stamp_ns[at]), log.w[at], log.q[at], clipped is not None and bool(clipped[at]))
            row = at - first
        else:
            f = at - rows
            running.feet(int(log.foot_ns[f]), log.foot_position[f], log.foot_rot[f], switches[f])
        if row >= 0 and (i + 1 == len(order) or order[i + 1] < rows):
            note(row)
    return Track(
        name, v, g, p, np.zeros((n, 3)), yaw, v_odom, flags, nis, running.refused, slipping, None, gyro_bias, acc_bias
    )


def _reckoned(log: Log, first: int, at: Array, found: Track) -> tuple[Array, Track]:
    """Return a track whose heading and position are integrals of its rates, for an estimator without odometry.

    Args:
        log: what the track is over.
        first: inertial row at which the track begins.
        at: x, y, z, m, and heading, rad, at the row before it, (4,).
        found: track whose yaw holds the rate of heading, rad/s, and `v_odom` the velocity in heading axes.

    Returns:
        x, y, z and heading at the last row, (4,), and the track with position, heading and velocity in odom axes.
    """
    rows = slice(first, first + len(found.v))
    d = 1e-9 * np.diff(log.stamp_ns[rows], prepend=log.stamp_ns[max(first - 1, 0)])
    yaw = np.cumsum(np.append(at[3], found.yaw * d))[1:]
    c, s, (ahead, left, up) = np.cos(yaw), np.sin(yaw), found.v_odom.T
    v_odom = np.stack([c * ahead - s * left, s * ahead + c * left, up], axis=1)
    position = np.cumsum(np.vstack([at[:3], v_odom * d[:, None]]), axis=0)[1:]
    return np.append(position[-1], yaw[-1]), replace(found, position=position, yaw=yaw, v_odom=v_odom)


def of_world(name: str, log: Log, found: PeerTrack) -> Track:
    """Return the result of a referee, which has poses of the IMU in the world, as a track.

    A referee is an estimator of others, for comparison. `name`: of the referee; `log`: the log that it ran over.
    """
    v, g, p, x, rot = found
    n = len(v)
    base = np.einsum("nij,kj->nik", rot, log.rot_base_from_imu)
    yaw = np.unwrap(np.arctan2(base[:, 1, 0], base[:, 0, 0]))
    position = x - np.einsum("nij,j->ni", base, log.imu_position)
    w = np.einsum("ij,nj->ni", log.rot_base_from_imu, log.w)
    v_odom = np.einsum("nij,nj->ni", rot, v) - np.einsum("nij,nj->ni", base, np.cross(w, log.imu_position))
    flags = {flag: np.ones(n, dtype=np.bool_) for flag in FLAGS}
    return Track(name, v, g, p, position, yaw, v_odom, flags, np.full(n, np.nan), {})


def _inekf(log: Log, options: Mapping[str, Any]) -> Track:
    return of_world("inekf", log, inekf(log, InekfNoise(**options)))


def _linear(log: Log, options: Mapping[str, Any]) -> Track:
    return of_world("linear", log, linear(log, LinearNoise(**options)))


PEERS: dict[str, Callable[[Log, Mapping[str, Any]], Track]] = {"inekf": _inekf, "linear": _linear}
"""Functions (log, options) -> track of the referees, estimators to compare with, by name: contact-aided invariant EKF,
linear Kalman filter as in MIT's Cheetah-Software."""

ABLATIONS: dict[str, dict[str, dict[str, Any]]] = {
    "best": {
        "slip hypothesis": {"hypotheses": False},
        "points of a sole": {"soles": False},
        "levels of the ground": {"levels": False},
    }
}
"""Estimator options that switch off one hypothesis each, by name of the estimator and of the hypothesis."""
