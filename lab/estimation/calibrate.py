"""Calibration of a log by itself: legs, joint zeros, foot radius, time offset and mounting of the inertial unit.

Batch least squares over standing feet (`stances`), with a normal prior on each parameter. A parameter is observable in
a log if its interval of 95 % is clearly narrower than what the prior allows.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from surefoot.arrays import Array
from surefoot.geometry.linear_kernels import times_transposed
from surefoot.geometry.rotations import matrix_from_rotvec, rotvec_from_matrix
from surefoot.kernels.jit import kernel

from ..statistics import Z95
from .legs import RESIZING, SHOWN, LegModel, Unknown, lengths_alike, unknowns_of
from .log import Log
from .stances import WINDOWS, InertialPath, StanceNoise, find_noise, stance_windows, stances, with_inflation

FEWEST_WINDOWS = 2
"""Number of time windows of a log below which no parameter is observable: their spread gives the interval."""
WIDER = {"length": 1.6, "offset": 2.0, "mounting": 3.0, "lever": 3.0}
"""Factor on the 95 % interval by kind of parameter, default: 1; it covers the bias of feet that rock, roll or creep at
each step."""
ALWAYS = {"offset": 0.003}
"""Smallest half width of the 95 % interval by kind of parameter (`offset`: time offset, s), since feet yield under
load."""
NARROW = 0.4
"""Half width of a parameter's 95 % interval over that of its prior, above which the parameter is not observable."""
ROUNDS = 5
"""Number of iterations of the nonlinear least squares; the noise is estimated again before each."""
BIASES_FIRST = 2
"""Number of first iterations that estimate only the IMU's biases, since a wrong bias looks like foot noise."""
EPSILON = 1e-3
"""Step of the numerical derivatives, and shift allowed to a fixed unknown, both in standard deviations of its prior."""
TINY = 1e-9
"""Smallest variance of a score (gradient of the log-likelihood); keeps its inverse finite."""
UNSURE = 0.3
"""Standard deviation of the correction for the bias that foot noise causes, as a share of that correction."""
NOTE_ROWS, NOTE_WINDOWS, NOTED_MS = 100_000, 12, 5.0
"""`NOTE_ROWS`: most inertial rows, and `NOTE_WINDOWS`: most time windows, of the short check of the feet's time offset;
`NOTED_MS`: offset less the half width of its interval, ms, above which a note reports it."""
ALIKE = 0.1
"""Correlation coefficient assumed between the errors of two time windows of a walk."""
USUAL_NOISE = {"sigma_q": 0.1, "sigma_w": 0.01}
"""Default noise of an inertial row, standard deviation: `sigma_q` of the accelerometer, m/s^2; `sigma_w` of the
gyro, rad/s."""


@dataclass(frozen=True)
class CalibratedValue:
    """Parameter that calibration found from a log, with the half width of its 95 % interval."""

    name: str
    unit: str
    value: float
    half: float  # of the interval of 95 %
    observable: bool  # its interval is clearly narrower than the range of the prior, and lies there

    @property
    def proven(self) -> bool:
        """True if the log shows that the parameter differs from what the log or the robot file states."""
        return self.observable and abs(self.value) > self.half


@dataclass(frozen=True, eq=False)
class LegCalibration:
    """Result of the calibration of a log: values theta of the unknowns by least squares, with their covariance."""

    log: Log
    unknowns: Sequence[Unknown]
    theta: Array  # (k,)
    covariance: Array  # (k, k)
    noise: StanceNoise | None  # None: nothing stands long enough
    windows: int

    def found(self) -> list[CalibratedValue]:
        """Return the parameters in the units of reports, without those of the sensors' biases."""
        return [one for _, one in self.pairs()]

    def pairs(self) -> list[tuple[Unknown, CalibratedValue]]:
        """Return each unknown with its value in the unit of reports, without those of the sensors' biases."""
        out: list[tuple[Unknown, CalibratedValue]] = []
        for u, value, sd in zip(self.unknowns, self.theta, np.sqrt(np.diag(self.covariance)), strict=True):
            if u.kind in SHOWN:
                factor, unit = SHOWN[u.kind]
                half = float(np.hypot(Z95 * WIDER.get(u.kind, 1.0) * sd, ALWAYS.get(u.kind, 0.0)))
                seen = half < NARROW * u.range and abs(float(value)) <= u.range and self.windows >= FEWEST_WINDOWS
                out.append((u, CalibratedValue(u.name, unit, factor * float(value), factor * half, seen)))
        return out

    def apply(self, log: Log | None = None) -> Log:
        """Return a log with corrected feet, foot stamps and mounting, without joints, which fit only uncorrected legs.

        Args:
            log: another log of the same robot; None = the log of the calibration.
        """
        log = self.log if log is None else log
        model = LegModel(log, self.unknowns)
        position, rot = model.feet(self.theta, np.arange(len(log.foot_ns)))
        turn = matrix_from_rotvec(model.values(self.theta, "mounting", 3))
        lever = model.values(self.theta, "lever", 3)
        shift = round(1e9 * float(model.values(self.theta, "offset", 1)[0]))
        base = log.rot_base_from_imu @ turn.T
        radius = model.values(self.theta, "radius", 1)
        return replace(
            log, foot_ns=log.foot_ns + shift, foot_position=position, foot_rot=rot, rot_base_from_imu=base,
            imu_position=log.imu_position - base @ lever, order=None, joints=None,
            radius=None if log.radius is None else np.where(log.radius > 0.0, log.radius + radius, 0.0),
        )  # fmt: skip


class StanceProblem:
    """Least-squares problem of calibration: places of standing feet as functions of the unknowns theta of a log.

    Args:
        log: log with feet.
        unknowns: parameters, in the order of theta.
        windows: most windows of the log that are used.
    """

    def __init__(self, log: Log, unknowns: Sequence[Unknown], windows: int = WINDOWS) -> None:
        self.log, self.unknowns, self.windows = log, unknowns, stance_windows(log, windows)
        self._model = LegModel(log, unknowns)
        self._path: tuple[tuple[float, ...], InertialPath] | None = None  # the last one, and its biases
        self._rows = np.unique(np.concatenate([np.zeros(0, dtype=np.int64), *(w.sample for w in self.windows)]))
        self._radius = np.zeros(log.feet_count) if log.radius is None else log.radius
        self._parts = [np.searchsorted(self._rows, w.sample) for w in self.windows]

    @property
    def repeats(self) -> float:
        """Number of windows per statistically independent window: a foot's errors repeat from step to step."""
        count, numbers = len(self.windows), self._numbers
        each = len(np.unique(numbers[numbers >= 0])) / self.log.feet_count  # stances of a foot
        return max(1.0 + ALIKE * (count - 1), count / max(each, 1.0))

    @cached_property
    def _numbers(self) -> NDArray[np.int64]:
        return stances(self.log)[self._rows]

    def residuals(self, theta: Array) -> list[Array]:
        """Return the places R f + p of the standing feet in each window, averaged over blocks, (N, 3) m each.

        R and p are attitude and place of the IMU by its own samples in a frame that falls and does not turn, f is the
        foot in IMU axes; the rolling of round feet is subtracted. `theta`: value of each unknown, (P,), in its unit.
        """
        model, log = self._model, self.log
        path = self._integrated(model.values(theta, "gyro bias", 3), model.values(theta, "acc bias", 3))
        t = 1e-9 * (log.foot_ns[self._rows] - log.stamp_ns[0]) + model.values(theta, "offset", 1)[0]
        turned, at = path.at(t)
        feet, rot = model.feet(theta, self._rows)
        pivot = model.values(theta, "pivot", 3 * log.feet_count).reshape(-1, 3)
        seen = np.einsum("kij,kfj->kfi", turned, feet + np.einsum("kfij,fj->kfi", rot, pivot))
        radius = self._radius + (self._radius > 0.0) * model.values(theta, "radius", 1)
        if radius.any():
            seen -= radius[:, None] * self._rolled(turned, rot)
        out: list[Array] = []
        for window, part in zip(self.windows, self._parts, strict=True):
            fall = at[part] - at[part[0]]  # less digits are lost near zero
            out.append(window.averaged(seen[part, window.foot] + fall))
        return out

    def _integrated(self, gyro_bias: Array, acc_bias: Array) -> InertialPath:
        key = (*gyro_bias, *acc_bias)
        if self._path is None or self._path[0] != key:
            self._path = key, InertialPath.of(self.log, gyro_bias, acc_bias)
        return self._path[1]

    def noise_sizes(self, theta: Array) -> list[Array]:
        """Return the logarithm, up to a constant, of the size of the noise of the feet in each window, (N,) each.

        `theta`: value of each unknown, (P,), in its unit.
        """
        size = self._model.noise_size(theta, self._rows)
        return [w.averaged(size[part, w.foot]) for w, part in zip(self.windows, self._parts, strict=True)]

    def _rolled(self, turned: Array, rot: Array) -> Array:
        """Return the path of a rolling foot of unit radius from an arbitrary time, (k, F, 3), non-rotating frame.

        `turned`: rotation from IMU to that frame, (k, 3, 3); `rot`: from foot to IMU, (k, F, 3, 3).
        """
        world = np.ascontiguousarray(turned[:, None] @ rot)
        up = turned @ self.log.q[np.clip(np.searchsorted(self.log.stamp_ns, self.log.foot_ns[self._rows]), 0,
                                         len(self.log.q) - 1)][:, :, None]  # fmt: skip
        up = np.array([up[max(0, k - 10) : k + 10, :, 0].mean(axis=0) for k in range(len(up))])
        up /= np.linalg.norm(up, axis=1)[:, None]
        same = (self._numbers[1:] == self._numbers[:-1]) & (self._numbers[1:] >= 0)
        return np.cumsum(_rolling(world, up, same), axis=0)


@kernel
def _rolling(world: Array, up: Array, same: NDArray[np.bool_]) -> Array:
    """Return the displacement of rolling feet of unit radius since the row before, (k, F, 3), non-rotating frame.

    Args:
        world: rotation from each foot to that frame, (k, F, 3, 3).
        up: unit vectors that point up, (k, 3), frame.
        same: True for feet that stand from each row to the next, (k - 1, F).
    """
    step = np.zeros(world.shape[:3])
    for k in range(same.shape[0]):
        for f in range(same.shape[1]):
            if same[k, f]:
                turn = rotvec_from_matrix(times_transposed(world[k + 1, f], world[k, f]))
                for i in range(3):
                    j, m = (i + 1) % 3, (i + 2) % 3
                    step[k + 1, f, i] = turn[j] * up[k, m] - turn[m] * up[k, j]
    return step


def calibrate(log: Log, unknowns: Sequence[Unknown] | None = None, windows: int = WINDOWS) -> LegCalibration:
    """Return the calibration of a log: parameters of legs, mounting and time offset by least squares.

    Args:
        log: log with feet; a robot and joints make links and joints parameters of their own.
        unknowns: parameters to estimate; None = all that the log can have.
        windows: most windows of the log that are used.
    """
    unknowns = unknowns_of(log) if unknowns is None else unknowns
    problem = StanceProblem(log, unknowns, windows)
    sd = np.array([0.5 * u.range for u in unknowns])
    theta, covariance = np.zeros(len(unknowns)), np.diag(sd**2)
    if len(problem.windows) == 0:
        return LegCalibration(log, unknowns, theta, covariance, None, 0)
    period = 1e-9 * float(np.median(np.diff(log.stamp_ns)))
    acc, turn = (float(log.sensors.get(key, usual)) * period**0.5 for key, usual in USUAL_NOISE.items())
    noise = StanceNoise(1e-3, 1e-3, acc, turn)
    rests = np.array([u.kind in SHOWN for u in unknowns])
    for k in range(ROUNDS):
        at = problem.residuals(theta)
        noise = find_noise(problem.windows, at, noise, acc)
        problem.windows = with_inflation(problem.windows, at, noise)
        theta, covariance = _step(problem, theta, at, np.where(rests & (k < BIASES_FIRST), EPSILON * sd, sd), noise)
    return LegCalibration(log, unknowns, theta, covariance, noise, len(problem.windows))


def alike(found: LegCalibration) -> LegCalibration:
    """Return the calibration with one length for all legs if those of single legs agree with it, else unchanged."""
    lengths = [one for u, one in found.pairs() if u.kind == "length"]
    if len(lengths) < 2:
        return found
    together = calibrate(found.log, lengths_alike(found.unknowns))
    common = together.found()[0]
    same = all(abs(one.value - common.value) <= np.hypot(one.half, common.half) for one in lengths)
    return together if same else found


def proven(found: LegCalibration) -> LegCalibration:
    """Return the calibration with only those parameters that the log proves; others stay as log or robot file states.

    Mounting and lever that are not proven are left out first, for a description states them better than a short walk
    shows them. Then the least proven half of the rest is left out repeatedly, as parameters of similar effect hide each
    other.
    """
    found = alike(found)
    while True:
        unproven = {u: abs(one.value) / one.half for u, one in found.pairs() if not one.proven}
        if not unproven:
            return found
        sensor = [u for u in unproven if u.kind in ("mounting", "lever")]
        least = sensor or sorted(unproven, key=lambda u: unproven[u])[: -(-len(unproven) // 2)]
        found = calibrate(found.log, [u for u in found.unknowns if u not in least])


def offset_note(log: Log) -> tuple[str, ...]:
    """Return a note if the beginning of a log shows that the stamps of its feet are early or late, else ()."""
    bare = replace(log, joints=None)
    if len(log.stamp_ns) > NOTE_ROWS:
        feet = np.flatnonzero(log.foot_ns <= log.stamp_ns[NOTE_ROWS])
        bare = bare.with_imu(np.arange(NOTE_ROWS)).with_feet(feet)
    found = calibrate(bare, windows=NOTE_WINDOWS).found()
    for one in found:
        if one.unit == "ms" and one.observable and abs(one.value) - one.half > NOTED_MS:
            side = "early" if one.value > 0.0 else "late"
            text = f"the stamps of the feet are {abs(one.value):.0f} +- {one.half:.0f} ms too {side}"
            return (f"{text} against the inertial unit; --calibrate reports more, --calibrated corrects it",)
    return ()


def _step(problem: StanceProblem, theta: Array, at: list[Array], sd: Array, noise: StanceNoise) -> tuple[Array, Array]:
    """Return the solution of the problem linearised at theta (k,), and its covariance (k, k).

    A longer leg also makes the noise of its foot larger, which pulls lengths to short legs; what the noise adds to the
    scores (gradients of the log-likelihood) is subtracted.

    Args:
        problem: windows of standing feet.
        theta: value of each unknown, (k,), in its unit.
        at: residuals at theta, one (N, 3) m for each window.
        sd: standard deviations of the prior, (k,), in the units of theta.
        noise: of feet and IMU.
    """
    count = len(theta)
    tips = [theta + EPSILON * sd[i] * np.eye(count)[i] for i in range(count)]
    moved, size = [problem.residuals(x) for x in tips], problem.noise_sizes(theta)
    sizes = [
        problem.noise_sizes(x) if u.kind in RESIZING else size for u, x in zip(problem.unknowns, tips, strict=True)
    ]
    scores, hessians, grown = np.zeros((len(at), count)), np.zeros((len(at), count, count)), np.zeros((len(at), count))
    for k, window in enumerate(problem.windows):
        rows = window.whitener(noise)
        e = (rows @ at[k]).ravel()
        jac = np.stack([(rows @ (one[k] - at[k])).ravel() for one in moved], axis=1) / EPSILON
        weighted = rows.T @ (rows @ at[k])
        share = np.sum((window.foot_covariance(noise) @ weighted) * weighted, axis=1)
        grown[k] = np.array([share @ (one[k] - size[k]) for one in sizes]) / EPSILON
        hessians[k], scores[k] = jac.T @ jac, grown[k] - jac.T @ e
    hessian, pulled = hessians.sum(axis=0), UNSURE * grown.sum(axis=0)
    repeats = problem.repeats
    spread = repeats * hessian + np.outer(pulled, pulled) + TINY * np.eye(count)  # covariance of the scores
    weights = np.linalg.solve(spread, hessian).T
    posterior = np.linalg.inv(weights @ hessian + np.eye(count))
    gain = posterior @ weights
    step = gain @ scores.sum(axis=0) - posterior @ (theta / sd)
    left = scores - hessians @ step  # of the windows, at the solution
    left -= left.mean(axis=0)
    found = repeats * left.T @ left * len(at) / max(1, len(at) - 1) + np.outer(pulled, pulled)
    sandwich = gain @ found @ gain.T + posterior @ posterior
    wider = np.sqrt(np.maximum(1.0, np.diag(sandwich) / np.diag(posterior)))
    return theta + sd * step, posterior * np.outer(sd * wider, sd * wider)
