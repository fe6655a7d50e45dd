"""The extended Kalman filter of Wawrzynski et al. (15)-(37), signs corrected, on filterpy.

filterpy is imported here and nowhere else (it takes a second).
"""

import math
from typing import Any, cast

import numpy as np
from filterpy.kalman import ExtendedKalmanFilter
from numpy.typing import NDArray

from services.estimator.inertial import predict, widened, without_velocity
from services.estimator.legs import LegVelocity
from services.estimator.params import EstimatorParams

Array = NDArray[np.float64]

G, V = slice(0, 3), slice(3, 6)  # parts of the state, equation (15)
_EYE = np.eye(3)
H = np.hstack([np.zeros((3, 3)), _EYE])  # (3, 6), equation (33)


class _Filter(ExtendedKalmanFilter):
    """filterpy's filter with the prediction (28)-(31), F P F^T + Q included, in one kernel."""

    def predict(self, u: Any = None) -> None:
        w, q, d, noise, exact = u
        self.x, self.P = predict(self.x, self.P, w, q, d, noise, exact, False)


class PaperEkf:
    """State (g, v), equation (15); prediction at every IMU sample, correction by v^KG."""

    name = "ekf"

    def __init__(self, params: EstimatorParams) -> None:
        self._params = params
        self._noise = np.array([params.sigma_w, params.sigma_q])
        self._filter = _Filter(dim_x=6, dim_z=3)
        self.nis: float | None = None
        self.reset(np.array([0.0, 0.0, 9.81]), np.eye(6))

    def reset(self, g: Array, p: Array) -> None:
        """Start at rest: equation (1)."""
        f = self._filter
        f.x = np.concatenate([g, np.zeros(3)])
        f.P = p.copy()
        self.nis = None

    def predict(self, w: Array, q: Array, d: float) -> None:
        """Equations (28)-(31)."""
        self._filter.predict(cast(Any, (w, q, d, self._noise, self._params.exact_transition)))

    def correct(self, legs: LegVelocity) -> None:
        """Equations (32)-(37) with v^KG, if a foot stands; the mean of n feet has sigma_v/sqrt(n)."""
        if legs.feet_kg > 0:
            self.correct_with(legs.v_kg, self._params.sigma_v / math.sqrt(legs.feet_kg))

    def correct_with(self, v: Array, sigma: float) -> None:
        """Equations (32)-(37); v = v^KG (3,) m/s with the standard deviation `sigma` per axis."""
        f = self._filter
        f.update(v, _h_jacobian, _h, R=_EYE * sigma**2)
        f.P = 0.5 * (f.P + f.P.T)
        self.nis = float(f.y @ f.SI @ f.y)

    def forget_velocity(self, sd: float) -> None:
        """The velocity became unknown: 0 +- sd m/s."""
        f = self._filter
        f.x[V] = 0.0
        f.P = without_velocity(f.P, sd)

    def widen(self, sd_g: float, sd_v: float) -> None:
        """Samples are missing: add these standard deviations, m/s^2 and m/s, to those of g and v."""
        self._filter.P = widened(self._filter.P, sd_g, sd_v)

    @property
    def g(self) -> Array:
        """Specific force at rest, (3,) m/s^2, IMU axes; points up."""
        return self._filter.x[G]

    @property
    def v(self) -> Array:
        """Velocity of the IMU, (3,) m/s, IMU axes."""
        return self._filter.x[V]

    @property
    def p(self) -> Array:
        """Covariance of (g, v), (6, 6)."""
        return self._filter.P


def _h_jacobian(x: Array) -> Array:
    return H


def _h(x: Array) -> Array:
    return x[V]
