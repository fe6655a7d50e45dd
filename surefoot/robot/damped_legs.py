"""Inverse kinematics of legs without a closed form, by damped least squares from the neutral posture."""

import math

import numpy as np

from surefoot.arrays import Array
from surefoot.geometry.rotations import axis_angle_into
from surefoot.kernels.jit import kernel

from .description import KinematicModel

ROUNDS = 100
"""Largest number of iterations of the inverse kinematics, after which the point counts as out of reach; usually five to
ten suffice."""
NEAR = 1e-10  # m, distance from the wanted point at which it counts as reached
EASIEST, HARDEST = 1e-6, 1e6  # bounds of the damping, m2


@kernel
def damped_ik(model: KinematicModel, leg: int, p_base: Array) -> tuple[Array, bool]:
    """Return joint angles of a leg of any kind that bring the foot centre to `p_base` (Levenberg and Marquardt).

    dq = J' (J J' + d I)^-1 (p_base - p(q)), q + dq clipped to the joint limits; the damping d shrinks after a step that
    reduces the error, and grows after any other step, which is undone.

    Args:
        model: the robot.
        leg: index of the leg.
        p_base: foot centre in base_link, (3,) m.

    Returns:
        The angles (n,) rad within the joint limits, the nearest ones found if the point is out of reach, and whether
        the point is reached.
    """
    width = model.leg_joints.shape[1]
    count = 0
    while count < width and model.leg_joints[leg, count] >= 0:
        count += 1
    joints = model.leg_joints[leg, :count]
    q, trial = np.empty(count), np.empty(count)
    for c in range(count):
        q[c] = model.neutral[joints[c]]
    jac, next_jac = np.zeros((3, count)), np.zeros((3, count))
    foot, next_foot = np.empty(3), np.empty(3)
    _reach(model, leg, q, foot, jac)
    off = _distance(p_base, foot)
    damping = 1e-4
    for _ in range(ROUNDS):
        if not off > NEAR or damping > HARDEST:
            break
        push = _damped(jac, p_base - foot, damping)
        for c in range(count):
            step = q[c] + jac[0, c] * push[0] + jac[1, c] * push[1] + jac[2, c] * push[2]
            trial[c] = min(model.upper[joints[c]], max(model.lower[joints[c]], step))
        _reach(model, leg, trial, next_foot, next_jac)
        away = _distance(p_base, next_foot)
        if away < off:
            off = away
            q[:], foot[:], jac[:] = trial, next_foot, next_jac
            damping = max(EASIEST * 1e-6, 0.1 * damping)
        else:
            damping = max(EASIEST, 10.0 * damping)
    return q, off <= NEAR


@kernel
def _distance(a: Array, b: Array) -> float:
    return math.sqrt((a[0] - b[0]) ** 2 + (a[1] - b[1]) ** 2 + (a[2] - b[2]) ** 2)


@kernel
def _damped(jac: Array, error: Array, damping: float) -> Array:
    """Return (J J' + d I)^-1 e, (3,), by Cramer's rule: the matrix is positive definite.

    J = `jac` (3, n) m/rad, e = `error` (3,) m.
    """
    m = np.zeros((3, 3))
    for a in range(3):
        for b in range(3):
            for c in range(jac.shape[1]):
                m[a, b] += jac[a, c] * jac[b, c]
        m[a, a] += damping
    out = np.zeros(3)
    for k in range(3):
        i, j = (k + 1) % 3, (k + 2) % 3
        for r in range(3):
            s, t = (r + 1) % 3, (r + 2) % 3
            out[k] += (m[s, i] * m[t, j] - m[t, i] * m[s, j]) * error[r]
    det = 0.0
    for r in range(3):
        s, t = (r + 1) % 3, (r + 2) % 3
        det += m[r, 0] * (m[s, 1] * m[t, 2] - m[t, 1] * m[s, 2])
    return out / det


@kernel
def _reach(model: KinematicModel, leg: int, angles: Array, foot: Array, jac: Array) -> None:
    """Write the foot centre in base_link (3,) m and its Jacobian (3, n) for the angles (n,) of one leg's joints."""
    way = np.empty(model.parent.size, dtype=np.int64)
    size, link = 0, model.foot_link[leg]
    while link > 0:
        way[size] = link
        size, link = size + 1, model.parent[link]
    rot, pos = np.eye(3), np.zeros(3)
    turn, half = np.empty((3, 3)), np.empty((3, 3))
    axes, places = np.zeros((3, angles.size)), np.zeros((3, angles.size))
    for k in range(size - 1, -1, -1):
        link = way[k]
        column = -1
        for c in range(angles.size):
            if model.leg_joints[leg, c] == model.joint[link]:
                column = c
        for d in range(3):
            for e in range(3):
                pos[d] += rot[d, e] * model.origin_pos[link, e]
        _times(half, rot, model.origin_rot[link])
        rot[:] = half
        if column < 0:
            continue
        for d in range(3):
            places[d, column] = pos[d]
            for e in range(3):
                axes[d, column] += rot[d, e] * model.axis[link, e]
        axis_angle_into(turn, model.axis[link], float(angles[column]))
        _times(half, rot, turn)
        rot[:] = half
    for d in range(3):
        foot[d] = pos[d]
        for e in range(3):
            foot[d] += rot[d, e] * model.foot_point[leg, e]
    for c in range(angles.size):
        for d in range(3):
            i, j = (d + 1) % 3, (d + 2) % 3
            jac[d, c] = axes[i, c] * (foot[j] - places[j, c]) - axes[j, c] * (foot[i] - places[i, c])


@kernel
def _times(out: Array, a: Array, b: Array) -> None:
    for d in range(3):
        for e in range(3):
            out[d, e] = a[d, 0] * b[0, e] + a[d, 1] * b[1, e] + a[d, 2] * b[2, e]
