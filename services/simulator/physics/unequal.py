"""Legs that differ from their description: a biped whose straight walk is an arc.

Both legs are made a little crooked, as bent links or badly set servos do: the foot that a set-point places dx ahead of
its neutral place turns by kappa dx about the trunk, and the legs of the outer side advance further than those of the
inner one. With p the foot in base_link that the set-points mean, R its rotation, z up and kappa the drift in rad per m,

    p' = Rz(kappa dx) p - (0, kappa dx^2 / 2, 0),    R' = Rz(kappa dx) R.

A standing foot moves dx backwards under the trunk; seen from that foot the trunk goes along an arc of curvature kappa,
and so it does from the other foot: none has to slip. The set-points dq that lead from p, R to p', R' come from one
Newton step; of a robot whose legs share a joint the trunk takes the mean turn that the legs cannot.
"""

import numpy as np

from surefoot.arrays import Array, Ints
from surefoot.kernels.jit import kernel
from surefoot.robot import kinematics
from surefoot.robot.description import KinematicModel, Robot

from .disturb import WorldError

ROWS = 6  # of a foot: 3 of its place, 3 of its turn


class UnequalLegs:
    """Converter of set-points to the joint angles at which straight legs stand like crooked ones.

    Args:
        robot: a biped with soles.
        drift: turn of the trunk by way walked, rad/m, left positive; 0 = straight legs.

    Raises:
        WorldError: the robot has no soles to turn it.
    """

    def __init__(self, robot: Robot, drift: float) -> None:
        self.drift, self._model, self._upper, self._lower = drift, robot.model, robot.joint_upper, robot.joint_lower
        if drift != 0.0 and (robot.kind != "biped" or any(len(leg.joints) != ROWS for leg in robot.legs)):
            raise WorldError("drift", f"is for robots with two legs of six joints, got {drift!r} for {robot.name}")
        self._joints = np.array(sorted({j for leg in robot.legs for j in leg.joints}), dtype=np.int64)
        self._neutral = kinematics.foot_positions(robot.model, robot.neutral)[:, 0]
        self(robot.neutral)  # loads the kernel now, not in the first tick

    def __call__(self, set_points: Array) -> Array:
        """Return the joint angles that crooked legs make of set-points, (nj,) rad, within the joints' limits."""
        if self.drift == 0.0:
            return set_points
        found = bent(self._model, set_points, self._joints, self._neutral, self.drift)
        return np.clip(found, self._lower, self._upper)


@kernel
def bent(model: KinematicModel, q: Array, joints: Ints, neutral: Array, drift: float) -> Array:
    """Return the joint angles, (nj,) rad, that set the feet where crooked legs have them, by one Newton step from `q`.

    A straight walk with them turns by `drift`. Joint limits are not applied.

    Args:
        model: the robot, two legs of six joints, of which one may be shared.
        q: set-points, (nj,) rad.
        joints: indices of the joints of both legs, each once, (11 or 12,).
        neutral: forward place of each foot at the neutral stance, (2,) m, base_link.
        drift: turn of the trunk by way walked, rad/m, left positive.
    """
    rot, pos = kinematics.forward(model, q)
    feet = kinematics.foot_positions_of(model, rot, pos)
    n, rows = joints.size, ROWS * feet.shape[0]
    a = np.zeros((rows, rows + 1))
    for i in range(feet.shape[0]):
        first, dx = ROWS * i, feet[i, 0] - neutral[i]
        turn = drift * dx
        a[first, rows] = -turn * feet[i, 1]
        a[first + 1, rows] = turn * feet[i, 0] - 0.5 * turn * dx
        a[first + 5, rows] = turn
        link = model.foot_link[i]
        while link > 0:
            j = model.joint[link]
            for c in range(n):
                if joints[c] == j:
                    _column(a, first, c, rot[link], model.axis[link], feet[i], pos[link])
            link = model.parent[link]
        if n < rows:  # the trunk turns: seen from it, both feet turn the other way
            a[first, n] = -feet[i, 1]
            a[first + 1, n] = feet[i, 0]
            a[first + 5, n] = 1.0
    _eliminate(a)
    out = q.copy()
    for c in range(n):
        out[joints[c]] += a[c, rows]
    return out


@kernel
def _column(a: Array, first: int, c: int, rot: Array, axis: Array, foot: Array, origin: Array) -> None:
    """Add the motion of a foot by a joint, per rad, to column c of `a` (12, 13): rows first .. first + 5, in place.

    The rows are place x, y, z (m) and turn about x, y, z. `rot` (3, 3): rotation from the joint's link to base_link;
    `axis` (3,): of the joint in that link; `foot`, and `origin` of the joint: (3,) m; base_link axes.
    """
    turn, arm = np.empty(3), np.empty(3)
    for i in range(3):
        turn[i] = rot[i, 0] * axis[0] + rot[i, 1] * axis[1] + rot[i, 2] * axis[2]
        arm[i] = foot[i] - origin[i]
    a[first, c] += turn[1] * arm[2] - turn[2] * arm[1]
    a[first + 1, c] += turn[2] * arm[0] - turn[0] * arm[2]
    a[first + 2, c] += turn[0] * arm[1] - turn[1] * arm[0]
    for i in range(3):
        a[first + 3 + i, c] += turn[i]


@kernel
def _eliminate(a: Array) -> None:
    """Solve linear equations, a (n, n + 1) with the right side last, which becomes the solution; in place.

    It becomes zero if the equations are singular: a stretched leg.
    """
    n = a.shape[0]
    for i in range(n):
        pivot = i
        for k in range(i + 1, n):
            if abs(a[k, i]) > abs(a[pivot, i]):
                pivot = k
        if abs(a[pivot, i]) < 1e-9:
            a[:, n] = 0.0
            return
        for c in range(n + 1):
            swap = a[i, c]
            a[i, c] = a[pivot, c]
            a[pivot, c] = swap
        scale = 1.0 / a[i, i]
        for c in range(i, n + 1):
            a[i, c] *= scale
        for k in range(n):
            if k != i and a[k, i] != 0.0:
                factor = a[k, i]
                for c in range(i, n + 1):
                    a[k, c] -= factor * a[i, c]
