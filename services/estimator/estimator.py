"""All estimators side by side on one stream of inputs, and the odometry."""

import math
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from surefoot.geometry.linear import norm
from surefoot.robot.description import Robot
from surefoot.services.estimator.estimators import ESTIMATORS, UNKNOWN_SPEED, UNKNOWN_TILT, VelocityEstimator
from surefoot.services.estimator.feet import FootMount, FootSample, feet_in_imu, foot_mount, without_unknown_feet
from surefoot.services.estimator.history import History
from surefoot.services.estimator.inertial import GRAVITY
from surefoot.services.estimator.inputs import InputJudge, InputResult, peak
from surefoot.services.estimator.legs import LegTracker
from surefoot.services.estimator.odometry import OdometryFilter, OdometryParams, OdometryPose
from surefoot.services.estimator.odometry_kernel import heading_view, level, turned
from surefoot.services.estimator.output import Estimate, express, summary
from surefoot.services.estimator.params import EstimatorParams
from surefoot.services.estimator.standstill import GyroBias, Standstill, gravity_at_rest, plane_normal

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

THETA, PSI, G = slice(0, 3), 3, slice(4, 7)  # columns of the history
SILENT_NS = 200_000_000  # kinematics older than this: sensors_ok is false
NO_CONTACT_NS = 500_000_000  # the same for the last contact of any foot
UNCORRECTED_NS = 1_000_000_000  # prediction only for longer: filter_ok is false
START_SD = 1e-3  # m and rad, of a stated start pose
LOST_SD = 1.0  # m and rad, of a pose nobody knows
GAP_TURN = 0.1  # rad/s, unseen turning in a gap; rad in a long one
GAP_PUSH = 1.0  # m/s^2, unseen acceleration in a gap
MAX_NIS = 50.0  # smoothed; a filter that is so surprised is not to be trusted
NIS_MEMORY = 0.1  # weight of the last correction in the smoothed value
MAX_LEG_SPEED = 3.0  # m/s; faster by the legs is no walk but a broken encoder


@dataclass(frozen=True)
class StartPose:
    """Where the robot stands when it starts: map = odom by this statement."""

    x: float = 0.0  # m
    y: float = 0.0  # m
    yaw: float = 0.0  # rad
    ground: float = 0.0  # m, height of the ground under the feet, mean


class Estimator:
    """Feeds every estimator of the table; owns start, biases, checks and odometry."""

    def __init__(
        self,
        mount: FootMount,
        params: EstimatorParams,
        odometry: OdometryParams,
        start: StartPose = StartPose(),
        names: Iterable[str] = tuple(ESTIMATORS),
    ) -> None:
        self.params = params
        self._mount = mount
        self._start = start
        self._feet = len(mount.radius)
        self._rot_base_from_imu = np.ascontiguousarray(mount.rot_imu_from_base.T)
        self._names = tuple(names)
        self._odometry_params = odometry
        self.reset()

    @classmethod
    def for_robot(cls, robot: Robot, start: StartPose = StartPose(), **changes: object) -> "Estimator":
        """Estimator with the noises of the robot's sensors."""
        params = EstimatorParams.from_robot(robot, **changes)
        turn = params.sigma_w * np.sqrt(1e-9 * params.imu_period_ns)
        return cls(foot_mount(robot), params, OdometryParams(sigma_turn=float(turn)), start)

    def reset(self, stated: bool = True) -> None:
        """Drop all state: a new epoch.

        Args:
            stated: whether start pose and level ground still hold; no after a restart in the middle of a walk, which
                begins again at the same numbers but says with its covariance that they mean nothing.
        """
        p = self.params
        self._stated = stated
        self.judge = InputJudge(p)
        self.standstill = Standstill(
            p.standstill_samples, p.standstill_gyro_sd, p.standstill_acc_sd, p.standstill_travel
        )
        self.gyro_bias = GyroBias(p.sigma_w, p.gyro_bias_floor)
        self._bias, self._fixed_bias, self._acc_bias = np.zeros(3), np.zeros(3), np.zeros(3)
        self._history = History(7)
        self._row = np.zeros(7)  # angle by the gyro, heading, g
        self._g_hidden = 0.0  # m^2/s^4
        self.initialised = False
        self.stamp_ns = 0
        self._w = np.zeros(3)  # latest gyro, bias removed
        self._nis: dict[str, float] = {}
        self._last_feet_ns = self._last_contact_ns = self._last_velocity_ns = 0
        self._slipping = np.zeros(self._feet, dtype=np.bool_)
        self._legs = LegTracker(self._feet, self._mount.radius, p)
        self.filters: dict[str, VelocityEstimator] = {name: ESTIMATORS[name](p) for name in self._names}
        self._leader = self.filters["ekf"] if "ekf" in self.filters else self.filters["imu"]
        self._wide = np.diag([(GRAVITY * UNKNOWN_TILT) ** 2] * 3 + [UNKNOWN_SPEED**2] * 3)
        for one in self.filters.values():
            one.reset(np.array([0.0, 0.0, GRAVITY]), self._wide)
        self._odometry = OdometryFilter(
            self._feet, self._rot_base_from_imu, self._mount.imu_position, self._mount.radius, self._odometry_params
        )
        self._begin_odometry(np.array([0.0, 0.0, GRAVITY]), wide=True)

    # inputs

    def on_imu(self, stamp_ns: int, w: Array, q: Array) -> InputResult:
        """Take an inertial sample: mean gyro w (3,) rad/s and specific force q (3,) m/s^2 up to `stamp_ns`."""
        p = self.params
        result, step = self.judge.imu(stamp_ns, w, q)
        if not result.accepted:
            return result
        self.stamp_ns = stamp_ns
        if result is not InputResult.OK:
            self.standstill.break_off()
        if result is InputResult.RESTART:
            self._history.clear()
            self._legs.reset()
            self._last_feet_ns = self._last_contact_ns = self._last_velocity_ns = stamp_ns
            step = p.reset_gap_ns + 1
        standing = self.standstill.on_imu(w, q)
        if not self.initialised and standing:
            self._initialise()
        elif self.standstill.settled is not None and p.refine_gyro_bias:
            self._refine_bias(self.standstill.settled)
        self._w = w - self._bias
        self._advance(self._w, w, q - self._acc_bias, 1e-9 * step, step)
        return result

    def _refine_bias(self, settled: Array) -> None:
        if self.gyro_bias.plausible(self.standstill.mean[:3], self.params.standstill_samples):
            self.gyro_bias.add(settled[:3])
            self._bias = self.gyro_bias.value

    def _advance(self, w: Array, gyro: Array, q: Array, d: float, step_ns: int) -> None:
        p = self.params
        if self.initialised and step_ns > p.reset_gap_ns:
            d = 1e-9 * p.imu_period_ns  # what happened since then is unknown
            for one in self.filters.values():
                one.forget_velocity(UNKNOWN_SPEED)
                one.widen(GRAVITY * GAP_TURN, 0.0)
        elif self.initialised and step_ns > 0:
            for one in self.filters.values():
                one.predict(w, q, d)
                if step_ns > p.gap_periods * p.imu_period_ns:
                    one.widen(GRAVITY * GAP_TURN * d, GAP_PUSH * d)
        g = self._g(self._leader)
        self._row = turned(self._row, gyro, gyro - self._fixed_bias, g, d, self._rot_base_from_imu)
        self._history.put(self.stamp_ns, self._row)

    def on_kinematics(self, stamp_ns: int, q: Array, contact: Flags) -> InputResult:
        """Take joint angles q (nj,) rad and foot contacts (L,) at `stamp_ns`."""
        model = self._mount.model
        if model is None or q.shape != model.lower.shape or contact.shape != (self._feet,):
            return self.judge.shape(stamp_ns)
        position, rot = feet_in_imu(self._mount, q)
        return self.on_feet(FootSample(stamp_ns, position, rot, contact))

    def on_feet(self, sample: FootSample) -> InputResult:
        """Take the feet themselves, as logs have them."""
        result = self.judge.kinematics(sample.stamp_ns, sample.position, self.stamp_ns)
        if not result.accepted:
            return result
        self.standstill.on_feet(sample.position)
        sample = without_unknown_feet(sample)
        self._last_feet_ns = sample.stamp_ns
        if sample.contact.any():
            self._last_contact_ns = sample.stamp_ns
        if len(self._history) == 0:
            self._legs.last = sample
            return result
        self._follow(sample)
        return result

    def _follow(self, sample: FootSample) -> None:
        """Velocity by the legs, corrections, odometry."""
        now, last = self._history.at(sample.stamp_ns), self._legs.last
        w = self._w
        if self.params.gyro_mean and last is not None and sample.stamp_ns > last.stamp_ns:
            before = self._history.at(last.stamp_ns)
            w = (now[THETA] - before[THETA]) / (1e-9 * (sample.stamp_ns - last.stamp_ns)) - self._bias
        g = now[G]
        legs = self._legs.step(sample, w, g / norm(g), self._leader.v)
        if not self.initialised:
            return
        if legs is not None:
            self._slipping = legs.slipping
            if max(peak(legs.v_kg), peak(legs.v_k)) > MAX_LEG_SPEED:
                self.judge.implausible(sample.stamp_ns)
            else:
                for one in self.filters.values():
                    one.correct(legs)
                self._note_nis()
                if legs.feet_kg > 0:
                    self._last_velocity_ns = self.stamp_ns
        self._odometry.on_feet(sample, float(now[PSI]), g, w, self._expressed(self._leader)[1])

    def _note_nis(self) -> None:
        for name, one in self.filters.items():
            if one.nis is not None:
                old = self._nis.get(name, 0.0)
                self._nis[name] = old + NIS_MEMORY * (one.nis - old)

    # start

    def _initialise(self) -> None:
        """Equation (1) at the first standstill, with biases and P0."""
        p, mean = self.params, self.standstill.mean
        feet = self._legs.last
        up = None
        if feet is not None and self._stated:
            up = plane_normal(feet.position, feet.contact, mean[3:])
        if p.remove_gyro_bias:
            self.gyro_bias.start(mean[:3], p.standstill_samples)
            self._bias = self.gyro_bias.value
        self._fixed_bias = self._bias
        g, self._g_hidden = gravity_at_rest(mean[3:], up, p)
        self._acc_bias = mean[3:] - g
        start = np.diag([p.sigma_q**2 / p.standstill_samples + p.prior_g**2] * 3 + [p.prior_v**2] * 3)
        for one in self.filters.values():
            one.reset(g, start)
        self._row[PSI] = 0.0
        self._last_velocity_ns = self.stamp_ns
        self.initialised = True
        self._begin_odometry(g, wide=False)

    def _begin_odometry(self, g: Array, wide: bool) -> None:
        """Put base_link over the stated start pose; its height follows from the feet in contact."""
        feet, z = self._legs.last, 0.0
        if feet is not None and feet.contact.any():
            rot = level(self._rot_base_from_imu, g)
            seen = heading_view(rot, self._rot_base_from_imu, self._mount.imu_position, feet.position)
            z = float(np.mean((self._mount.radius - seen[:, 2])[feet.contact]))
        position = np.array([self._start.x, self._start.y, self._start.ground + z])
        sd = np.full(4, START_SD if self._stated and not wide else LOST_SD)
        bias_sd = self.gyro_bias.sd if self.gyro_bias.samples else 0.05
        self._odometry.start(position, self._start.yaw, bias_sd, sd)

    # outputs

    def _g(self, one: VelocityEstimator) -> Array:
        g = one.g
        return g if g is not None else self._leader.g  # type: ignore[return-value]

    def _expressed(self, one: VelocityEstimator) -> Array:
        return express(self._g(one), one.v, self._w, self._rot_base_from_imu, self._mount.imu_position)

    def estimate(self, name: str = "ekf") -> Estimate:
        """The present estimate of one estimator; g of those that do not estimate it is the leader's.

        Its covariance is P of the filter, and on g what its model leaves out: an accelerometer bias looks like a tilt
        for ever.
        """
        one, now, known = self.filters[name], self.stamp_ns, self.initialised
        v, hidden = one.v, math.sqrt(self._g_hidden) ** 2 if known else 0.0
        rows, p, healthy = summary(
            self._g(one), v, one.p if known else self._wide,
            self._w, self._rot_base_from_imu, self._mount.imu_position, hidden,
        )  # fmt: skip
        moving = self.initialised and not self.standstill.standing
        return Estimate(
            mode=name,
            stamp_ns=now,
            velocity=rows[0],
            velocity_imu=v,
            velocity_heading=rows[1],
            angular_velocity=rows[2],
            g_up=rows[3],
            roll=float(rows[4, 0]),
            pitch=float(rows[4, 1]),
            gyro_bias=self._bias,
            acc_bias=self._acc_bias,
            covariance=p,
            initialised=self.initialised,
            standing=self.standstill.standing,
            inputs_ok=self.judge.inputs_ok(now),
            filter_ok=(
                self.initialised
                and healthy
                and self._nis.get(name, 0.0) < MAX_NIS
                and now - self._last_velocity_ns < UNCORRECTED_NS
            ),
            sensors_ok=(
                not self.judge.imu_frozen
                and not self.judge.joints_frozen(moving)
                and not self.judge.saturated(now)
                and now - self._last_feet_ns < SILENT_NS
                and now - self._last_contact_ns < NO_CONTACT_NS
            ),
            slipping=self._slipping | self._odometry.slipping,
            nis=one.nis,
            refused=self.judge.refused,
            contact_lost_s=1e-9 * (now - self._last_contact_ns),
            prediction_only_s=1e-9 * (now - self._last_velocity_ns),
        )

    def pose(self) -> OdometryPose:
        """Dead-reckoned pose of base_link in odom at the last inertial sample."""
        since = 1e-9 * max(0, self.stamp_ns - self._last_feet_ns) if self._odometry.ready else 0.0
        g, psi = self._row[G], float(self._row[PSI])
        return self._odometry.pose(
            since, psi, g, self._expressed(self._leader)[1], self._g_hidden / (GRAVITY * GRAVITY)
        )
