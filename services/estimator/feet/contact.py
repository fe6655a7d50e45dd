"""Contact points of a robot, at which its feet can touch the ground.

A point foot has one. A flat sole has three: its orientation measures the turn of the trunk, and with it the gyro. They
stand around the middle of the sole at the distance at which the noise of a point by the encoders, sigma_p, is as large
as that of the sole's orientation by the same encoders, sigma_o: sigma_p/sigma_o, about a third of the leg.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from surefoot.arrays import Array
from surefoot.kernels.jit import kernel
from surefoot.robot.description import Robot
from surefoot.robot.kinematics import foot_positions

SOLE_POINTS = 3
MOST_SWITCHES = 48  # of a foot; with more they count as one
NEAR = 0.01  # m over the lowest point: a foot without a sensor may stand there
SURE = 0.98  # largest probability of a contact: a switch may lie
LEVER = 1.0 / math.sqrt(6.0)
"""Distance of a flat sole's contact points from its centre, fraction of the leg's length: six joints of equal noise s
turn the sole by about s sqrt(6) and move it by s times the length."""


class ContactPoints(NamedTuple):
    """K points at which the L feet of a robot touch the ground, in foot axes; those of one foot are adjacent.

    foot: index of the foot of each point, (K,); place: position from the foot's centre, (K, 3) m; radius of a round
    foot, (K,) m, 0 = does not roll; switches: places of the S switches of each foot, (L, S, 3) m, S = 1: one for the
    whole foot; axes: long axis, short axis and normal of each sole as columns, (L, 3, 3).
    """

    foot: NDArray[np.int64]  # (K,) the foot of each
    place: Array  # (K, 3) m, from the foot's centre, foot axes
    radius: Array  # (K,) m, of a round foot; 0 = does not roll
    switches: Array  # (L, S, 3) m, places of the switches of each foot, as `place`; S = 1: one for the whole foot
    axes: Array  # (L, 3, 3) columns: long and short axis and normal of each sole, foot axes


class SeenPoints(NamedTuple):
    """Places and contacts of the K contact points of L feet at one time, as seen from the IMU.

    y: places, IMU axes, (K, 3) m; rot: rot_imu_from_foot of the foot of each, (K, 3, 3); contact: probability that each
    touches the ground, (K,), NaN = unknown; closed: closed switches of each foot, (L,), bit s for switch s.
    """

    y: Array  # (K, 3) m, IMU axes
    rot: Array  # (K, 3, 3) rot_imu_from_foot of each
    contact: Array  # (K,) probability that each touches the ground, NaN = unknown
    closed: NDArray[np.int64]  # (L,) closed switches of each foot, bit s for switch s


class BestGeometry(NamedTuple):
    """K contact points on the L feet of a robot, in foot axes, and the mounting of the IMU in base_link.

    foot: index of the foot of each point, (K,); place: position from the foot's centre, (K, 3) m; radius of a round
    foot, (K,) m, 0 = does not roll; switches: places of the S switches of each foot, (L, S, 3) m; axes: long axis,
    short axis and normal of each sole as columns, (L, 3, 3); imu_position: IMU in base_link, (3,) m.
    """

    foot: NDArray[np.int64]  # (K,) foot of each contact point
    place: Array  # (K, 3) m, in the foot
    radius: Array  # (K,) m
    switches: Array  # (L, S, 3) m, places of the switches of each foot, in the foot
    axes: Array  # (L, 3, 3) columns: long and short axis and normal of each sole, in the foot
    rot_base_from_imu: Array  # (3, 3)
    imu_position: Array  # (3,) m, in base_link


def point_feet(radius: Array) -> ContactPoints:
    """Return one contact point at the centre of each foot; `radius`: of its sphere, (L,) m, 0 = does not roll."""
    count = len(radius)
    return ContactPoints(
        np.arange(count),
        np.zeros((count, 3)),
        radius.astype(np.float64),
        np.zeros((count, 1, 3)),
        np.repeat(np.eye(3)[None], count, axis=0),
    )


def line_feet(ends: Array) -> ContactPoints:
    """Return two contact points for each foot that touches along a line, about which it may tip.

    `ends`: ends of the line of each foot, from its centre, foot axes, (L, 2, 3) m.
    """
    count = len(ends)
    long = ends[:, 1] - ends[:, 0]
    long = long / np.sqrt(np.sum(long * long, axis=1))[:, None]
    short = np.cross(long, np.eye(3)[np.argmin(np.abs(long), axis=1)])
    short /= np.sqrt(np.sum(short * short, axis=1))[:, None]
    axes = np.stack([long, short, np.cross(long, short)], axis=2)
    foot = np.repeat(np.arange(count), 2)
    places = np.ascontiguousarray(ends.reshape(-1, 3), dtype=np.float64)
    return ContactPoints(foot, places, np.zeros(len(foot)), np.zeros((count, 1, 3)), np.ascontiguousarray(axes))


def sole_feet(normals: Array, lever: float, switches: Array | None = None) -> ContactPoints:
    """Return three contact points for each foot that has a flat sole, on a circle about its centre.

    Args:
        normals: upward unit normals of the soles, (L, 3), foot axes.
        lever: distance of the points from the centre of the foot, m.
        switches: places of the S switches of each foot, from its centre, foot axes, (L, S, 3) m; None: one for the
            whole foot.
    """
    places: list[Array] = []
    axes: list[Array] = []
    for f, normal in enumerate(normals):
        first = np.cross(normal, np.eye(3)[int(np.argmin(np.abs(normal)))])
        first /= math.sqrt(float(np.sum(first * first)))
        second = np.cross(normal, first)
        for i in range(SOLE_POINTS):
            angle = 2.0 * math.pi * i / SOLE_POINTS
            place = lever * (math.cos(angle) * first + math.sin(angle) * second)
            places.append(place)
        long = first
        if switches is not None:  # the axis along which the outline is longest
            apart = switches[f] - switches[f].mean(axis=0)
            x, y = np.sum(first * apart, axis=1), np.sum(second * apart, axis=1)
            angle = 0.5 * math.atan2(2.0 * float(np.sum(x * y)), float(np.sum(x * x) - np.sum(y * y)))
            long = math.cos(angle) * first + math.sin(angle) * second
        axes.append(np.stack([long, np.cross(normal, long), normal], axis=1).astype(np.float64))
    foot = np.repeat(np.arange(len(normals)), SOLE_POINTS)
    if switches is None:
        switches = np.zeros((len(normals), 1, 3))
    return ContactPoints(foot, np.array(places), np.zeros(len(foot)), np.ascontiguousarray(switches), np.array(axes))


def contact_points(robot: Robot) -> ContactPoints:
    """Return the contact points of a robot: soles if all feet have one (three spheres or more), else one per foot."""
    if any(len(leg.foot.points) < 3 for leg in robot.legs):
        return point_feet(np.array([leg.foot.radius for leg in robot.legs]))
    normals = np.array([_normal(np.asarray(leg.foot.points)) for leg in robot.legs])
    feet = foot_positions(robot.model, robot.neutral)
    reach = max(math.dist(foot, leg.hip) for foot, leg in zip(feet, robot.legs, strict=True))
    bottoms = [
        leg.foot.points - leg.foot.position - leg.foot.radius * normal
        for leg, normal in zip(robot.legs, normals, strict=True)
    ]
    same = len({len(places) for places in bottoms}) == 1 and len(bottoms[0]) <= MOST_SWITCHES
    return sole_feet(normals, LEVER * reach, np.array(bottoms) if same else None)


def _normal(points: Array) -> Array:
    """Return the unit normal (3,) of the sole through points (k, 3) m, foot axes, towards +z (+x if it has no z)."""
    normal = np.cross(points[1] - points[0], points[2] - points[0])
    normal = normal / math.sqrt(float(np.sum(normal * normal)))
    axis = 2 if abs(normal[2]) > 1e-6 else 0
    return normal if normal[axis] > 0.0 else -normal


def touch_rows(touch: Sequence[Sequence[bool]]) -> NDArray[np.bool_]:
    """Return the switches of each foot as rows (L, S) of bool, True = closed.

    A foot with fewer than S switches gets open ones (False) at the end of its row.
    """
    if touch and touch[0] and len({len(foot) for foot in touch}) == 1:
        return np.array(touch, dtype=np.bool_)
    rows = np.zeros((len(touch), max([1, *(len(foot) for foot in touch)])), dtype=np.bool_)
    for row, foot in zip(rows, touch, strict=True):
        row[: len(foot)] = foot
    return rows


def at_switches(contact: Array, count: int) -> Array:
    """Return probabilities of contact at `count` switches of each foot, (..., L, count), from those of n, (..., L, n).

    With n = `count` they stay as they are, else each switch gets the largest value of its foot; NaN = unknown.
    """
    if contact.shape[-1] == count:
        return np.ascontiguousarray(contact)
    return np.repeat(np.fmax.reduce(contact, axis=-1)[..., None], count, axis=-1)


@kernel
def probabilities(foot: NDArray[np.int64], contact: Array) -> Array:
    """Return the probability of contact of each point, (K,), from that of its foot; 0.98 at most, NaN (unknown) stays.

    Args:
        foot: index of the foot of each point, (K,).
        contact: probability of contact of each foot, (L,).
    """
    out = np.empty(foot.size)
    for k in range(foot.size):
        known = contact[foot[k]]
        out[k] = known if math.isnan(known) else min(known, SURE)
    return out


@kernel
def points_of(foot: NDArray[np.int64], place: Array, position: Array, rot: Array) -> tuple[Array, Array]:
    """Return the contact points seen from the IMU.

    Args:
        foot: index of the foot of each point, (K,).
        place: place of each contact point from the centre of its foot, foot axes, (K, 3) m.
        position: foot centres from the IMU, IMU axes, (L, 3) m.
        rot: rot_imu_from_foot, (L, 3, 3).

    Returns:
        Points (K, 3) m, IMU axes, and rot_imu_from_foot of the foot of each, (K, 3, 3).
    """
    count = foot.size
    y, turn = np.empty((count, 3)), np.empty((count, 3, 3))
    for k in range(count):
        f = foot[k]
        for i in range(3):
            y[k, i] = position[f, i]
            for j in range(3):
                y[k, i] += rot[f, i, j] * place[k, j]
                turn[k, i, j] = rot[f, i, j]
    return y, turn


@kernel
def _height(rot: Array, y: Array) -> float:
    """Return the height, m, of a point y (3,) m over the IMU, y in IMU axes; rot: rot_odom_from_imu, (3, 3)."""
    return rot[2, 0] * y[0] + rot[2, 1] * y[1] + rot[2, 2] * y[2]


@kernel
def by_height(rot: Array, y: Array, radius: Array, contact: Array) -> Array:
    """Return the probability of contact of each point, (K,): by its sensor, else by its height over the lowest point.

    Args:
        rot: rot_odom_from_imu, (3, 3).
        y: contact points from the IMU, IMU axes, (K, 3) m.
        radius: radius of the foot sphere of each, (K,) m; 0 for soles.
        contact: probability by the sensor, (K,), NaN = none.
    """
    lowest = math.inf
    for k in range(contact.size):
        lowest = min(lowest, _height(rot, y[k]) - radius[k])
    out = contact.copy()
    for k in range(contact.size):
        if math.isnan(contact[k]):
            height = _height(rot, y[k]) - radius[k] - lowest
            out[k] = SURE * math.exp(-((height / NEAR) ** 2))
    return out
