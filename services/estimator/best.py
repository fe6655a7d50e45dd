"""The `best` estimator: velocity, tilt, biases, position and heading by one filter over all samples in their order."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from surefoot.geometry.linear_kernels import times, times_transposed
from surefoot.geometry.rotations import quat_from_matrix
from surefoot.kernels.jit import kernel
from surefoot.services.estimator.best_kernel import (
    ACC_BIAS,
    DOWN,
    E_POS,
    EXCESS,
    GYRO_BIAS,
    LAG,
    NIS,
    POS,
    REST,
    SEEN,
    VEL,
    BestNoise,
    BestState,
    copy_state,
    new_state,
    rotation,
)
from surefoot.services.estimator.best_memory import (
    DONE_NS,
    add_feet,
    add_imu,
    bring_up,
    clear,
    new_memory,
    restart_clock,
)
from surefoot.services.estimator.best_modes import modes_of
from surefoot.services.estimator.best_run import settled
from surefoot.services.estimator.best_start import BestGeometry, BestLimits
from surefoot.services.estimator.inertial import GRAVITY

Array = NDArray[np.float64]

LENGTH_SD = 0.01  # m/s^2, of the length of g, which the state takes as known


class BestOutput(NamedTuple):
    """The estimate at the newest inertial sample."""

    g: Array  # (3,) m/s^2, IMU axes, points up
    v: Array  # (3,) m/s, IMU axes
    covariance: Array  # (6, 6) of (g, v)
    position: Array  # (3,) m, base_link in odom
    quat_wxyz: Array  # (4,) rot_odom_from_base
    v_odom: Array  # (3,) m/s, base_link
    pose_covariance: Array  # (4, 4) of x, y, z, yaw
    gyro_bias: Array  # (3,) rad/s
    acc_bias: Array  # (3,) m/s^2
    sliding: Array  # (L,) probability that a foot slides; NaN: it does not stand
    yaw: float  # rad
    nis: float  # 3 degrees of freedom
    excess: float  # factor of the inertial noise
    standing: bool
    settled: bool


@kernel
def _covariances(rot: Array, cov: Array) -> tuple[Array, Array]:
    """Covariance of (g, v) in IMU axes (6, 6), and of x, y, z, yaw in odom (4, 4)."""
    by = np.zeros((6, 6))
    for i in range(3):
        by[i, 0], by[i, 1] = -GRAVITY * rot[1, i], GRAVITY * rot[0, i]
        for k in range(3):
            by[3 + i, 3 + k] = rot[k, i]
    block, pose, index = np.empty((6, 6)), np.empty((4, 4)), np.array([E_POS, E_POS + 1, E_POS + 2, 2])
    for i in range(6):
        for k in range(6):
            block[i, k] = cov[i, k]
    out = times_transposed(times(by, block), by)
    for i in range(3):
        for k in range(3):
            out[i, k] += LENGTH_SD**2 * rot[2, i] * rot[2, k]
    for i in range(4):
        for k in range(4):
            pose[i, k] = cov[index[i], index[k]]
    for i in range(6):
        for k in range(i):
            out[i, k] = out[k, i] = 0.5 * (out[i, k] + out[k, i])
    return out, pose


@kernel
def summary(state: BestState, geometry: BestGeometry, w: Array, feet: int) -> tuple[Array, Array, Array, Array]:
    """Vectors by rows (7, 3): g, v, position and velocity of base_link in odom, biases, (yaw, settled, 0); its
    quaternion (4,) and the probability of sliding of each foot (L,) in one array; covariances as `_covariances`.

    Args:
        state: the state.
        geometry: of the robot.
        w: gyro, (3,) rad/s.
        feet: their number L.
    """  # fmt: skip
    x, points = state.x, state.points
    rot, rows, more = rotation(x), np.zeros((7, 3)), np.zeros(4 + feet)
    base, arm, turn, v_imu = np.zeros((3, 3)), np.zeros(3), np.zeros(3), np.zeros(3)
    for i in range(3):
        for k in range(3):
            v_imu[i] += rot[k, i] * x[VEL + k]
            turn[i] += rot[i, k] * (w[k] - x[GYRO_BIAS + k])
            for m in range(3):
                base[i, k] += rot[i, m] * geometry.rot_base_from_imu[k, m]
    for i in range(3):
        for k in range(3):
            arm[i] += base[i, k] * geometry.imu_position[k]
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        rows[0, i], rows[1, i] = GRAVITY * rot[2, i], v_imu[i] + state.memory[LAG + i]
        rows[2, i] = x[POS + i] - arm[i]
        rows[3, i] = x[VEL + i] - (turn[j] * arm[k] - turn[k] * arm[j])
        for m in range(3):
            rows[3, i] += rot[i, m] * state.memory[LAG + m]
        rows[4, i], rows[5, i] = x[GYRO_BIAS + i], x[ACC_BIAS + i]
    rows[6, 0] = math.atan2(base[1, 0], base[0, 0])
    rows[6, 1] = 1.0 if settled(state) else 0.0
    quat = quat_from_matrix(base)
    for i in range(4):
        more[i] = quat[i]
    count = np.zeros(feet)
    for k in range(points.shape[0]):
        if points[k, DOWN] > 0.0:
            more[4 + geometry.foot[k]] += points[k, SEEN]
            count[geometry.foot[k]] += 1.0
    for f in range(feet):
        more[4 + f] = more[4 + f] / count[f] if count[f] > 0.0 else math.nan
    covariance, pose = _covariances(rot, state.cov)
    return rows, more, covariance, pose


class BestFilter:
    """Takes samples in any order within the last half second; the result is that of their order by stamps, to the bit.

    Args:
        geometry: of the robot.
        noise: of the filter.
        limits: of start and rest.
        feet: number of feet L.
    """

    def __init__(self, geometry: BestGeometry, noise: BestNoise, limits: BestLimits, feet: int) -> None:
        self.geometry, self.noise, self.limits, self._feet = geometry, noise, limits, feet
        self._modes = modes_of(feet) if limits.hypotheses else 0
        self.memory = new_memory(feet, len(geometry.foot), self._modes)
        self.state = new_state(len(geometry.foot), self._modes)
        self.reset(limits)

    def reset(self, limits: BestLimits) -> None:
        """Forget everything; `limits` state where the robot begins."""
        self.limits = limits
        copy_state(new_state(len(self.geometry.foot), self._modes), self.state)
        clear(self.memory, self.state)

    def restart_clock(self) -> None:
        """Keep what is known but for velocity and feet: the stamps begin anew."""
        self.update()
        restart_clock(self.memory, self.state)

    def add_imu(self, stamp_ns: int, w: Array, q: Array) -> bool:
        """Take an inertial sample; False: there is one of this stamp."""
        return add_imu(self.memory, stamp_ns, w, q)

    def add_feet(self, stamp_ns: int, position: Array, rot: Array, contact: Array) -> bool:
        """Take feet (L, 3), (L, 3, 3), contact probabilities of the points (K,); False: there is one of this stamp."""
        return add_feet(self.memory, stamp_ns, position, rot, contact)

    def update(self) -> None:
        """Bring the state up to the newest inertial sample; late samples cost one replay of at most the window."""
        bring_up(self.memory, self.state, self.geometry, self.noise, self.limits)

    @property
    def stamp_ns(self) -> int:
        """Of the newest inertial sample in the state; -1 = none."""
        return int(self.memory.marks[DONE_NS])

    def output(self, w: Array) -> BestOutput:
        """The estimate at `stamp_ns`; w (3,) rad/s is the newest gyro sample, for the velocity of base_link."""
        rows, more, covariance, pose = summary(self.state, self.geometry, w, self._feet)
        memory = self.state.memory
        return BestOutput(
            rows[0], rows[1], covariance, rows[2], more[:4], rows[3], pose, rows[4], rows[5], more[4:],
            float(rows[6, 0]), float(memory[NIS]), float(memory[EXCESS]), bool(memory[REST] > 0.0), bool(rows[6, 1]),
        )  # fmt: skip
