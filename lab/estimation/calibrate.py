"""Calibration of a log by itself: legs, joint zeros, foot radius, time offset and mounting of the inertial unit.

Batch least squares over standing feet (`stances`), with a normal prior on each parameter. A parameter is observable in a
log if its interval of 95 % is clearly narrower than what the prior allows.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from surefoot.geometry.rotations import matrix_from_rotvec, rotvec_from_matrix
from surefoot.robot.description import KinematicModel, Robot
from surefoot.robot.kinematics import foot_jacobians
from surefoot.robot.reader import load_robot
from surefoot.services.estimator.feet.mount import FootMount, feet_in_imu, foot_mount

from .log import Log
from .stances import (
    InertialPath,
    StanceNoise,
    StanceWindow,
    find_noise,
    stance_windows,
    stances,
    with_inflation,
)

Array = NDArray[np.float64]

NORMAL_95 = 1.96
"""Half of the interval of 95 % of a normal distribution, in standard deviations."""
NARROW = 0.3
"""Largest half interval of an observable parameter, in half ranges of its prior."""
ROUNDS = 5
"""Linearisations; the noise is found anew before each."""
EPSILON = 1e-3
"""Step of differences, in standard deviations of the prior."""
TINY = 1e-9
"""Least variance of a score."""
UNSURE = 0.3
"""Share of the pull of noisy feet that is uncertain, one standard deviation."""
SHORTEST_LINK_M = 0.005
"""Links shorter than this have no length of their own, m."""
RANGES = {"length": 0.10, "zero": np.radians(3.0), "offset": 0.05, "mounting": np.radians(10.0), "lever": 0.05,
          "radius": 0.02, "pivot": 0.06, "gyro bias": 0.06, "acc bias": 0.3}  # fmt: skip
"""Half of the range that the prior allows (two standard deviations), by kind: share of a length, rad, s, rad, m, m,
rad/s, m/s^2."""


@dataclass(frozen=True)
class Unknown:
    """One parameter of a calibration; its value is what is to be added to what the log or the robot file states."""

    name: str
    kind: str  # see RANGES
    index: int = 0  # foot, link, joint or axis

    @property
    def range(self) -> float:
        """Half of the range that the prior allows."""
        return float(RANGES[self.kind])


@dataclass(frozen=True)
class Found:
    """A calibrated parameter."""

    name: str
    unit: str
    value: float
    half: float  # of the interval of 95 %
    observable: bool


@dataclass(frozen=True, eq=False)
class Calibration:
    """Solution for a log."""

    log: Log
    unknowns: Sequence[Unknown]
    theta: Array  # (k,)
    covariance: Array  # (k, k)
    noise: StanceNoise | None  # None: nothing stands long enough
    windows: int

    def found(self) -> list[Found]:
        """Return the parameters in units that people read, those of the sensors' biases left out."""
        out: list[Found] = []
        for u, value, sd in zip(self.unknowns, self.theta, np.sqrt(np.diag(self.covariance)), strict=True):
            if u.kind in SHOWN:
                factor, unit = SHOWN[u.kind]
                half = NORMAL_95 * float(sd)
                out.append(Found(u.name, unit, factor * float(value), factor * half, half < NARROW * u.range))
        return out

    def apply(self, log: Log | None = None) -> Log:
        """Return a log (that of the calibration, or another of the same robot) with its feet and stamps put right."""
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
            imu_position=log.imu_position - base @ lever, order=None,
            radius=None if log.radius is None else np.where(log.radius > 0.0, log.radius + radius, 0.0),
        )  # fmt: skip


SHOWN = {"length": (100.0, "%"), "zero": (180.0 / np.pi, "deg"), "offset": (1e3, "ms"), "mounting": (180.0 / np.pi, "deg"),
         "lever": (1e3, "mm"), "radius": (1e3, "mm")}  # fmt: skip
"""Factor and unit of each kind in reports."""


class LegModel:
    """Feet of a log as functions of its unknowns."""

    def __init__(self, log: Log, unknowns: Sequence[Unknown]) -> None:
        self.log, self._unknowns = log, unknowns
        self._mount = None if log.joints is None or log.robot is None else foot_mount(load_robot(log.robot))

    def values(self, theta: Array, kind: str, count: int) -> Array:
        """Return the values of one kind by their index, (count,); zero where there are none."""
        out = np.zeros(count)
        for u, value in zip(self._unknowns, theta, strict=True):
            if u.kind == kind:
                out[u.index] = value
        return out

    def feet(self, theta: Array, rows: NDArray[np.int64]) -> tuple[Array, Array]:
        """Return foot centres (k, F, 3) m and rot_imu_from_foot (k, F, 3, 3), IMU axes, at some samples (k,)."""
        log = self.log
        if self._mount is None:
            share = 1.0 + self.values(theta, "length", log.feet_count)
            position, rot = log.foot_position[rows] * share[:, None], log.foot_rot[rows]
        else:
            position, rot = self._by_joints(self._mount, theta, rows)
        turn = matrix_from_rotvec(self.values(theta, "mounting", 3))
        return position @ turn.T + self.values(theta, "lever", 3), turn @ rot

    def noise_size(self, theta: Array, rows: NDArray[np.int64]) -> Array:
        """Return the logarithm of the size of the noise of the feet, up to a constant, (k, F)."""
        if self._mount is None:
            share = 1.0 + self.values(theta, "length", self.log.feet_count)
            return np.broadcast_to(np.log(share), (len(rows), self.log.feet_count))
        model, joints = self._changed(self._mount, theta), self.log.joints
        assert joints is not None
        zeros = self.values(theta, "zero", joints.shape[1])
        moved = np.array([foot_jacobians(model, q + zeros) for q in joints[rows]])
        return 0.5 * np.log((moved**2).sum(axis=(2, 3)))

    def _by_joints(self, mount: FootMount, theta: Array, rows: NDArray[np.int64]) -> tuple[Array, Array]:
        joints = self.log.joints
        assert joints is not None
        changed = mount._replace(model=self._changed(mount, theta))
        seen = [feet_in_imu(changed, q + self.values(theta, "zero", joints.shape[1])) for q in joints[rows]]
        return np.array([p for p, _ in seen]), np.array([r for _, r in seen])

    def _changed(self, mount: FootMount, theta: Array) -> KinematicModel:
        model = mount.model
        assert model is not None
        links = len(model.parent)
        share = 1.0 + self.values(theta, "length", links + len(model.foot_link))[:, None]
        return model._replace(origin_pos=model.origin_pos * share[:links], foot_point=model.foot_point * share[links:])


def unknowns_of(log: Log) -> list[Unknown]:
    """Return what can be asked of a log: each link and joint of its legs, or one scale per leg."""
    out: list[Unknown] = []
    if log.joints is not None and log.robot is not None:
        out += _of_robot(load_robot(log.robot))
    else:
        out += [Unknown(f"length of leg {f}", "length", f) for f in range(log.feet_count)]
    oriented = np.nanmax(np.abs(log.foot_rot - log.foot_rot[:1]), initial=0.0) > 1e-6
    if oriented and log.radius is not None and (log.radius > 0.0).any():
        out.append(Unknown("foot radius", "radius"))
    elif oriented:
        out += [Unknown(f"pivot of foot {k // 3} {'xyz'[k % 3]}", "pivot", k) for k in range(3 * log.feet_count)]
    out.append(Unknown("time offset of the feet", "offset"))
    for kind, name in (("mounting", "mounting about"), ("lever", "lever along"), ("gyro bias", "gyro bias"),
                       ("acc bias", "acc bias")):  # fmt: skip
        out += [Unknown(f"{name} {axis}", kind, i) for i, axis in enumerate("xyz")]
    return out


def _of_robot(robot: Robot) -> list[Unknown]:
    out: list[Unknown] = []
    for f, leg in enumerate(robot.legs):
        for link in leg.links[1:]:  # the first lies in the trunk
            if np.linalg.norm(robot.links[link].position) > SHORTEST_LINK_M:
                out.append(Unknown(f"length to {robot.links[link].name}", "length", link))
        if np.linalg.norm(leg.foot.position) > SHORTEST_LINK_M:
            out.append(Unknown(f"length to the foot of {leg.name}", "length", len(robot.links) + f))
    joints = dict.fromkeys(joint for leg in robot.legs for joint in leg.joints)
    return out + [Unknown(f"zero of {robot.joint_names[joint]}", "zero", joint) for joint in joints]


class StanceProblem:
    """Residuals of a log as functions of its unknowns."""

    def __init__(self, log: Log, unknowns: Sequence[Unknown]) -> None:
        self.log, self.unknowns, self.windows = log, unknowns, stance_windows(log)
        self._model = LegModel(log, unknowns)
        self._rows = np.unique(np.concatenate([np.zeros(0, dtype=np.int64), *(w.sample for w in self.windows)]))
        self._radius = np.zeros(log.feet_count) if log.radius is None else log.radius
        self._parts = [np.searchsorted(self._rows, w.sample) for w in self.windows]

    @cached_property
    def _numbers(self) -> NDArray[np.int64]:
        return stances(self.log)[self._rows]

    def residuals(self, theta: Array) -> list[Array]:
        """Return R f + p of each window without the roll of round feet, (N, 3) m, frame, falling motion taken out."""
        model, log = self._model, self.log
        path = InertialPath.of(log, model.values(theta, "gyro bias", 3), model.values(theta, "acc bias", 3))
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

    def noise_sizes(self, theta: Array) -> list[Array]:
        """Return `LegModel.noise_size` at the samples of each window, (N,)."""
        size = self._model.noise_size(theta, self._rows)
        return [w.averaged(size[part, w.foot]) for w, part in zip(self.windows, self._parts, strict=True)]

    def _rolled(self, turned: Array, rot: Array) -> Array:
        """Return the way of a rolling foot of unit radius since an arbitrary time, (k, F, 3), frame."""
        world = turned[:, None] @ rot
        step = np.zeros((*world.shape[:2], 3))
        up = turned @ self.log.q[np.clip(np.searchsorted(self.log.stamp_ns, self.log.foot_ns[self._rows]), 0,
                                         len(self.log.q) - 1)][:, :, None]  # fmt: skip
        up = np.array([up[max(0, k - 10) : k + 10, :, 0].mean(axis=0) for k in range(len(up))])
        up /= np.linalg.norm(up, axis=1)[:, None]
        same = (self._numbers[1:] == self._numbers[:-1]) & (self._numbers[1:] >= 0)
        for k, f in np.argwhere(same):
            turn = rotvec_from_matrix(np.ascontiguousarray(world[k + 1, f] @ world[k, f].T))
            step[k + 1, f] = np.cross(turn, up[k])
        return np.cumsum(step, axis=0)


def calibrate(log: Log, unknowns: Sequence[Unknown] | None = None) -> Calibration:
    """Find the parameters of a log.

    Args:
        log: with feet; a robot and joints make links and joints parameters of their own.
        unknowns: what to ask; None = all that the log can have.
    """
    unknowns = unknowns_of(log) if unknowns is None else unknowns
    problem = StanceProblem(log, unknowns)
    sd = np.array([0.5 * u.range for u in unknowns])
    theta, covariance = np.zeros(len(unknowns)), np.diag(sd**2)
    if len(problem.windows) == 0:
        return Calibration(log, unknowns, theta, covariance, None, 0)
    period = 1e-9 * float(np.median(np.diff(log.stamp_ns)))
    acc, turn = (float(log.sensors.get(key, usual)) * np.sqrt(period) for key, usual in (("sigma_q", 0.1), ("sigma_w", 0.01)))
    noise = StanceNoise(1e-3, 1e-3, acc, turn)
    biases = np.array([u.kind not in SHOWN for u in unknowns])
    for k in range(ROUNDS):
        at = problem.residuals(theta)
        noise = find_noise(problem.windows, at, noise, acc)
        problem.windows = with_inflation(problem.windows, at, noise)
        theta, covariance = _step(problem, theta, at, np.where(biases | (k > 1), sd, 1e-3 * sd), noise)
    return Calibration(log, unknowns, theta, covariance, noise, len(problem.windows))


def _step(problem: StanceProblem, theta: Array, at: list[Array], sd: Array, noise: StanceNoise) -> tuple[Array, Array]:
    """Return the solution of the problem linearised at theta (k,), and its covariance (k, k).

    A longer leg also makes the noise of its foot larger, which pulls lengths to short legs; what the noise adds to the
    scores is taken off.
    """
    count = len(theta)
    tips = [theta + EPSILON * sd[i] * np.eye(count)[i] for i in range(count)]
    moved, sizes, size = [problem.residuals(x) for x in tips], [problem.noise_sizes(x) for x in tips], problem.noise_sizes(theta)
    scores, hessians, grown = np.zeros((len(at), count)), np.zeros((len(at), count, count)), np.zeros((len(at), count))
    for k, window in enumerate(problem.windows):
        rows, _ = window.whitener(noise)
        e = (rows @ at[k]).ravel()
        jac = np.stack([(rows @ (one[k] - at[k])).ravel() for one in moved], axis=1) / EPSILON
        weighted = rows.T @ (rows @ at[k])
        share = np.sum((window.foot_covariance(noise) @ weighted) * weighted, axis=1)
        grown[k] = np.array([share @ (one[k] - size[k]) for one in sizes]) / EPSILON
        hessians[k], scores[k] = jac.T @ jac, grown[k] - jac.T @ e
    hessian, pulled = hessians.sum(axis=0), UNSURE * grown.sum(axis=0)
    spread = hessian + np.outer(pulled, pulled) + TINY * np.eye(count)  # covariance of the scores
    weights = np.linalg.solve(spread, hessian).T
    posterior = np.linalg.inv(weights @ hessian + np.eye(count))
    gain = posterior @ weights
    step = gain @ scores.sum(axis=0) - posterior @ (theta / sd)
    left = scores - hessians @ step  # of the windows, at the solution
    left -= left.mean(axis=0)
    found = left.T @ left * len(at) / max(1, len(at) - 1) + np.outer(pulled, pulled)
    sandwich = gain @ found @ gain.T + posterior @ posterior
    wider = np.sqrt(np.maximum(1.0, np.diag(sandwich) / np.diag(posterior)))
    return theta + sd * step, posterior * np.outer(sd * wider, sd * wider)
