"""CoM shift in the trunk while the feet stay (Walas & Belter 4.3, second step): r_KIN = com(q after) - com(q now)."""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from surefoot.arrays import Array, Flags
from surefoot.geometry.constants import GRAVITY
from surefoot.geometry.linear import norm, product
from surefoot.geometry.linear_kernels import solve3
from surefoot.geometry.rotations import matrix_from_quat
from surefoot.kernels.jit import kernel, row_kernel
from surefoot.robot.description import KinematicModel, Robot
from surefoot.robot.kinematics import (
    com,
    foot_jacobians_of,
    foot_positions,
    foot_positions_of,
    forward,
    gravity_torques,
)
from surefoot.schemas.stability import Actuation, BasePose

from ..programs.contacts import ContactSet, StabilityError, within
from ..regions.actuated import ServoLegs

NEAR = 0.03  # m; a contact belongs to a leg whose foot sphere is nearer than that
REACHED = 1e-6  # m; a foot that stays further off its place is out of reach
JOINT_SLACK = 1e-6  # rad
ITERATIONS = 30
LONGEST_TURN = 0.5  # rad; Newton steps are cut to it


@dataclass(frozen=True, slots=True)
class Shift:
    """Effect of a movement of the trunk over its standing feet."""

    vector: Array
    """Displacement of the CoM relative to the trunk by the movement, axes of frame world, (3,) m."""
    after: "PosedRobot"
    """Robot in its posture after the movement."""
    reachable: bool
    """True if every stance leg keeps its foot in place with all joints inside their limits, False if one does not."""


@kernel
def hold_feet(model: KinematicModel, joints: Array, move: Array, stance: Flags) -> tuple[Array, bool]:
    """Return joint angles that keep the stance feet in place when the trunk moves, and True if they do.

    Newton's method from the present angles, dq = J'(J J')^-1 e (J Jacobian of a foot, e its error): it stays on the
    leg's own branch, and legs with more than three joints take the smallest change of angles.

    Args:
        model: links and joints of the robot.
        joints: present angles, (nj,) rad.
        move: movement of the trunk, (3,) m, base_link axes.
        stance: True for feet on the ground, (L,).

    Returns:
        Angles (nj,) rad, and True if feet are in place within 1e-6 m and no joint has moved beyond its limits.
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
                inside = model.lower[j] - JOINT_SLACK <= q[j] <= model.upper[j] + JOINT_SLACK
                if not inside and abs(q[j] - joints[j]) > JOINT_SLACK:
                    reachable = False
    return q, reachable


@dataclass(frozen=True, slots=True)
class PosedRobot:
    """A robot in a posture: joint angles and pose of the trunk, frame world."""

    robot: Robot
    """Description of the robot: links, joints, legs."""
    joints: Array
    """Angles of all joints, (nj,) rad."""
    base: Array
    """Origin of base_link in frame world, (3,) m."""
    rot: Array
    """Rotation from base_link to frame world, (3, 3)."""

    def com(self) -> Array:
        """Return the centre of mass by kinematics, (3,) m, frame world."""
        return com_in_world(self.robot.model, self.joints, self.rot, self.base)

    def moved(self, movement: Array, stance: Flags) -> Shift:
        """Return the effect of moving the trunk by `movement` (3,) m, world axes; feet of `stance` (L,) stay."""
        if not movement.any():
            return Shift(np.zeros(3), self, True)
        vector, joints, reachable = _moved(self.robot.model, self.joints, self.rot, movement, stance)
        after = PosedRobot(self.robot, joints, self.base + movement, self.rot)
        return Shift(vector, after, bool(reachable))

    def standing_legs(self, contacts: ContactSet, names: tuple[str | None, ...]) -> Flags:
        """Return True for legs (L,) that stand on contacts: by name where given, else that of the nearest foot (3 cm).

        `names`: leg of each contact, None = not given. If no contact is near a foot, the contacts are in another frame
        than the base: then all legs are taken to stand.

        Raises:
            StabilityError: a name is unknown or used twice.
        """
        feet = feet_in_world(self.robot.model, self.joints, self.rot, self.base)
        stance = np.zeros(self.robot.nlegs, dtype=np.bool_)
        for i, name in enumerate(names):
            if name is not None:
                leg = self._leg_named(name, i)
                if stance[leg]:
                    raise _twice(name, i)
                stance[leg] = True
        for i, name in enumerate(names):
            if name is None:
                distance = _distance(feet, contacts.position[i]) - self.robot.foot_radii
                if distance.min() < NEAR:
                    stance[int(distance.argmin())] = True
        return stance if stance.any() else np.ones_like(stance)

    def loaded_legs(self, contacts: ContactSet, names: tuple[str | None, ...]) -> list[int]:
        """Return the index of the leg on each contact: by name, else (None) that whose foot is nearest, within 3 cm.

        Raises:
            StabilityError: a name is unknown, or a leg is used twice, or its foot is not near the contact.
        """
        feet = feet_in_world(self.robot.model, self.joints, self.rot, self.base)
        known, out = [leg.name for leg in self.robot.legs], list[int]()
        for i, name in enumerate(names):
            distance = _distance(feet, contacts.position[i]) - self.robot.foot_radii
            leg = int(distance.argmin()) if name is None else self._leg_named(name, i)
            if distance[leg] >= NEAR:
                foot = f"the foot nearest to it, of {known[leg]}" if name is None else f"the foot of {name}"
                where = f"is {distance[leg]:.3f} m away in the posture given"
                raise StabilityError("missing", f"contacts.{i}.leg", f"{foot}, {where}")
            if leg in out:
                raise _twice(known[leg], i)
            out.append(leg)
        return out

    def _leg_named(self, name: str, contact: int) -> int:
        known = [leg.name for leg in self.robot.legs]
        if name not in known:
            allowed = f"legs of {self.robot.name} are {', '.join(known)}"
            raise StabilityError("unknown_leg", f"contacts.{contact}.leg", f"got {name!r}, {allowed}")
        return known.index(name)


class HeldRobot(NamedTuple):
    """Posture of a robot on its contacts, with the legs that stand and the torque limits of its servos."""

    stands: PosedRobot
    """Posture of the robot, frame world."""
    legs: list[int]
    """Index of the leg on each contact, in the order of the contacts."""
    limit: Array
    """Largest torques of the servos of all joints, (nj,) Nm."""
    servos: ServoLegs
    """Jacobians and torques of the servos of the standing legs, in the order of the contacts."""


def held(robot: Robot, asked: Actuation, contacts: ContactSet, names: tuple[str | None, ...]) -> HeldRobot:
    """Return a requested posture with torque limits and the leg on each contact: that of `names`, None = the nearest.

    Raises:
        StabilityError: a field that cannot be used.
    """
    stands = posed(robot, asked.joints, asked.base, "actuation.")
    limit = torque_limits(robot, asked.max_torque_nm)
    legs = stands.loaded_legs(contacts, names)
    return HeldRobot(stands, legs, limit, _servos(stands, legs, limit))


def _servos(stands: PosedRobot, legs: list[int], limit: Array) -> ServoLegs:
    """Return Jacobians and torques of the legs (indices) on the contacts; `limit`: torque limits, (nj,) Nm."""
    robot, joints, rot = stands.robot, stands.joints, stands.rot
    up, index = rot[2].copy(), robot.model.leg_joints[legs]
    jacobian = contact_jacobians(robot.model, joints, up, robot.foot_radii)
    own = gravity_torques(robot.model, joints, GRAVITY * up)[index]
    return ServoLegs(product(rot, jacobian[legs]), own, limit[index], robot.mass * GRAVITY)


class SteppedRobot(NamedTuple):
    """Movement of a robot's trunk over its standing legs, as a check of the movement needs it; frame world."""

    com: tuple[float, float]
    """Coordinates x and y of the centre of mass before the movement, by kinematics, m."""
    shift: Array
    """Shift of the centre of mass relative to the trunk by the movement, (3,) m."""
    reachable: bool
    """True if every standing leg reaches its foot after the movement, False if one does not."""
    legs: tuple[str, ...]
    """Names of the standing legs."""
    servos: ServoLegs | None
    """Jacobians and torques of the servos after the movement; None without torque limits, or without movement."""


def stepped(
    stands: PosedRobot | HeldRobot, contacts: ContactSet, names: tuple[str | None, ...], way: Array
) -> SteppedRobot:
    """Return the effect of moving the trunk by `way` (3,) m, world axes, over the legs that stand on the contacts.

    Args:
        stands: robot in a posture, with torque limits or without.
        contacts: contacts that stay on the ground, frame world.
        names: leg of each contact; None = that of the nearest foot.
        way: displacement of the trunk, (3,) m, world axes.

    Raises:
        StabilityError: a name is unknown or used twice.
    """
    limited = isinstance(stands, HeldRobot)
    robot = stands.stands if limited else stands
    standing = np.isin(np.arange(robot.robot.nlegs), stands.legs) if limited else robot.standing_legs(contacts, names)
    moved, (x, y, _) = robot.moved(way, standing), robot.com().tolist()
    legs = tuple(leg.name for leg, stays in zip(robot.robot.legs, standing, strict=True) if stays)
    servos = _servos(moved.after, stands.legs, stands.limit) if limited and way.any() else None
    return SteppedRobot((x, y), moved.vector, moved.reachable, legs, servos)


def posed(robot: Robot, joints: ArrayLike, base: BasePose, field: str = "") -> PosedRobot:
    """Return a robot in a posture of a request, checked.

    Args:
        robot: the robot.
        joints: joint angles, (nj,) rad.
        base: pose of base_link.
        field: prefix of the fields in refusals.

    Raises:
        StabilityError: a place, a number of joints, or a quaternion, that cannot be used.
    """
    place = within(base.position, f"{field}base.position")
    q, quat = np.array(joints), np.array(base.quat_wxyz)
    if q.size != robot.nj:
        raise StabilityError("shape", f"{field}joints", f"got {q.size} angles, {robot.name} has {robot.nj} joints")
    length = norm(quat)
    if not 1e-6 < length < 1e6:
        got = f"got {tuple(quat.tolist())}, must be a unit quaternion"
        raise StabilityError("not_unit", f"{field}base.quat_wxyz", got)
    return PosedRobot(robot, q, place, matrix_from_quat(quat / length))


def torque_limits(robot: Robot, given: ArrayLike | None) -> Array:
    """Return torque limits (nj,) Nm of a robot with legs of three joints: as given, or the robot's own.

    `given`: one number or (nj,) Nm; None = those of the robot.

    Raises:
        StabilityError: another kind of robot, or limits that cannot be used.
    """
    model, field = robot.model, "actuation.max_torque_nm"
    if model.leg_joints.shape[1] != 3 or (model.leg_joints < 0).any():
        raise StabilityError(
            "unsupported", "actuation.robot", f"the legs of {robot.name} have not three joints each: no answer for it"
        )
    limit = np.array([joint.servo.max_torque for joint in robot.joints])
    if isinstance(given, float):
        limit[:] = given
    elif given is not None:
        limit = np.array(given)
    if limit.size != robot.nj:
        raise StabilityError("shape", field, f"got {limit.size} limits, {robot.name} has {robot.nj} joints")
    for i in np.flatnonzero(~(limit > 0.0)):
        raise StabilityError("not_positive", f"{field}.{i}", f"got {limit[i]}, must be more than 0")
    return limit


def _distance(points: Array, point: Array) -> Array:
    """Return the distances (n,) m of points (n, 3) m from a point (3,) m."""
    away = points - point
    return np.sqrt(product(away * away, np.ones(3)))


def _twice(name: str, contact: int) -> StabilityError:
    return StabilityError("duplicate_leg", f"contacts.{contact}.leg", f"{name!r} stands on another contact already")


@kernel
def feet_in_world(model: KinematicModel, joints: Array, rot: Array, base: Array) -> Array:
    """Return the centres of the foot spheres in frame world, (L, 3) m.

    joints: (nj,) rad; rot: rotation from base_link to world, (3, 3); base: origin of base_link in the world, (3,) m.
    """
    feet = foot_positions(model, joints)
    out = np.empty_like(feet)
    for i in range(feet.shape[0]):
        for r in range(3):
            out[i, r] = base[r] + (feet[i, 0] * rot[r, 0] + feet[i, 1] * rot[r, 1] + feet[i, 2] * rot[r, 2])
    return out


@kernel
def com_in_world(model: KinematicModel, joints: Array, rot: Array, base: Array) -> Array:
    """Return the centre of mass in frame world, (3,) m.

    joints: (nj,) rad; rot: rotation from base_link to world, (3, 3); base: origin of base_link in the world, (3,) m.
    """
    centre, out = com(model, joints), np.empty(3)
    for r in range(3):
        out[r] = base[r] + (rot[r, 0] * centre[0] + rot[r, 1] * centre[1] + rot[r, 2] * centre[2])
    return out


@kernel
def _moved(
    model: KinematicModel, joints: Array, rot: Array, movement: Array, stance: Flags
) -> tuple[Array, Array, bool]:
    """Return the shift of the CoM in the trunk, (3,) m, world axes, the joints (nj,) rad, and True if the feet stay.

    `rot`: rotation from base_link to world, (3, 3); `movement` of the trunk, (3,) m, world axes; `stance`: feet on the
    ground, (L,). The joint angles are those after the movement.
    """
    move, vector = np.empty(3), np.empty(3)
    for r in range(3):
        move[r] = rot[0, r] * movement[0] + rot[1, r] * movement[1] + rot[2, r] * movement[2]
    after, reachable = hold_feet(model, joints, move, stance)
    way = com(model, after) - com(model, joints)
    for r in range(3):
        vector[r] = rot[r, 0] * way[0] + rot[r, 1] * way[1] + rot[r, 2] * way[2]
    return vector, after, reachable


@row_kernel
def contact_jacobians(model: KinematicModel, joints: Array, up: Array, radius: Array) -> Array:
    """Return the derivatives of the lowest point of each foot sphere by the n joints of its leg, (L, 3, n) m/rad.

    Axes base_link; `joints`: angles, (nj,) rad; `up`: unit vector, base_link, (3,); `radius` of the spheres, (L,) m.
    """
    rot, pos = forward(model, joints)
    return contact_jacobians_of(model, rot, pos, up, radius)


@row_kernel
def contact_jacobians_of(model: KinematicModel, rot: Array, pos: Array, up: Array, radius: Array) -> Array:
    """Return the Jacobians of L points that touch level ground, by the n joints of a leg: (L, 3, n) m/rad, base_link.

    Args:
        model: links and joints of the robot.
        rot: orientations of the links, (links, 3, 3), base_link from link.
        pos: origins of the links in base_link, (links, 3) m.
        up: unit vector that points up, base_link, (3,).
        radius: radii of the foot spheres, (L,) m.
    """
    jacobian = foot_jacobians_of(model, rot, pos)
    for i in range(model.leg_joints.shape[0]):
        k = model.foot_link[i]
        while k >= 0:
            for c in range(model.leg_joints.shape[1]):
                if model.joint[k] >= 0 and model.leg_joints[i, c] == model.joint[k]:
                    x, y, z = 0.0, 0.0, 0.0
                    for q in range(3):
                        x += rot[k, 0, q] * model.axis[k, q]
                        y += rot[k, 1, q] * model.axis[k, q]
                        z += rot[k, 2, q] * model.axis[k, q]
                    jacobian[i, 0, c] -= radius[i] * (y * up[2] - z * up[1])
                    jacobian[i, 1, c] -= radius[i] * (z * up[0] - x * up[2])
                    jacobian[i, 2, c] -= radius[i] * (x * up[1] - y * up[0])
            k = model.parent[k]
    return jacobian
