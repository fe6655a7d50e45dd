"""How far each foot slips over its stance, by the robot's own measurements.

A foot that rolls without slipping moves its centre by phi x (r n), phi the rotation of its link between two samples, r
the radius of the sphere, n the vertical. What the centre has moved beyond that, horizontally, is slip:

    d_k = (1 - n n') (c_k - c_{k-1} - phi_k x (r n)),   x_k = sum_{i <= k} w_i d_i,
    s^2 = max(0, max_k |x_k|^2 - sigma^2)

c is the foot centre in `odom`, from joints and odometry, so s holds the drift of the odometry over one stance as well.
The sum of |d_k| would add up noise (eight times the slip of a walk), the largest way from the begin does not. sigma is
the way that encoders and odometry make of a foot at rest.

Light feet slide with open switches, farthest on slopes: a stance ends when the foot rises, not when its switch opens. A
step d_k between two open samples may be free fall as well, so w_k is the mean of 1 (closed) and 1/2 (open).
`benchmarks.bench_slip` compares with truth.
"""

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from surefoot.geometry.linear import product
from surefoot.geometry.rotations import matrix_from_quat, rotvec_from_matrix
from surefoot.services.estimator.feet import FootMount, feet_in_imu
from surefoot.services.estimator.output import OdometryPose

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

RISE = 0.008
"""m: a foot whose switch is open and that is so much higher than at its last contact is in swing."""
LONGEST_OPEN = 5
"""Samples with an open switch that end a stance wherever the foot is."""
OPEN_WEIGHT = 0.5
"""w of a sample with an open switch."""
SIGMA = 0.0005
"""m, way of a foot at rest by encoders of 0.3 deg and the odometry of one stance."""
LEAST = 2
"""Samples with contact that make a stance: one may be a bump of the swing."""


@dataclass(frozen=True, slots=True)
class FinishedStance:
    """One stance that has ended."""

    leg: int
    slip: float
    """m, largest way from where it began."""
    begin: tuple[float, float, float]
    """Foot centre at its begin, `odom`, m."""
    samples: int
    """From its first contact to its last."""
    since: int
    """Samples since its last contact."""


def feet_in_odom(mount: FootMount, q: Array, pose: OdometryPose, behind_s: float = 0.0) -> tuple[Array, Array]:
    """Return foot centres (L, 3) m and rot_odom_from_foot (L, 3, 3).

    Args:
        mount: of IMU and feet.
        q: joint angles, (nj,) rad.
        pose: of base_link in odom.
        behind_s: by how much the joints are older than the pose, s: the trunk is taken back by its velocity.
    """
    position, rot = feet_in_imu(mount, q)
    rot_odom_from_imu = product(matrix_from_quat(pose.quat_wxyz), np.ascontiguousarray(mount.rot_imu_from_base.T))
    lever = product(matrix_from_quat(pose.quat_wxyz), mount.imu_position[:, None])[:, 0]
    begin = pose.position - behind_s * pose.velocity + lever
    centres = product(position, np.ascontiguousarray(rot_odom_from_imu.T)) + begin
    return centres, np.stack([product(rot_odom_from_imu, np.ascontiguousarray(each)) for each in rot])


@dataclass(eq=False)
class StanceSlip:
    """Follows all feet from sample to sample.

    Args:
        legs: L.
        radius: of the foot spheres, (L,) m; 0 = a sole.
    """

    legs: int
    radius: Array
    slip: Array = field(init=False)
    """Of the present stance, (L,) m; 0 in swing."""

    def __post_init__(self) -> None:
        n = self.legs
        self.slip = np.zeros(n)
        self._samples, self._open = np.zeros(n, dtype=np.int64), np.zeros(n, dtype=np.int64)
        self._last, self._way, self._height = np.zeros(n, dtype=np.int64), np.zeros((n, 2)), np.zeros(n)
        self._farthest, self._begin = np.zeros(n), np.zeros((n, 3))
        self._centre, self._rot = np.zeros((n, 3)), np.tile(np.eye(3), (n, 1, 1))

    def update(self, contact: Flags, centre: Array, rot_odom_from_foot: Array) -> list[FinishedStance]:
        """Take one sample of all feet; returns the stances that have ended.

        Args:
            contact: foot switches, (L,).
            centre: foot centres in `odom`, (L, 3) m; a row that is not finite leaves its foot as it was.
            rot_odom_from_foot: rotation of each foot's link, (L, 3, 3).
        """
        ended: list[FinishedStance] = []
        for leg in range(self.legs):
            if not np.isfinite(centre[leg]).all():
                continue
            if self._samples[leg] == 0:
                if contact[leg]:
                    self._start(leg, centre[leg], rot_odom_from_foot[leg])
                continue
            self._step(leg, bool(contact[leg]), centre[leg], rot_odom_from_foot[leg])
            high = float(centre[leg, 2]) - float(self._height[leg]) > RISE
            if self._open[leg] >= LONGEST_OPEN or (self._open[leg] >= 2 and high):
                found = self._end(leg)
                if found is not None:
                    ended.append(found)
        return ended

    def _start(self, leg: int, centre: Array, rot: Array) -> None:
        self._samples[leg] = self._last[leg] = 1
        self._open[leg], self._way[leg], self._farthest[leg], self.slip[leg] = 0, 0.0, 0.0, 0.0
        self._begin[leg], self._centre[leg], self._rot[leg], self._height[leg] = centre, centre, rot, centre[2]

    def _step(self, leg: int, contact: bool, centre: Array, rot: Array) -> None:
        """Take the way since the last sample; it counts once contact is found again or was not lost."""
        phi = rotvec_from_matrix(product(rot, np.ascontiguousarray(self._rot[leg].T)))
        r = float(self.radius[leg])
        weight = 0.5 * ((1.0 if contact else OPEN_WEIGHT) + (1.0 if self._open[leg] == 0 else OPEN_WEIGHT))
        self._way[leg, 0] += weight * (centre[0] - self._centre[leg, 0] - r * phi[1])
        self._way[leg, 1] += weight * (centre[1] - self._centre[leg, 1] + r * phi[0])
        self._centre[leg], self._rot[leg] = centre, rot
        self._samples[leg] += 1
        if not contact:
            self._open[leg] += 1
            return
        self._open[leg], self._last[leg], self._height[leg] = 0, self._samples[leg], centre[2]
        x, y = self._way[leg].tolist()
        self._farthest[leg] = max(float(self._farthest[leg]), math.sqrt(x * x + y * y))
        self.slip[leg] = math.sqrt(max(0.0, float(self._farthest[leg]) ** 2 - SIGMA**2))

    def _end(self, leg: int) -> FinishedStance | None:
        samples, slip = int(self._last[leg]), float(self.slip[leg])
        x, y, z = self._begin[leg].tolist()
        since = int(self._open[leg])
        self._samples[leg], self.slip[leg] = 0, 0.0
        return FinishedStance(leg, slip, (x, y, z), samples, since) if samples >= LEAST else None
