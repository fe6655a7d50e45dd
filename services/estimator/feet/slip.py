"""Slip of each foot over its stance, by the robot's own measurements.

A foot that rolls without slipping moves its centre by phi x (r n), phi the rotation of its link between two samples, r
the radius of the sphere, n the vertical. What the centre has moved beyond that, horizontally, is slip:

    d_k = (1 - n n') (c_k - c_{k-1} - phi_k x (r n)),   x_k = sum_{i <= k} w_i d_i,
    s^2 = max(0, max_k |x_k|^2 - sigma^2)

c is the foot centre in `odom`, from joints and odometry, so s holds the drift of the odometry over one stance as well.
The sum of |d_k| would add up noise (eight times the slip of a walk), the largest distance from the begin does not.
sigma is the apparent displacement of a foot at rest by the noise of encoders and odometry.

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
from .mount import FootMount

Counts = NDArray[np.int64]

RISE = 0.008
"""Rise of a foot over its height at the last contact, m, above which it is in swing if its switch is open."""
LONGEST_OPEN = 5
"""Number of samples in a row with an open switch that end a stance, whatever the height of the foot."""
OPEN_WEIGHT = 0.5
"""Weight w of a foot's displacement in a sample with an open switch, no unit; with a closed switch it is 1."""
SIGMA = 0.0005
"""Apparent slip of a resting foot in one stance, m, by errors of encoders (0.3 deg) and odometry; subtracted."""
LEAST = 2
"""Least number of samples with contact that make a stance; fewer may be a bump in the swing."""


@dataclass(frozen=True, slots=True)
class FinishedStance:
    """One finished stance (time in which a foot stood): how far the foot slid, where it began, how it was sampled."""

    leg: int
    slip: float
    """Slip: largest horizontal displacement of the foot in the stance by sliding, less noise, m."""
    begin: tuple[float, float, float]
    """Foot centre at the begin of the stance, odom, m."""
    samples: int
    """Number of samples from the first contact of the stance to its last."""
    since: int
    """Number of samples since the last contact of the stance."""
    healthy: bool = True
    """True if no fault of the leg was found; False: an encoder or switch of the leg was faulty."""


def feet_in_odom(
    mount: FootMount, seen: tuple[Array, Array], pose: OdometryPose, behind_s: float = 0.0
) -> tuple[Array, Array]:
    """Return foot centres in odom, (L, 3) m, and rot_odom_from_foot (L, 3, 3).

    Args:
        mount: mounting of the IMU in base_link.
        seen: foot centres from the IMU, IMU axes, (L, 3) m, and rot_imu_from_foot (L, 3, 3), as of `feet_in_imu`.
        pose: pose and velocity of base_link in odom.
        behind_s: age of the joint angles against the pose, s: the trunk is moved back by its velocity times this age.
    """
    begin = pose.position - behind_s * pose.velocity
    return _turned(*seen, pose.quat_wxyz, mount.rot_imu_from_base, mount.imu_position, begin)


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
        begin: position of base_link in `odom`, (3,) m.
    """
    base = matrix_from_quat(quat_wxyz)
    turn, at = times_transposed(base, rot_imu_from_base), begin + times_vector(base, imu_position)
    centres, turned = np.empty(position.shape), np.empty(rot.shape)
    for f in range(position.shape[0]):
        centres[f], turned[f] = times_vector(turn, position[f]) + at, times(turn, rot[f])
    return centres, turned


class FootWays(NamedTuple):
    """Path of each of L feet over its present stance (time in which it stands), updated with each sample."""

    slip: Array
    """Slip of each foot in its present stance, (L,) m; 0 in swing."""
    samples: Counts
    """Number of samples since the stance of each foot began, (L,); 0 in swing."""
    open: Counts
    """Number of samples since the switch of each foot was closed last, (L,)."""
    last: Counts
    """Number of samples from the begin of each foot's stance to its last contact, (L,)."""
    way: Array
    """Horizontal displacement x of each foot by slip in the stance so far, without rolling, axes of odom, (L, 2) m."""
    height: Array
    """Height of each foot's centre at its last contact, odom, (L,) m."""
    farthest: Array
    """Largest |x| of each foot in the stance so far, (L,) m; x: horizontal displacement by slip."""
    begin: Array
    """Foot centres where their stances began, odom, (L, 3) m."""
    centre: Array
    """Foot centres at the previous sample, odom, (L, 3) m."""
    rot: Array
    """rot_odom_from_foot of each foot at the previous sample, (L, 3, 3)."""


@dataclass(eq=False)
class StanceSlip:
    """Measurement of how far each foot slides in its stances (times in which it stands), from sample to sample.

    Args:
        legs: number of feet L.
        radius: radii of the foot spheres, (L,) m; 0 = a sole.
    """

    legs: int
    radius: Array
    slip: Array = field(init=False)
    """Slip of each foot in its present stance, (L,) m; 0 in swing."""

    def __post_init__(self) -> None:
        n = self.legs
        samples, switched, last = np.zeros((3, n), dtype=np.int64)
        slip, height, farthest = np.zeros((3, n))
        begin, centre = np.zeros((2, n, 3))
        rot = np.tile(np.eye(3), (n, 1, 1))
        self._feet = FootWays(slip, samples, switched, last, np.zeros((n, 2)), height, farthest, begin, centre, rot)
        self.slip = self._feet.slip

    def risen(self, centre: Array) -> Array:
        """Return the rise of each foot since its stance began, (L,) m, 0 in swing; centre: in odom, (L, 3) m."""
        return np.where(self._feet.samples > 0, centre[:, 2] - self._feet.begin[:, 2], 0.0)

    def update(
        self, contact: Flags, centre: Array, rot_odom_from_foot: Array, faulty: Flags | None = None
    ) -> list[FinishedStance]:
        """Update the stances with one sample of all feet; return those that have ended.

        Args:
            contact: foot switches, True = closed, (L,).
            centre: foot centres in `odom`, (L, 3) m; a row that is not finite leaves its foot as it was.
            rot_odom_from_foot: rotation of each foot's link, (L, 3, 3).
            faulty: True for legs whose stance is unusable if it ends now, (L,); None = none.
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
    """Update `feet` with one sample of all feet, in place; return True for stances that have ended, (L,).

    Args:
        feet: path of each foot over its stance; changed.
        contact: foot switches, True = closed, (L,).
        centre: foot centres in odom, (L, 3) m; a row that is not finite leaves its foot as it was.
        rot: rot_odom_from_foot, (L, 3, 3).
        radius: radii of the foot spheres, (L,) m; 0 = a sole.
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
    """Add the displacement of a foot since its last sample, in place; slip is updated at samples with contact only.

    Args:
        feet: path of each foot over its stance; changed.
        leg: index of the foot.
        contact: True = its switch is closed.
        centre: centre of the foot in `odom`, (3,) m.
        rot: rot_odom_from_foot, (3, 3).
        radius: radius of the foot sphere, m; 0 = a sole.
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
