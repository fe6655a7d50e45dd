"""CoM shift in the trunk while the feet stay (second step of 4.3): r_KIN = com(q after) - com(q now)."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from surefoot.geometry.linear import product
from surefoot.geometry.linear_kernels import solve3
from surefoot.kernels.jit import kernel
from surefoot.robot.description import KinematicModel, Robot
from surefoot.robot.kinematics import com, foot_jacobians_of, foot_positions, foot_positions_of, forward

from ..programs.contacts import Array, ContactSet, StabilityError

Flags = NDArray[np.bool_]

NEAR = 0.03  # m; a contact belongs to a leg whose foot sphere is nearer than that
REACHED = 1e-6  # m; a foot that stays further off its place is out of reach
LIMIT_SLACK = 1e-6  # rad
ITERATIONS = 30
LONGEST_TURN = 0.5  # rad; Newton steps are cut to it


@dataclass(frozen=True, slots=True)
class Shift:
    """Effect of a movement of the trunk over its standing feet."""

    vector: Array
    """(3,) m, CoM after minus CoM now, seen from the trunk, axes of the world."""
    joints: Array
    """(nj,) rad, after the movement."""
    reachable: bool
    """Every stance leg keeps its foot in place with all joints inside their limits."""


def kinematic_shift(robot: Robot, joints: Array, rot_world_from_base: Array, movement: Array, stance: Flags) -> Shift:
    """Move the trunk by `movement` (3,) m, world axes, with the feet of the stance legs (L,) held in place."""
    if not movement.any():
        return Shift(np.zeros(3), joints.copy(), True)
    move = product(rot_world_from_base.T, movement)
    after, reachable = hold_feet(robot.model, joints, move, stance)
    vector = product(rot_world_from_base, com(robot.model, after) - com(robot.model, joints))
    return Shift(vector, after, bool(reachable))


@kernel
def hold_feet(model: KinematicModel, joints: Array, move: Array, stance: Flags) -> tuple[Array, bool]:
    """Joint angles that keep the stance feet where they are when the trunk moves by `move` (3,), base_link axes.

    Newton's method from the present angles, dq = J'(J J')^-1 e: it stays on the leg's own branch, and legs with more
    than three joints take the shortest way.
    """
    rot, pos = forward(model, joints)
    q, start = joints.copy(), foot_positions_of(model, rot, pos)
    legs, width = model.leg_joints.shape
    error, gram = np.empty(3), np.empty((3, 3))
    worst = 0.0
    for _ in range(ITERATIONS):
        rot, pos = forward(model, q)
        feet, jac = foot_positions_of(model, rot, pos), foot_jacobians_of(model, rot, pos)
        worst = 0.0
        for i in range(legs):
            if not stance[i]:
                continue
            for r in range(3):
                error[r] = start[i, r] - move[r] - feet[i, r]
            worst = max(worst, math.sqrt(error[0] * error[0] + error[1] * error[1] + error[2] * error[2]))
            for r in range(3):
                for s in range(3):
                    gram[r, s] = 0.0
                    for k in range(width):
                        gram[r, s] += jac[i, r, k] * jac[i, s, k]
                gram[r, r] += 1e-12
            push = solve3(gram, error)
            for k in range(width):
                j = model.leg_joints[i, k]
                if j >= 0:
                    turn = jac[i, 0, k] * push[0] + jac[i, 1, k] * push[1] + jac[i, 2, k] * push[2]
                    q[j] += min(LONGEST_TURN, max(-LONGEST_TURN, turn))
        if worst < 1e-12:
            break
    reachable = bool(worst < REACHED)
    for i in range(legs):
        for k in range(width):
            j = model.leg_joints[i, k]
            if stance[i] and j >= 0:
                inside = model.lower[j] - LIMIT_SLACK <= q[j] <= model.upper[j] + LIMIT_SLACK
                if not inside and abs(q[j] - joints[j]) > LIMIT_SLACK:
                    reachable = False
    return q, reachable


def stance_legs(
    robot: Robot,
    joints: Array,
    rot_world_from_base: Array,
    base: Array,
    contacts: ContactSet,
    names: tuple[str | None, ...],
) -> Flags:
    """Which legs stand on the contacts: by name where given, else the leg whose foot is nearest (within 3 cm).

    If no contact is near a foot, the contacts are in another frame than the base: then all legs are taken to stand.

    Raises:
        StabilityError: a name is unknown or used twice.
    """
    known = [leg.name for leg in robot.legs]
    stance = np.zeros(len(known), dtype=np.bool_)
    feet = base + product(foot_positions(robot.model, joints), rot_world_from_base.T)
    for i, name in enumerate(names):
        if name is None:
            continue
        if name not in known:
            allowed = ", ".join(known)
            raise StabilityError(
                "unknown_leg", f"contacts.{i}.leg", f"got {name!r}, legs of {robot.name} are {allowed}"
            )
        leg = known.index(name)
        if stance[leg]:
            raise StabilityError("duplicate_leg", f"contacts.{i}.leg", f"{name!r} stands on another contact already")
        stance[leg] = True
    radius = np.array([leg.foot.radius for leg in robot.legs])
    for i, name in enumerate(names):
        if name is None:
            distance = np.linalg.norm(feet - contacts.position[i], axis=1) - radius
            leg = int(distance.argmin())
            if distance[leg] < NEAR:
                stance[leg] = True
    return stance if stance.any() else np.ones_like(stance)
