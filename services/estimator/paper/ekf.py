"""The extended Kalman filter of Wawrzynski et al. (15)-(37), signs corrected.

State x = (g, v): specific force at rest, m/s^2, and velocity of the IMU, m/s, both in IMU axes. The measurement is the
velocity by the legs and the gyro, so H = [0 I] and R = sigma^2 I:

    S = P_vv + R,  K = P_:v S^-1,  x += K (v^KG - v),  P = (I - K H) P (I - K H)^T + K R K^T  (Joseph's form)

filterpy's ExtendedKalmanFilter is the referee in the tests; it does not run in a tick, because it multiplies by BLAS.
"""

import math

import numpy as np

from surefoot.arrays import Array
from surefoot.geometry.constants import GRAVITY
from surefoot.geometry.linear_kernels import congruence, inverse3, joseph, quadratic, times, times_transposed
from surefoot.kernels.jit import kernel

from ..params import EstimatorParams
from .inertial import predict, widened, without_velocity
from .legs import LegVelocity

G, V = slice(0, 3), slice(3, 6)  # parts of the state, equation (15)


@kernel
def correct(x: Array, p: Array, measured: Array, sigma: float) -> tuple[Array, Array, float]:
    """Correct a state by a velocity, equations (32)-(37) of Wawrzynski et al.

    With H = [0 I]: S = H P H' + sigma^2 I, K = P H' S^-1, x += K (v^KG - v), P = (I - K H) P (I - K H)' + sigma^2 K K'.

    Args:
        x: state (g, v), (6,), m/s^2 and m/s, IMU axes: specific force at rest and velocity of the IMU.
        p: covariance P of the state, (6, 6).
        measured: v^KG, velocity of the IMU by the legs and the gyro, IMU axes, (3,) m/s.
        sigma: standard deviation of the velocity per axis, m/s.

    Returns:
        x (6,), P (6, 6) symmetric, and the normalised innovation squared, 3 degrees of freedom.
    """
    h, r, x_next = np.zeros((3, 6)), measured - x[3:], x.copy()
    for i in range(3):
        h[i, 3 + i] = 1.0
    s = congruence(h, p)
    for i in range(3):
        s[i, i] += sigma * sigma
    s_inv = inverse3(s)[0]
    gain = times(times_transposed(p, h), s_inv)
    for i in range(6):
        for k in range(3):
            x_next[i] += gain[i, k] * r[k]
    return x_next, joseph(p, gain, h, sigma * sigma), quadratic(r, s_inv)


class PaperEkf:
    """Filter of the state (g, v) of Wawrzynski et al.: prediction at every IMU sample, correction by the legs.

    g is the specific force at rest, m/s^2, v the velocity of the IMU, m/s, both in IMU axes; the legs and the gyro
    together measure v, which is called v^KG.
    """

    name = "ekf"

    def __init__(self, params: EstimatorParams) -> None:
        self._params = params
        self._noise = np.array([params.sigma_w, params.sigma_q])
        self.nis: float | None = None
        """Normalised innovation squared of the last correction, 3 degrees of freedom; None before the first."""
        self.reset(np.array([0.0, 0.0, GRAVITY]), np.eye(6))

    def reset(self, g: Array, p: Array) -> None:
        """Start at rest: specific force g (3,) m/s^2, IMU axes, v = 0, and the covariance p (6, 6) of (g, v)."""
        self._x, self.p = np.concatenate([g, np.zeros(3)]), p.copy()
        self.nis = None

    def predict(self, w: Array, q: Array, d: float) -> None:
        """Predict state and covariance over d s by gyro w (3,) rad/s and accelerometer q (3,) m/s^2, IMU axes."""
        self._x, self.p = predict(self._x, self.p, w, q, d, self._noise, self._params.exact_transition, False)

    def correct(self, legs: LegVelocity) -> None:
        """Correct with the velocity by legs and gyro if a foot stands; that of n feet deviates by sigma_v / sqrt(n).

        `legs`: velocities of the IMU by the standing feet, IMU axes.
        """
        if legs.feet_kg > 0:
            self.correct_with(legs.v_kg, self._params.sigma_v / math.sqrt(legs.feet_kg))

    def correct_with(self, v: Array, sigma: float) -> None:
        """Correct with a velocity v (3,) m/s, IMU axes, of standard deviation `sigma` per axis, m/s."""
        self._x, self.p, self.nis = correct(self._x, self.p, v, sigma)

    def forget_velocity(self, sd: float) -> None:
        """Make the velocity unknown, in place: 0 +- sd m/s on each axis."""
        self._x[V] = 0.0
        self.p = without_velocity(self.p, sd)

    def widen(self, sd_g: float, sd_v: float) -> None:
        """Add the standard deviations sd_g, m/s^2, and sd_v, m/s, to those of g and v: samples are missing."""
        self.p = widened(self.p, sd_g, sd_v)

    @property
    def g(self) -> Array:
        """Specific force at rest, (3,) m/s^2, IMU axes; points up."""
        return self._x[G]

    @property
    def v(self) -> Array:
        """Velocity of the IMU, (3,) m/s, IMU axes."""
        return self._x[V]
