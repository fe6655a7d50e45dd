"""Gains of the torque measurement from poses of the standing robot (Walas & Belter 4.7, corrected).

Walas & Belter move the trunk 10 cm to either side and divide this distance by the measured one of the CoM. That fixes
the sum of both distances only, takes the weight for granted and leaves offsets in. Here every pose i gives the six
equations of rest, linear in the factors s of the torques (tau = s tau_reported) and in an offset d of the CoM in the
trunk:

    sum over standing feet of A1 J^-T (G - tau_reported s) = (0, 0, mg, mg (c_y + d_y), -mg (c_x + d_x), 0)

with c the CoM by kinematics, J the Jacobian of a foot, G the torques that hold its leg, A1 the map of a foot's force to
force and moment about the mean foot. They are weighted by the noise of the torques; a prior keeps the factors near each
other where the poses do not separate them.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from surefoot.arrays import Array, Flags
from surefoot.geometry.linear import dot, norm, product, solve
from surefoot.robot.description import Robot
from surefoot.robot.kinematics import com, foot_positions

from ..programs.contacts import StabilityError
from .forces import leg_inverses

COMMON_SD = 0.5  # prior standard deviation of the common factor (1 = as reported)
APART_SD = 0.03  # prior standard deviation of one joint's factor from the common one
OFFSET_SD = 0.02  # m, prior standard deviation of the CoM's offset


@dataclass(frozen=True, slots=True)
class SweptPose:
    """Pose of the robot at rest, with the samples that were measured in it."""

    joints: Array
    """Joint angles of the pose, (nj,) rad."""
    torque: Array
    """Joint torques as reported, (nj,) Nm: current times the torque constant that the driver assumes."""
    g_up: Array
    """Upward specific force at rest, base_link, (3,) m/s^2."""
    stance: Flags
    """True for feet that stand in the pose, (L,)."""


class PoseCollector:
    """Collector of poses from a stream of samples: means over windows in which the robot rests, one per posture."""

    def __init__(self, window: int = 15, still: float = 0.012, apart: float = 0.02) -> None:
        """Create a collector without poses.

        Args:
            window: number of samples in a row whose mean is a pose.
            still: largest range of a joint angle in the window, rad; with more the robot moves.
            apart: least change of some joint from the previous pose, rad; with less it is no new pose.
        """
        self.poses: list[SweptPose] = []
        self._window, self._still, self._apart = window, still, apart
        self._recent: list[tuple[Array, Array, Array, Flags]] = []

    def add(self, joints: Array, torque: Array, g_up: Array, stance: Flags) -> bool:
        """Add a sample to the window; return True if it completed a pose, which is then the last of `poses`.

        Args:
            joints: angles, (nj,) rad.
            torque: joint torques as reported, (nj,) Nm.
            g_up: upward specific force at rest, base_link, (3,) m/s^2.
            stance: True for feet on the ground, (L,).
        """
        self._recent.append((joints, torque, g_up, stance))
        del self._recent[: -self._window]
        if len(self._recent) < self._window:
            return False
        q = np.array([row[0] for row in self._recent])
        same = all(np.array_equal(row[3], stance) for row in self._recent)
        if not same or not stance.any() or float(np.ptp(q, axis=0).max()) > self._still:
            return False
        middle = q.mean(axis=0)
        if self.poses and float(np.abs(middle - self.poses[-1].joints).max()) < self._apart:
            return False
        torques = np.mean([row[1] for row in self._recent], axis=0)
        up = np.mean([row[2] for row in self._recent], axis=0)
        self.poses.append(SweptPose(middle, torques, up, stance.copy()))
        self._recent.clear()
        return True


@dataclass(frozen=True, slots=True)
class Calibration:
    """Factors by which reported torques have to be multiplied, no unit, with their standard deviations.

    They are found from the equations of rest in a number of poses.
    """

    common: float
    """Single factor for the torques of all joints, no unit: mean of `gain` weighted by the torques' mean squares."""
    common_sd: float
    gain: Array
    """Factor on the reported torque of each joint, (nj,), no unit."""
    gain_sd: Array
    offset: Array
    """Displacement of the CoM from its position by kinematics, (2,) m, x forward, y left."""
    residual: float
    """Root mean square of the residuals of the force equations, N."""
    poses: int


def calibrate(
    robot: Robot, poses: Sequence[SweptPose], torque_variance: float, apart_sd: float = APART_SD
) -> Calibration:
    """Fit the factors by which reported joint torques have to be multiplied.

    Args:
        robot: the robot; legs of three joints.
        poses: at least one; 18 factors need three, and five or more are well conditioned.
        torque_variance: variance of each torque, Nm^2.
        apart_sd: standard deviation by which the joints' factors may differ; 0 = one factor for all.

    Raises:
        StabilityError: no pose can be used.
    """
    nj = robot.nj
    information, right = np.zeros((nj + 2, nj + 2)), np.zeros(nj + 2)
    blocks: list[tuple[Array, Array]] = []
    for number, pose in enumerate(poses):
        found = equations(robot, pose)
        if found is None:
            continue
        a, b, per_torque = found
        noise = torque_variance * product(per_torque, per_torque.T)
        noise += 1e-9 * np.trace(noise) * np.eye(6)
        if not np.isfinite(noise).all():
            raise StabilityError("not_finite", f"poses.{number}", "gives equations that are not finite")
        weighted = solve(noise, np.column_stack((a, b)))
        information += product(a.T, weighted[:, :-1])
        right += product(a.T, weighted[:, -1])
        blocks.append((a, b))
    if not blocks:
        raise StabilityError("no_pose", "poses", f"none of {len(poses)} poses has observed legs on the ground")
    mean = np.concatenate((np.ones(nj), np.zeros(2)))
    spread = np.zeros((nj + 2, nj + 2))
    spread[:nj, :nj] = COMMON_SD**2 * np.ones((nj, nj)) + max(apart_sd, 1e-6) ** 2 * np.eye(nj)
    spread[nj:, nj:] = OFFSET_SD**2 * np.eye(2)
    prior = solve(spread, np.eye(nj + 2))
    covariance = solve(information + prior, np.eye(nj + 2))
    best = product(covariance, right + product(prior, mean))
    used = _used(robot, poses)
    share = used / used.sum()
    rest = np.concatenate([(product(a, best) - b)[:3] for a, b in blocks])
    return Calibration(
        common=dot(share, best[:nj]),
        common_sd=math.sqrt(dot(share, product(covariance[:nj, :nj], share))),
        gain=best[:nj],
        gain_sd=np.sqrt(np.diag(covariance)[:nj]),
        offset=best[nj:],
        residual=float(np.sqrt(np.mean(rest**2))),
        poses=len(blocks),
    )


def _used(robot: Robot, poses: Sequence[SweptPose]) -> Array:
    """Return the mean square of each joint torque, (nj,) Nm^2, by which a common factor is averaged."""
    square = np.mean([pose.torque**2 for pose in poses], axis=0)
    return square + 1e-12 * np.ones(robot.nj)


def equations(robot: Robot, pose: SweptPose) -> tuple[Array, Array, Array] | None:
    """Return the six equations of rest of a pose for the torque factors; None when a standing leg is not observed.

    Axes are level, x along the heading, moments are about the mean foot; rows are forces x, y, z, N, then moments, N m.

    Returns:
        Matrix (6, nj + 2) of the factors and the offset of the CoM (x, y of the trunk, m), right side (6,), and what
        one Nm of each joint torque adds to each equation, (6, nj).
    """
    found = leg_inverses(robot, pose.joints, pose.g_up)
    if not pose.stance.any() or not found.observed[pose.stance].all():
        return None
    size = norm(pose.g_up)
    rot = level_from_up(pose.g_up / size)
    feet, nj = product(foot_positions(robot.model, pose.joints), rot.T), robot.nj
    feet[:, 2] -= [leg.foot.radius for leg in robot.legs]
    centre = feet[pose.stance].mean(axis=0)
    per_torque, own = np.zeros((6, nj)), np.zeros(6)
    for i in np.flatnonzero(pose.stance):
        inverse, joints = product(rot, found.inverse[i]), robot.model.leg_joints[i, :3]
        arm = feet[i] - centre
        cross = np.array([[0.0, -arm[2], arm[1]], [arm[2], 0.0, -arm[0]], [-arm[1], arm[0], 0.0]])
        both = np.vstack((inverse, product(cross, inverse)))  # (6, 3)
        per_torque[:, joints] += both
        own += product(both, found.own[joints])
    weight = robot.mass * size
    middle = product(rot, com(robot.model, pose.joints)) - centre
    a = np.zeros((6, nj + 2))
    a[:, :nj] = per_torque * pose.torque
    # sum F = own - a s must equal the weight; its moment c x (mg e_z) = mg (c_y, -c_x, 0)
    b = own - np.array([0.0, 0.0, weight, weight * middle[1], -weight * middle[0], 0.0])
    ahead, left = rot[:2, 0], rot[:2, 1]  # the trunk's axes, level
    a[3, nj], a[3, nj + 1] = weight * ahead[1], weight * left[1]
    a[4, nj], a[4, nj + 1] = -weight * ahead[0], -weight * left[0]
    return a, b, per_torque


def level_from_up(up: Array) -> Array:
    """Return rot_level_from_base (3, 3) for the unit vector `up` (3,), base_link: x along the trunk's heading."""
    x = np.array([1.0, 0.0, 0.0]) - up[0] * up
    x /= norm(x)
    y = np.array([up[1] * x[2] - up[2] * x[1], up[2] * x[0] - up[0] * x[2], up[0] * x[1] - up[1] * x[0]])
    return np.vstack((x, y, up))


def gain_of_47(moved: float, measured: Sequence[float]) -> float:
    """Return the single gain of Walas & Belter 4.7: distance moved over the sum of those measured, no unit.

    `moved`: whole distance of the trunk, m; `measured`: distance by the forces in each movement, m. Walas & Belter: 20
    / 26.59 = 0.752.
    """
    return moved / float(np.sum(measured))
