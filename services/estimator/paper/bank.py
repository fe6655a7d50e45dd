"""Bank of the estimators of Wawrzynski et al.: inertial, kinematic, kinematic with gyro, and their filter.

They take samples in the order of their arrival and start at the first standstill, equation (1). A sample of the joints
is applied at the inertial sample after it, as by Wawrzynski et al.; one that comes late is applied late.
"""

import math
from collections.abc import Iterable
from typing import NamedTuple

import numpy as np

from surefoot.arrays import Array, Flags
from surefoot.geometry.constants import GRAVITY
from surefoot.geometry.linear import norm
from surefoot.kernels.jit import kernel

from ..feet.mount import FootMount, FootSample
from ..inputs.check import peak
from ..params import GAP_PUSH, GAP_TURN, UNKNOWN_SPEED, EstimatorParams
from .estimators import ESTIMATORS, UNKNOWN_TILT, VelocityEstimator
from .history import History
from .legs import LegTracker
from .standstill import GyroBias, Standstill, gravity_at_rest, plane_normal

THETA, G = slice(0, 3), slice(3, 6)  # columns of the history
NIS_MEMORY = 0.1  # weight of the last correction in the smoothed value
MAX_LEG_SPEED = 3.0  # m/s; faster by the legs is no walk but a broken encoder
LATE_NS = 100_000_000  # samples of the feet older than this are left out


class PaperOutput(NamedTuple):
    """Output of one estimator of Wawrzynski et al. at the newest inertial sample, SI, IMU axes.

    g: specific force at rest, points up, (3,) m/s^2; v: velocity of the IMU, (3,) m/s; covariance: of (g, v), (6, 6);
    hidden: variance of an axis of g that the model leaves out, (m/s^2)^2; nis: normalised innovation squared of the
    last correction, None if it makes none; nis_mean: its smoothed value; since_velocity_ns: since the legs gave a
    velocity, ns.
    """

    g: Array  # (3,) m/s^2, IMU axes, points up
    v: Array  # (3,) m/s, IMU axes
    covariance: Array  # (6, 6) of (g, v)
    hidden: float  # m^2/s^4, variance of an axis of g that the model leaves out
    nis: float | None
    nis_mean: float
    since_velocity_ns: int  # since the legs last gave a velocity


@kernel
def _note(row: Array, gyro: Array, d: float, g: Array) -> None:
    """Advance the angle in a row of the history by the gyro, in place, and write g beside it.

    Args:
        row: angle (3,) rad, then g (3,) m/s^2, (6,).
        gyro: angular rate, IMU axes, (3,) rad/s.
        d: step, s.
        g: upward gravity, IMU axes, (3,) m/s^2.
    """
    for i in range(3):
        row[i] += gyro[i] * d
        row[3 + i] = g[i]


class PaperEstimators:
    """Set of the four estimators of Wawrzynski et al., fed with equal samples; owns their start and sensor biases.

    Args:
        mount: kinematic model, mounting of the IMU and radii of the feet.
        params: noises, limits and switches.
        names: estimators that run, keys of `ESTIMATORS`.
    """

    def __init__(self, mount: FootMount, params: EstimatorParams, names: Iterable[str] = tuple(ESTIMATORS)) -> None:
        self.params = params
        self._mount = mount
        self._feet = len(mount.radius)
        self._names = tuple(names)
        self.reset()

    def reset(self, stated: bool = True) -> None:
        """Drop all state; `stated`: True if the configured slope of the ground at the start holds for the new start."""
        p = self.params
        self._stated = stated
        self.standstill = Standstill(
            p.standstill_samples, p.standstill_gyro_sd, p.standstill_acc_sd, p.standstill_travel
        )
        self.gyro_bias = GyroBias(p.sigma_w, p.gyro_bias_floor)
        self.bias, self.acc_bias = np.zeros(3), np.zeros(3)
        self._history = History(6)
        self._row = np.zeros(6)  # angle by the gyro, g
        self._hidden = 0.0  # m^2/s^4
        self.initialised = False
        self._stamp_ns = 0
        self._w = np.zeros(3)  # latest gyro, bias removed
        self._nis: dict[str, float] = {}
        self._feet_ns = self._velocity_ns = 0
        self.slipping: Flags = np.zeros(self._feet, dtype=np.bool_)
        self._legs = LegTracker(self._feet, self._mount.radius, p)
        self.filters: dict[str, VelocityEstimator] = {name: ESTIMATORS[name](p) for name in self._names}
        self._leader = self.filters["ekf"] if "ekf" in self.filters else self.filters["imu"]
        self._wide = np.diag([(GRAVITY * UNKNOWN_TILT) ** 2] * 3 + [UNKNOWN_SPEED**2] * 3)
        for one in self.filters.values():
            one.reset(np.array([0.0, 0.0, GRAVITY]), self._wide)

    def restart_clock(self) -> None:
        """Forget feet and velocity in all estimators, because the stamps of the samples begin anew."""
        self._history.clear()
        self._legs.reset()
        self._stamp_ns = self._feet_ns = self._velocity_ns = 0
        self.standstill.break_off()
        for one in self.filters.values():
            one.forget_velocity(UNKNOWN_SPEED)
            one.widen(GRAVITY * GAP_TURN, 0.0)

    def on_imu(self, stamp_ns: int, w: Array, q: Array) -> None:
        """Take an inertial sample; one that is not newer than the last is left out.

        Args:
            stamp_ns: end of the period of which w and q are means, ns.
            w: mean gyro, IMU axes, (3,) rad/s.
            q: mean specific force, IMU axes, (3,) m/s^2.
        """
        p = self.params
        if stamp_ns <= self._stamp_ns:
            return
        step = stamp_ns - self._stamp_ns if self._stamp_ns else 0
        self._stamp_ns = stamp_ns
        if step > p.gap_periods * p.imu_period_ns:
            self.standstill.break_off()
        standing = self.standstill.on_imu(w, q)
        if not self.initialised and standing:
            self._initialise()
        elif self.standstill.settled is not None and p.refine_gyro_bias:
            self._refine_bias(self.standstill.settled)
        else:
            self.gyro_bias.interrupt()
        self._w = w - self.bias
        self._advance(w, q - self.acc_bias, 1e-9 * step, step)

    def _refine_bias(self, settled: Array) -> None:
        """Learn the gyro bias from `settled`, (6,): gyro rad/s and accelerometer m/s^2 of a sample at rest."""
        self.gyro_bias.refine(self.standstill.mean[:3], settled[:3], self.params.standstill_samples)
        self.bias = self.gyro_bias.value

    def _advance(self, gyro: Array, q: Array, d: float, step_ns: int) -> None:
        """Predict all estimators over an inertial step, and append a row to the history.

        Args:
            gyro: mean gyro with its bias, IMU axes, (3,) rad/s.
            q: specific force without bias, IMU axes, (3,) m/s^2.
            d: length of the step, s.
            step_ns: length of the step, ns; 0 at the first sample.
        """
        p = self.params
        if self.initialised and step_ns > p.reset_gap_ns:
            d = 1e-9 * p.imu_period_ns  # what happened since then is unknown
            for one in self.filters.values():
                one.forget_velocity(UNKNOWN_SPEED)
                one.widen(GRAVITY * GAP_TURN, 0.0)
        elif self.initialised and step_ns > 0:
            for one in self.filters.values():
                one.predict(self._w, q, d)
                if step_ns > p.gap_periods * p.imu_period_ns:
                    one.widen(GRAVITY * GAP_TURN * d, GAP_PUSH * d)
        g = self._g(self._leader)
        _note(self._row, gyro, d, g)
        self._history.put(self._stamp_ns, self._row)

    def on_feet(self, sample: FootSample) -> None:
        """Correct each estimator by a sample of the feet; one that is old or not newer than the last is left out."""
        if sample.stamp_ns <= self._feet_ns or sample.stamp_ns < self._stamp_ns - LATE_NS:
            return
        self.standstill.on_feet(sample.position)
        self._feet_ns = sample.stamp_ns
        if len(self._history) == 0:
            self._legs.last = sample
            return
        now, last = self._history.at(sample.stamp_ns), self._legs.last
        w = self._w
        if self.params.gyro_mean and last is not None and sample.stamp_ns > last.stamp_ns:
            before = self._history.at(last.stamp_ns)
            w = (now[THETA] - before[THETA]) / (1e-9 * (sample.stamp_ns - last.stamp_ns)) - self.bias
        g = now[G]
        legs = self._legs.step(sample, w, g / norm(g), self._leader.v)
        if not self.initialised or legs is None:
            return
        self.slipping = legs.slipping
        if max(peak(legs.v_kg), peak(legs.v_k)) <= MAX_LEG_SPEED:
            for name, one in self.filters.items():
                one.correct(legs)
                if one.nis is not None:
                    old = self._nis.get(name, 0.0)
                    self._nis[name] = old + NIS_MEMORY * (one.nis - old)
            if legs.feet_kg > 0:
                self._velocity_ns = self._stamp_ns

    def _initialise(self) -> None:
        """Start at the first standstill, equation (1) of Wawrzynski et al., with biases and the first covariance."""
        p, mean = self.params, self.standstill.mean
        feet, up = self._legs.last, None
        if feet is not None and self._stated:
            up = plane_normal(feet.position, feet.contact, mean[3:])
        if p.remove_gyro_bias:
            self.gyro_bias.start(mean[:3], p.standstill_samples)
            self.bias = self.gyro_bias.value
        g, self._hidden = gravity_at_rest(mean[3:], up, p)
        self.acc_bias = mean[3:] - g
        start = np.diag([p.sigma_q**2 / p.standstill_samples + p.prior_g**2] * 3 + [p.prior_v**2] * 3)
        for one in self.filters.values():
            one.reset(g, start)
        self._velocity_ns = self._stamp_ns
        self.initialised = True

    def _g(self, one: VelocityEstimator) -> Array:
        """Return g of an estimator, IMU axes, (3,) m/s^2; of the leading one if it has none of its own."""
        g = one.g
        return g if g is not None else self._leader.g  # type: ignore[return-value]

    def output(self, name: str) -> PaperOutput:
        """Return the present estimate of one estimator by its name.

        An estimator without a g of its own takes that of `ekf`, or of `imu` where `ekf` does not run. A bias of the
        accelerometer cannot be separated from a tilt: the variance of g that the covariance leaves out for it is
        `hidden`.
        """
        one, known = self.filters[name], self.initialised
        return PaperOutput(
            g=self._g(one),
            v=one.v,
            covariance=one.p if known else self._wide,
            hidden=math.sqrt(self._hidden) ** 2 if known else 0.0,
            nis=one.nis,
            nis_mean=self._nis.get(name, 0.0),
            since_velocity_ns=self._stamp_ns - self._velocity_ns,
        )
