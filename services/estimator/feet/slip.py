"""Slip of each foot over its stance, by the robot's own measurements.

A foot that rolls without slipping moves its centre by phi x (r n), phi the rotation of its link between two samples, r
the radius of the sphere, n the vertical. What the centre has moved beyond that, horizontally, is slip:

    d_k = (1 - n n') (c_k - c_{k-1} - phi_k x (r n)),   x_k = sum_{i <= k} w_i d_i,
    s^2 = max(0, max_k |x_k|^2 - sigma^2)

c is the foot centre in `odom`, from joints and odometry, so s holds the drift of the odometry over one stance as well.
The sum of |d_k| would add up noise (eight times the slip of a walk), the largest way from the begin does not. sigma is
the way that encoders and odometry make of a foot at rest.

Light feet slide with open switches, farthest on slopes: a stance ends when the foot rises, not when its switch opens. A
step d_k between two open samples may be free fall as well, so w_k is the mean of 1 (closed) and 1/2 (open).
`python -m benchmarks foothold_walks slip` compares with truth.
"""

import math
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from surefoot.arrays import Array, Flags
from surefoot.geometry.linear_kernels import times, times_transposed, times_vector
from surefoot.geometry.rotations import matrix_from_quat, rotvec_from_matrix
from surefoot.kernels.jit import kernel

from ..output import OdometryPose
from .mount import FootMount, feet_in_imu

Counts = NDArray[np.int64]

RISE = 0.008
"""Rise over the height of the last contact from which a foot with an open switch is in swing, m."""
LONGEST_OPEN = 5
"""Samples with an open switch that end a stance, whatever the height of the foot."""
OPEN_WEIGHT = 0.5
"""Weight w of a sample with an open switch."""
SIGMA = 0.0005
"""Way of a foot at rest by encoders of 0.3 deg and the odometry of one stance, m."""
LEAST = 2
"""Samples with contact that make a stance: one may be a bump of the swing."""


@dataclass(frozen=True, slots=True)
class FinishedStance:
    """One finished stance (time in which a foot stood): how far the foot slid, where it began, how it was sampled."""

    leg: int
    slip: float
    """Largest distance of the foot from where the stance began, m."""
    begin: tuple[float, float, float]
    """Foot centre at its begin, `odom`, m."""
    samples: int
    """Samples from its first contact to its last."""
    since: int
    """Samples since its last contact."""
    healthy: bool = True
    """False: an encoder or switch of the leg was at fault."""


def feet_in_odom(mount: FootMount, q: Array, pose: OdometryPose, behind_s: float = 0.0) -> tuple[Array, Array]:
    """Return foot centres in odom, (L, 3) m, and rot_odom_from_foot (L, 3, 3).

    Args:
        mount: kinematic model, and mounting of the IMU in base_link.
        q: joint angles, (nj,) rad.
        pose: pose and velocity of base_link in odom.
        behind_s: age of the joints against the pose, s: the trunk is taken back by its velocity.
    """
    position, rot = feet_in_imu(mount, q)
    begin = pose.position - behind_s * pose.velocity
    return _turned(position, rot, pose.quat_wxyz, mount.rot_imu_from_base, mount.imu_position, begin)


@kernel
def _turned(
    position: Array, rot: Array, quat_wxyz: Array, rot_imu_from_base: Array, imu_position: Array, begin: Array
) -> tuple[Array, Array]:
    """Return feet, seen from the IMU, in `odom`: centres (L, 3) m and rotations (L, 3, 3).

    Args:
        position: foot centres from the IMU, IMU axes, (L, 3) m.
        rot: rot_imu_from_foot, (L, 3, 3).
        quat_wxyz: orientation of base_link in `odom`, (4,).
        rot_imu_from_base: mounting of the IMU, (3, 3).
        imu_position: place of the IMU in base_link, (3,) m.
        begin: place of base_link in `odom`, (3,) m.
    """
    base = matrix_from_quat(quat_wxyz)
    turn, at = times_transposed(base, rot_imu_from_base), begin + times_vector(base, imu_position)
    centres, turned = np.empty(position.shape), np.empty(rot.shape)
    for f in range(position.shape[0]):
        centres[f], turned[f] = times_vector(turn, position[f]) + at, times(turn, rot[f])
    return centres, turned


class FootWays(NamedTuple):
    """Path of each of L feet over its present stance (time in which it stands), updated from sample to sample."""

    slip: Array
    """Slip of the present stance, (L,) m; 0 in swing."""
    samples: Counts
    """Samples since the stance began, (L,); 0 in swing."""
    open: Counts
    """Samples since the switch was closed last, (L,)."""
    last: Counts
    """Samples from the begin of the stance to the last contact, (L,)."""
    way: Array
    """Level way x of the foot by slip in the stance so far, axes of odom, (L, 2) m; rolling is taken off."""
    height: Array
    """Height of the foot at its last contact, (L,) m, `odom`."""
    farthest: Array
    """Largest |x| of the stance so far, (L,) m."""
    begin: Array
    """Foot centre where the stance began, (L, 3) m, `odom`."""
    centre: Array
    """Foot centre at the sample before, (L, 3) m, `odom`."""
    rot: Array
    """rot_odom_from_foot at the sample before, (L, 3, 3)."""


@dataclass(eq=False)
class StanceSlip:
    """Measures how far each foot slides in its stances (times in which it stands), from sample to sample.

    Args:
        legs: number of feet L.
        radius: of the foot spheres, (L,) m; 0 = a sole.
    """

    legs: int
    radius: Array
    slip: Array = field(init=False)
    """Slip of the present stance, (L,) m; 0 in swing."""

    def __post_init__(self) -> None:
        n = self.legs
        samples, switched, last = np.zeros((3, n), dtype=np.int64)
        slip, height, farthest = np.zeros((3, n))
        begin, centre = np.zeros((2, n, 3))
        rot = np.tile(np.eye(3), (n, 1, 1))
        self._feet = FootWays(slip, samples, switched, last, np.zeros((n, 2)), height, farthest, begin, centre, rot)
        self.slip = self._feet.slip

    def risen(self, centre: Array) -> Array:
        """Return how high each foot is over the begin of its stance, (L,) m, 0 in swing; centre: in odom, (L, 3) m."""
        return np.where(self._feet.samples > 0, centre[:, 2] - self._feet.begin[:, 2], 0.0)

    def update(
        self, contact: Flags, centre: Array, rot_odom_from_foot: Array, faulty: Flags | None = None
    ) -> list[FinishedStance]:
        """Take one sample of all feet; return the stances that have ended.

        Args:
            contact: foot switches, True = closed, (L,).
            centre: foot centres in `odom`, (L, 3) m; a row that is not finite leaves its foot as it was.
            rot_odom_from_foot: rotation of each foot's link, (L, 3, 3).
            faulty: legs whose stance is spoilt if it ends now, (L,); None = none.
        """
        ended: list[FinishedStance] = []
        for leg in np.flatnonzero(_followed(self._feet, contact, centre, rot_odom_from_foot, self.radius)).tolist():
            feet = self._feet
            x, y, z = feet.begin[leg].tolist()
            healthy = faulty is None or not faulty[leg]
            if feet.last[leg] >= LEAST:
                counts = int(feet.last[leg]), int(feet.open[leg])
                ended.append(FinishedStance(leg, float(feet.slip[leg]), (x, y, z), *counts, healthy))
            feet.samples[leg], feet.slip[leg] = 0, 0.0
        return ended


@kernel
def _followed(feet: FootWays, contact: Flags, centre: Array, rot: Array, radius: Array) -> Flags:
    """Take one sample of all feet into `feet`, in place; return True for stances that have ended, (L,).

    Args:
        feet: path of each foot over its stance; changed.
        contact: foot switches, True = closed, (L,).
        centre: foot centres in odom, (L, 3) m; a row that is not finite leaves its foot as it was.
        rot: rot_odom_from_foot, (L, 3, 3).
        radius: of the foot spheres, (L,) m; 0 = a sole.
    """
    ended = np.zeros(contact.size, dtype=np.bool_)
    for leg in range(contact.size):
        known = True
        for i in range(3):
            known = known and math.isfinite(centre[leg, i])
        if not known:
            continue
        if feet.samples[leg] > 0:
            _step(feet, leg, contact[leg], centre[leg], rot[leg], radius[leg])
            high = centre[leg, 2] - feet.height[leg] > RISE
            ended[leg] = feet.open[leg] >= LONGEST_OPEN or (feet.open[leg] >= 2 and high)
        elif contact[leg]:
            feet.samples[leg] = feet.last[leg] = 1
            feet.open[leg], feet.farthest[leg], feet.slip[leg] = 0, 0.0, 0.0
            feet.way[leg, 0] = feet.way[leg, 1] = 0.0
            feet.begin[leg], feet.centre[leg], feet.rot[leg] = centre[leg], centre[leg], rot[leg]
            feet.height[leg] = centre[leg, 2]
    return ended


@kernel
def _step(feet: FootWays, leg: int, contact: bool, centre: Array, rot: Array, radius: float) -> None:
    """Add the way of a foot since its last sample, in place; it counts once contact is found again or was not lost.

    Args:
        feet: path of each foot over its stance; changed.
        leg: index of the foot.
        contact: its switch is closed.
        centre: its centre in `odom`, (3,) m.
        rot: rot_odom_from_foot, (3, 3).
        radius: of its sphere, m; 0 = a sole.
    """
    phi = rotvec_from_matrix(times_transposed(rot, feet.rot[leg]))
    now, before = 1.0 if contact else OPEN_WEIGHT, 1.0 if feet.open[leg] == 0 else OPEN_WEIGHT
    weight = 0.5 * (now + before)
    feet.way[leg, 0] += weight * (centre[0] - feet.centre[leg, 0] - radius * phi[1])
    feet.way[leg, 1] += weight * (centre[1] - feet.centre[leg, 1] + radius * phi[0])
    feet.centre[leg], feet.rot[leg] = centre, rot
    feet.samples[leg] += 1
    if not contact:
        feet.open[leg] += 1
        return
    feet.open[leg], feet.last[leg], feet.height[leg] = 0, feet.samples[leg], centre[2]
    x, y = feet.way[leg, 0], feet.way[leg, 1]
    feet.farthest[leg] = max(feet.farthest[leg], math.sqrt(x * x + y * y))
    feet.slip[leg] = math.sqrt(max(0.0, feet.farthest[leg] * feet.farthest[leg] - SIGMA * SIGMA))
