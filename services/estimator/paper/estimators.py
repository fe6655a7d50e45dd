"""The estimators of Wawrzynski et al. behind one protocol, and their table: a new one is one class and one row."""

from collections.abc import Callable
from typing import Protocol

import numpy as np

from surefoot.arrays import Array
from surefoot.geometry.constants import GRAVITY

from ..params import UNKNOWN_SPEED, EstimatorParams
from .ekf import PaperEkf
from .inertial import predict, widened, without_velocity
from .legs import LegVelocity

UNKNOWN_TILT = 0.5
"""Standard deviation of the tilt of an estimator that does not estimate it, rad."""


class VelocityEstimator(Protocol):
    """Interface of an estimator of g and v in IMU axes from inertial samples and velocities by the legs."""

    name: str
    nis: float | None

    def reset(self, g: Array, p: Array) -> None:
        """Start at rest with g (3,) m/s^2, IMU axes, and the covariance p (6, 6) of (g, v), m/s^2 and m/s squared."""
        ...

    def predict(self, w: Array, q: Array, d: float) -> None:
        """Predict the state over d s by gyro w (3,) rad/s and accelerometer q (3,) m/s^2, IMU axes."""
        ...

    def correct(self, legs: LegVelocity) -> None:
        """Correct the estimate with the velocities of the IMU by the standing feet, m/s, IMU axes."""
        ...

    def widen(self, sd_g: float, sd_v: float) -> None:
        """Add the standard deviations sd_g, m/s^2, and sd_v, m/s, to those of g and v: samples are missing."""
        ...

    def forget_velocity(self, sd: float) -> None:
        """Make the velocity unknown: 0 +- sd m/s on each axis."""
        ...

    @property
    def g(self) -> Array | None:
        """Specific force at rest, IMU axes, (3,) m/s^2, points up; None if this estimator has none."""
        ...

    @property
    def v(self) -> Array:
        """Velocity of the IMU, IMU axes, (3,) m/s."""
        ...

    @property
    def p(self) -> Array:
        """Covariance of gravity and velocity (g, v), (6, 6), m/s^2 and m/s squared, axes of the inertial unit."""
        ...


class _InertialOnly:
    """Estimate of g and v by the IMU alone, (1)-(4) of Wawrzynski et al.: it drifts and is useless after seconds."""

    name = "imu"

    def __init__(self, params: EstimatorParams) -> None:
        self._noise = np.array([params.sigma_w, params.sigma_q])
        self._exact = params.exact_transition
        self.nis: float | None = None
        self.reset(np.array([0.0, 0.0, GRAVITY]), np.eye(6))

    def reset(self, g: Array, p: Array) -> None:
        self._x, self.p = np.concatenate([g, np.zeros(3)]), p.copy()

    @property
    def g(self) -> Array:
        """Specific force at rest, IMU axes, (3,) m/s^2; points up."""
        return self._x[:3]

    @property
    def v(self) -> Array:
        """Velocity of the IMU, IMU axes, (3,) m/s."""
        return self._x[3:]

    def predict(self, w: Array, q: Array, d: float) -> None:
        self._x, self.p = predict(self._x, self.p, w, q, d, self._noise, self._exact, True)

    def correct(self, legs: LegVelocity) -> None:
        pass

    def widen(self, sd_g: float, sd_v: float) -> None:
        self.p = widened(self.p, sd_g, sd_v)

    def forget_velocity(self, sd: float) -> None:
        self._x = np.concatenate([self._x[:3], np.zeros(3)])
        self.p = without_velocity(self.p, sd)


class _LegsOnly:
    """Velocity of the IMU by leg kinematics alone, held between samples of the feet; g is not estimated."""

    name = "kinematics"
    g: Array | None = None

    def __init__(self, params: EstimatorParams) -> None:
        self._sigma = params.sigma_k
        self.nis: float | None = None
        self.reset(np.zeros(3), np.eye(6))

    def reset(self, g: Array, p: Array) -> None:
        self.v = np.zeros(3)
        self._known = False
        self._since = 0.0
        self._p = np.diag([(GRAVITY * UNKNOWN_TILT) ** 2] * 3 + [UNKNOWN_SPEED**2] * 3)

    def predict(self, w: Array, q: Array, d: float) -> None:
        self._since += d

    def correct(self, legs: LegVelocity) -> None:
        self._take(legs.v_k, legs.feet_k)

    def _take(self, v: Array, feet: int) -> None:
        """Take the velocity v (3,) m/s, IMU axes, by `feet` feet; 0 feet: none, the old one is held."""
        if feet > 0:
            self.v = v
            self._since = 0.0
            self._known = True

    def widen(self, sd_g: float, sd_v: float) -> None:
        pass

    def forget_velocity(self, sd: float) -> None:
        self._known = False
        self.v = np.zeros(3)

    @property
    def p(self) -> Array:
        """Covariance (6, 6) of (g, v): g unknown; the standard deviation of v grows by 1 m/s per s."""
        sd = min(UNKNOWN_SPEED, np.hypot(self._sigma, self._since)) if self._known else UNKNOWN_SPEED
        self._p[3, 3] = self._p[4, 4] = self._p[5, 5] = sd**2
        return self._p


class _LegsGyro(_LegsOnly):
    """Velocity by the leg kinematics and the gyro, (11)-(14) of Wawrzynski et al., held between samples."""

    name = "kinematics_gyro"

    def __init__(self, params: EstimatorParams) -> None:
        super().__init__(params)
        self._sigma = params.sigma_v

    def correct(self, legs: LegVelocity) -> None:
        self._take(legs.v_kg, legs.feet_kg)


ESTIMATORS: dict[str, Callable[[EstimatorParams], VelocityEstimator]] = {
    "imu": _InertialOnly,
    "kinematics": _LegsOnly,
    "kinematics_gyro": _LegsGyro,
    "ekf": PaperEkf,
}
"""Constructors of the estimators by name, which is also that of their topic `state/velocity/<name>`."""
