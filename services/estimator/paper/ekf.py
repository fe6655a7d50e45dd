"""The extended Kalman filter of Wawrzynski et al. (15)-(37), signs corrected.

State x = (g, v): specific force at rest, m/s^2, and velocity of the IMU, m/s, both in IMU axes. The measurement is the
velocity by the legs and the gyro, so H = [0 I] and R = sigma^2 I:

    S = P_vv + R,  K = P_:v S^-1,  x += K (v^KG - v),  P = (I - K H) P (I - K H)^T + K R K^T  (Joseph's form)

filterpy's ExtendedKalmanFilter is the referee in the tests; it does not run in a tick, because it multiplies by BLAS.
"""

import math

import numpy as np
from numpy.typing import NDArray

from surefoot.geometry.linear_kernels import inverse3, times, times_transposed
from surefoot.kernels.jit import kernel

from ..params import EstimatorParams
from .inertial import predict, widened, without_velocity
from .legs import LegVelocity

Array = NDArray[np.float64]

G, V = slice(0, 3), slice(3, 6)  # parts of the state, equation (15)


@kernel
def correct(x: Array, p: Array, measured: Array, sigma: float) -> tuple[Array, Array, float]:
    """Equations (32)-(37).

    Args:
        x: g and v, (6,).
        p: covariance, (6, 6).
        measured: v^KG, (3,) m/s.
        sigma: its standard deviation per axis, m/s.

    Returns:
        x (6,), P (6, 6) symmetric, and the normalised innovation squared, 3 degrees of freedom.
    """
    s, r = np.empty((3, 3)), np.empty(3)
    for i in range(3):
        r[i] = measured[i] - x[3 + i]
        for k in range(3):
            s[i, k] = p[3 + i, 3 + k]
        s[i, i] += sigma * sigma
    s_inv = inverse3(s)[0]
    gain, rest, x_next, nis = np.zeros((6, 3)), np.eye(6), x.copy(), 0.0
    for i in range(6):
        for k in range(3):
            for j in range(3):
                gain[i, k] += p[i, 3 + j] * s_inv[j, k]
            x_next[i] += gain[i, k] * r[k]
            rest[i, 3 + k] -= gain[i, k]
    for i in range(3):
        for k in range(3):
            nis += r[i] * s_inv[i, k] * r[k]
    p_next = times_transposed(times(rest, p), rest)
    for i in range(6):
        for j in range(i + 1):
            noise = gain[i, 0] * gain[j, 0] + gain[i, 1] * gain[j, 1] + gain[i, 2] * gain[j, 2]
            p_next[i, j] = 0.5 * (p_next[i, j] + p_next[j, i]) + sigma * sigma * noise
            p_next[j, i] = p_next[i, j]
    return x_next, p_next, nis


class PaperEkf:
    """State (g, v), equation (15); prediction at every IMU sample, correction by v^KG."""

    name = "ekf"

    def __init__(self, params: EstimatorParams) -> None:
        self._params = params
        self._noise = np.array([params.sigma_w, params.sigma_q])
        self.nis: float | None = None
        """Normalised innovation squared of the last correction, 3 degrees of freedom."""
        self.reset(np.array([0.0, 0.0, 9.81]), np.eye(6))

    def reset(self, g: Array, p: Array) -> None:
        """Start at rest: equation (1)."""
        self._x, self.p = np.concatenate([g, np.zeros(3)]), p.copy()
        self.nis = None

    def predict(self, w: Array, q: Array, d: float) -> None:
        """Equations (28)-(31)."""
        self._x, self.p = predict(self._x, self.p, w, q, d, self._noise, self._params.exact_transition, False)

    def correct(self, legs: LegVelocity) -> None:
        """Equations (32)-(37) with v^KG, if a foot stands; the mean of n feet has sigma_v/sqrt(n)."""
        if legs.feet_kg > 0:
            self.correct_with(legs.v_kg, self._params.sigma_v / math.sqrt(legs.feet_kg))

    def correct_with(self, v: Array, sigma: float) -> None:
        """Equations (32)-(37); v = v^KG (3,) m/s with the standard deviation `sigma` per axis."""
        self._x, self.p, self.nis = correct(self._x, self.p, v, sigma)

    def forget_velocity(self, sd: float) -> None:
        """The velocity became unknown: 0 +- sd m/s."""
        self._x[V] = 0.0
        self.p = without_velocity(self.p, sd)

    def widen(self, sd_g: float, sd_v: float) -> None:
        """Samples are missing: add these standard deviations, m/s^2 and m/s, to those of g and v."""
        self.p = widened(self.p, sd_g, sd_v)

    @property
    def g(self) -> Array:
        """Specific force at rest, (3,) m/s^2, IMU axes; points up."""
        return self._x[G]

    @property
    def v(self) -> Array:
        """Velocity of the IMU, (3,) m/s, IMU axes."""
        return self._x[V]
