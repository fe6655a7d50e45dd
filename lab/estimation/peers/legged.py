"""Legged estimators of GTSAM (from 4.3, optional) as referees, with the noise of GTSAM's own staircase example.

A referee is an estimator of others, with which ours is compared. There are four: an invariant filter, one that is
iterated over a graph, fixed-lag smoothers with one bias and with a bias that walks. They take points at the contacts;
their filters do not estimate a bias, the mean gyro of a rest is given to them.
"""

import importlib.util
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from surefoot.arrays import Array
from surefoot.errors import SurefootError
from surefoot.geometry.constants import GRAVITY

from ..log import Log, Segments, segments
from .inekf import PeerTrack, at_rest, new_track, skew, upright

KINDS = {
    "gtsam_iekf": "LeggedInvariantEKF", "gtsam_graph": "LeggedInvariantIEKF", "gtsam_lag": "LeggedFixedLagSmoother",
    "gtsam_combined": "LeggedCombinedFixedLagSmoother",
}  # fmt: skip
"""Name of the GTSAM class of each referee (estimator that ours is compared with), by name of the referee."""
SMOOTHERS = ("gtsam_lag", "gtsam_combined")
"""Names of the referees that are fixed-lag smoothers; the covariance of their estimates is NaN."""
LAG_S = 1.0
EVERY_NS, LEAST_NS = 50_000_000, 10_000_000
"""`EVERY_NS`: shortest time between two foot samples that a smoother uses, ns; `LEAST_NS`: shortest time if a foot has
landed or lifted, ns: with steps of 1 ms the smoother's equations are indeterminate."""


class LeggedNoise(NamedTuple):
    """Standard deviations of the staircase example of GTSAM 4.3."""

    gyro: float = 8e-4  # rad/s/sqrt(Hz)
    acc: float = 2e-2  # m/s^2/sqrt(Hz)
    integration: float = 1e-3  # m/sqrt(s)
    across: float = 0.03  # m, of a foot along x and y
    along: float = 0.02  # m, of a foot along z
    foothold: float = 1e-4  # m/sqrt(s), walk of a foothold
    new_foothold: float = 0.5  # m
    tilt: float = 0.1  # rad, at the start
    speed: float = 0.22  # m/s, at the start; likewise m of the place
    walk_acc: float = 5e-3  # m/s^2/sqrt(s)
    walk_gyro: float = 1e-4  # rad/s/sqrt(s)


def installed() -> bool:
    """Return True if the wheel of GTSAM is installed."""
    return importlib.util.find_spec("gtsam") is not None


def _estimator(kind: str, feet: int, rot: Array, bias: Array, noise: LeggedNoise) -> Any:
    import gtsam  # pyright: ignore[reportMissingImports] - optional

    if not hasattr(gtsam, KINDS[kind]):
        raise SurefootError("invalid", f"{kind} needs gtsam 4.3 or later", "estimator")
    imu = gtsam.PreintegrationParams.MakeSharedU(GRAVITY)
    imu.setGyroscopeCovariance(np.eye(3) * noise.gyro**2)
    imu.setAccelerometerCovariance(np.eye(3) * noise.acc**2)
    imu.setIntegrationCovariance(np.eye(3) * noise.integration**2)
    params = gtsam.LeggedEstimatorParams()
    params.preintegrationParams, params.body_P_imu = imu, gtsam.Pose3()
    params.footholdProcessSigma, params.footholdInitSigma = noise.foothold, noise.new_foothold
    params.contactCovariance = np.diag(np.array([noise.across, noise.across, noise.along]) ** 2)
    params.imuBias = gtsam.imuBias.ConstantBias(np.zeros(3), bias)
    params.biasAccRandomWalkSigma, params.biasOmegaRandomWalkSigma = noise.walk_acc, noise.walk_gyro
    params.useFullContactInitialization, params.marginalizeLeavingFoot = False, True
    state = gtsam.NavState(gtsam.Rot3(rot), np.zeros(3), np.zeros(3))
    names, places = [f"foot{f}" for f in range(feet)], np.zeros((3, feet))
    start = np.array([noise.tilt, noise.tilt, 1e-3, *[noise.speed] * 6]) ** 2
    make = getattr(gtsam, KINDS[kind])
    if kind in SMOOTHERS:
        return make(state, places, np.diag(start), params, LAG_S, names)
    return make(state, places, np.diag([*start, *[noise.new_foothold**2] * (3 * feet)]), params, names)


def _contacts(seen: Array, touch: NDArray[np.bool_], before: NDArray[np.bool_]) -> list[Any]:
    import gtsam  # pyright: ignore[reportMissingImports] - optional

    out: list[Any] = []
    for f in np.flatnonzero(touch):
        one = gtsam.ContactMeasurement()
        one.foot, one.bodyPoint, one.touchdown = int(f), seen[f], not before[f]
        out.append(one)
    return out


def legged(kind: str, log: Log, noise: LeggedNoise) -> PeerTrack:
    """Return the track of a log by one of the legged estimators of GTSAM; the covariance of smoothers is NaN.

    The covariance of a filter is that of (turn, place, velocity) in IMU axes, X = X_hat exp(xi): errors of g (specific
    force at rest) and v (velocity) in IMU axes are [g] turn and velocity + [v] turn.

    Args:
        kind: gtsam_iekf, gtsam_graph (filters), gtsam_lag or gtsam_combined (smoothers).
        log: what to run over.
        noise: standard deviations.

    Raises:
        SurefootError: the wheel has no such estimator, or it failed on this log.
    """
    cut, out = segments(log), new_track(len(log.stamp_ns))
    bias, q, begin = at_rest(log)
    start = int(np.searchsorted(cut.row, begin))
    running = _estimator(kind, log.feet_count, upright(q), np.zeros(3) if bias is None else bias, noise)
    try:
        _walk(kind, log, cut, start, running, out)
    except RuntimeError as error:
        text = str(error).strip().partition("\n")[0]
        raise SurefootError("invalid", f"{kind} failed on {log.name}: {text}", "estimator") from None
    return out


def _walk(kind: str, log: Log, cut: Segments, start: int, running: Any, out: PeerTrack) -> None:
    """Run a GTSAM estimator along a log, and write its estimates to a track, in place.

    `cut`: time of the log, cut at every sample; `start`: first segment to run; `running`: the estimator.
    """
    before, taken = np.zeros(log.feet_count, dtype=np.bool_), int(log.stamp_ns[0])
    for s in range(len(cut.d)):
        k, j = int(cut.row[s]), int(cut.feet[s])
        if s >= start:
            running.predict(log.w[k], log.q[k], float(cut.d[s]))
            if j >= 0:
                seen, now = log.foot_position[j], int(log.foot_ns[j])
                touch = log.contact[j] & np.isfinite(seen).all(axis=1)
                wait = EVERY_NS if (touch == before).all() else LEAST_NS
                if kind not in SMOOTHERS or now - taken >= wait:
                    if touch.any():
                        running.processContacts(_contacts(seen, touch, before))
                    before, taken = touch, now
        if cut.last[s]:
            _write(running, kind, k, out)


def _write(running: Any, kind: str, k: int, out: PeerTrack) -> None:
    """Write the present estimate to row k of a track, in place."""
    now = running.estimate()
    rot = np.asarray(now.rotation().matrix())
    out.rot[k], out.x[k], out.v[k], out.g[k] = rot, now.x(0), rot.T @ now.x(1), GRAVITY * rot[2]
    if kind in SMOOTHERS:
        out.p[k] = np.nan
        return
    m = np.zeros((6, 9))
    m[:3, :3], m[3:, :3], m[3:, 6:] = skew(out.g[k]), skew(out.v[k]), np.eye(3)
    out.p[k] = m @ running.covariance()[:9, :9] @ m.T
