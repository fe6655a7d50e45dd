"""Recognition of legs with closed-form inverse kinematics: yaw-pitch-pitch, and roll-pitch-pitch with any offsets."""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from surefoot.arrays import Array
from surefoot.geometry.linear import dot, norm, product

from .description import Joint, Leg, Link, RolledLegs

PARALLEL = 1e-5  # rad, axes count as parallel or perpendicular (pi / 2 written as 1.5708): a foot is 10 um per m off
SHORTEST = 1e-6  # m; a shorter femur or tibia is none
STRAIGHT = 1e-3  # rad; a neutral knee that is bent less does not show to which side it bends


class ClosedForms(NamedTuple):
    """Geometry of all legs for their closed-form inverse kinematics; fields as in `KinematicModel`."""

    hip: Array  # (L, 4)
    segment: Array  # (L, 3)
    rolled: RolledLegs


def closed_forms(links: Sequence[Link], joints: Sequence[Joint], legs: Sequence[Leg]) -> ClosedForms:
    """Return the geometry of the legs for closed-form inverse kinematics; NaN lengths for a leg of another kind."""
    n = len(legs)
    hip, segment = np.zeros((n, 4)), np.full((n, 3), np.nan)
    rolled = RolledLegs(
        np.zeros((n, 3)), np.tile(np.eye(3), (n, 1, 1)), np.zeros((n, 2)), np.full((n, 2), np.nan),
        np.zeros((n, 2)), np.ones((n, 3)),
    )  # fmt: skip
    for i, leg in enumerate(legs):
        hip[i, :3] = leg.hip
        closed = _yaw_pitch_pitch(links, joints, leg)
        if closed is not None:
            hip[i], segment[i] = closed
            continue
        found = _roll_pitch_pitch(links, joints, leg)
        if found is not None:
            for column, value in zip(rolled, found, strict=True):
                column[i] = value
    return ClosedForms(hip, segment, rolled)


def matrix(q: Array) -> Array:
    """Return the rotation matrix (3, 3) of a unit quaternion w, x, y, z, (4,), computed without a compiled kernel."""
    w, x, y, z = q
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


def _cross(a: Array, b: Array) -> Array:
    return np.array([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]])


def _yaw_pitch_pitch(links: Sequence[Link], joints: Sequence[Joint], leg: Leg) -> tuple[Array, Array] | None:
    """Return hip pose (4,) and segment lengths (3,) m of a leg with axes z, -y, -y and links along x; else None."""
    if len(leg.joints) != 3:
        return None
    coxa, femur, tibia = (links[joints[j].link] for j in leg.joints)
    foot, link = leg.foot.position, leg.foot.link
    while link != joints[leg.joints[2]].link:  # fixed links between the tibia and the foot
        if links[link].joint >= 0 or link == 0:
            return None
        foot = links[link].position + product(matrix(links[link].quat_wxyz), foot)
        link = links[link].parent
    axes = np.array([coxa.axis, femur.axis, tibia.axis])
    straight = all(np.allclose(p[1:], 0.0, atol=1e-12) for p in (femur.position, tibia.position, foot))
    level = np.allclose([femur.quat_wxyz, tibia.quat_wxyz], [1, 0, 0, 0]) and np.allclose(coxa.quat_wxyz[1:3], 0)
    chained = tibia.parent == joints[leg.joints[1]].link and femur.parent == joints[leg.joints[0]].link
    chained = chained and coxa.parent == 0
    if not (straight and level and chained and np.allclose(axes, [[0, 0, 1], [0, -1, 0], [0, -1, 0]])):
        return None
    yaw = 2.0 * math.atan2(coxa.quat_wxyz[3], coxa.quat_wxyz[0])
    return np.append(coxa.position, yaw), np.array([femur.position[0], tibia.position[0], foot[0]])


class _LegAxes(NamedTuple):
    """Geometry of a leg of three joints at joint angles zero, in base_link."""

    axes: Array  # (3, 3) unit joint axes, one a row
    points: Array  # (4, 3) m, origins of the three joints, then the foot centre


def _leg_axes(links: Sequence[Link], leg: Leg) -> _LegAxes | None:
    """Return the leg at joint angles zero, None unless its three joints are all that moves the foot."""
    way: list[int] = []  # links from the foot inwards
    link = leg.foot.link
    while link > 0:
        way.append(link)
        link = links[link].parent
    moved = [i for i in reversed(way) if links[i].joint >= 0]
    if len(moved) != 3 or [links[i].joint for i in moved] != list(leg.joints):
        return None
    rot, pos = np.eye(3), np.zeros(3)
    axes, points = np.zeros((3, 3)), np.zeros((4, 3))
    for i in reversed(way):
        pos = pos + product(rot, links[i].position)
        rot = product(rot, matrix(links[i].quat_wxyz))
        if i in moved:
            axes[moved.index(i)], points[moved.index(i)] = product(rot, links[i].axis), pos
    points[3] = pos + product(rot, leg.foot.position)
    return _LegAxes(axes, points)


def _roll_pitch_pitch(links: Sequence[Link], joints: Sequence[Joint], leg: Leg) -> tuple[Array, ...] | None:
    """Return a row of `RolledLegs` if axes two and three are parallel and at right angles to the first, else None."""
    chain = _leg_axes(links, leg)
    if chain is None:
        return None
    x, y, third = chain.axes
    if abs(dot(x, y)) > PARALLEL or norm(_cross(y, third)) > PARALLEL:
        return None
    x = x - dot(x, y) * y
    x = x / norm(x)
    rot = np.column_stack((x, y, _cross(x, y)))
    _, femur, tibia, foot = product(chain.points - chain.points[0], rot)
    hip = chain.points[0] + femur[0] * x
    f, t = tibia - femur, foot - tibia
    lengths = math.hypot(f[0], f[2]), math.hypot(t[0], t[2])
    if min(lengths) < SHORTEST:
        return None
    turn = 1.0 if dot(y, third) > 0.0 else -1.0
    at_femur = math.atan2(f[0], f[2])
    at_knee = math.remainder(math.atan2(t[0], t[2]) - at_femur, 2.0 * math.pi)
    _, second, last = (joints[j] for j in leg.joints)

    def bend(angle: float) -> float:
        return math.remainder(at_knee + turn * angle, 2.0 * math.pi)

    knee = bend(last.neutral)
    if abs(knee) < STRAIGHT:
        knee = bend(0.5 * (last.lower + last.upper))
    upper = at_femur + second.neutral
    z = femur[2] + lengths[0] * math.cos(upper) + lengths[1] * math.cos(upper + bend(last.neutral))
    sides = np.array([math.copysign(1.0, z), math.copysign(1.0, knee), turn])
    return hip, rot, np.array([foot[1], femur[2]]), np.array(lengths), np.array([at_femur, at_knee]), sides
