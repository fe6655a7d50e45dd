"""Stability while standing or walking: contacts from kinematics, region, CoM planned and measured, margins."""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from surefoot.arrays import Array, Flags
from surefoot.geometry.linear import norm, product
from surefoot.kernels.jit import row_kernel
from surefoot.robot.description import KinematicModel, Robot
from surefoot.robot.kinematics import com_of, foot_positions_of, forward

from ..programs.contacts import ContactSet
from ..regions.margin import Margin, margin
from ..regions.model import Region
from ..regions.region import region
from .forces import MeasuredCom, com_from_forces, leg_forces_of


@dataclass(frozen=True, slots=True)
class WatchParams:
    """Assumptions about contacts and torques by which a walking robot's margin is computed."""

    mu: float = 0.6
    """Assumed coefficient of static friction of every foot."""
    tolerance: float = 1e-3
    """Largest distance of outer from inner polygon at which the refinement of a region ends, m."""
    directions: int = 24
    """Largest number of directions in which a region is solved for."""
    torque_variance: float = 4e-4
    """Variance of a measured joint torque, Nm^2 (servo friction 0.02 Nm)."""
    hold_s: float = 0.4
    """Time for which an open switch of a foot that is planned to stand is bridged, s. 68 gaps in 16 walks over rough
    ground: one sample of 33 ms 49 times, two to four 13 times, the longest, 0.37 s, of a foot that touched down and
    carried nothing until the other feet were lifted."""
    least_load: float = 0.5
    """Least fraction of the weight that measured forces must carry; with less no CoM is computed from them."""


class StandingFeet:
    """Filter of the standing feet from foot switches that chatter.

    A foot that has landed and is planned to stand is still at its place when its load vanishes for a moment (the impact
    of another foot, a stiff edge): it takes load again as soon as the trunk sinks, so it bounds the static region. A
    switch counts as closed for `hold_s` after it opens, but only while the foot is planned to stand; a foot that is
    planned to swing counts while its switch is closed and not longer, one that has not touched the ground since it
    swung does not count at all.

    Args:
        legs: number of feet.
        hold_s: how long an open switch of a foot that is planned to stand is bridged, s.
    """

    def __init__(self, legs: int, hold_s: float) -> None:
        self._hold_s = hold_s
        self._touched = np.full(legs, -np.inf)  # time of the last closed switch in this stance

    def update(self, stamp: float, touch: Flags, planned: Flags | None) -> Flags:
        """Return the feet that stand at `stamp` s, (L,) bool, and keep when each touched last.

        `touch`: closed switches, (L,); `planned`: feet that the gait plans to stand, (L,); None = no plan: switches
        alone.
        """
        return _standing(
            self._touched, self._hold_s, stamp, touch, touch if planned is None else planned, planned is None
        )


@row_kernel
def _standing(touched: Array, hold_s: float, stamp: float, touch: Flags, planned: Flags, alone: bool) -> Flags:
    """Return the feet (L,) that stand: switch closed, or opened at most `hold_s` ago in a foot planned to stand.

    Args:
        touched: stamp of the last closed switch since the foot swung, (L,) s, -inf = none; changed in place.
        hold_s: time that an open switch is bridged, s.
        stamp: now, s.
        touch: closed switches, (L,).
        planned: feet that the gait plans to stand, (L,).
        alone: True = there is no plan, switches alone count.
    """
    standing = touch.copy()
    for i in range(touch.size):
        if touch[i]:
            touched[i] = stamp
        elif not alone and not planned[i]:
            touched[i] = -math.inf
        elif not alone:
            standing[i] = stamp - touched[i] <= hold_s + 1e-9
    return standing


@dataclass(frozen=True, slots=True)
class Status:
    """Static stability now: region, CoM, margins; frame `level`: origin of base_link, z up, x along the heading."""

    region: Region
    stance: Flags
    com_planned: Array
    """Centre of mass by kinematics, x and y, (2,) m, frame level."""
    com_measured: MeasuredCom | None
    """Centre of mass by the forces on the feet; None without measured torques or forces."""
    margin_planned: Margin
    margin_measured: Margin | None


@row_kernel
def level_from_base(g_up: Array) -> Array:
    """Return the rotation from base_link to frame level, (3, 3): z along g_up, x the trunk's x axis made level.

    `g_up`: upward specific force, base_link, (3,) m/s^2.
    """
    rot = np.empty((3, 3))
    size = math.sqrt(g_up[0] * g_up[0] + g_up[1] * g_up[1] + g_up[2] * g_up[2])
    ux, uy, uz = g_up[0] / size, g_up[1] / size, g_up[2] / size
    x, y, z = 1.0 - ux * ux, -ux * uy, -ux * uz
    length = math.sqrt(x * x + y * y + z * z)
    if length < 1e-9:  # nose straight up or down: there is no heading
        x, y, z, length = 0.0, 1.0, 0.0, 1.0
    x, y, z = x / length, y / length, z / length
    rot[0, 0], rot[0, 1], rot[0, 2] = x, y, z
    rot[1, 0], rot[1, 1], rot[1, 2] = uy * z - uz * y, uz * x - ux * z, ux * y - uy * x
    rot[2, 0], rot[2, 1], rot[2, 2] = ux, uy, uz
    return rot


class Footing(NamedTuple):
    """Contacts, forces and CoM of the n feet that stand, from joints, tilt and torques."""

    position: Array
    """Points where the feet touch the ground, (n, 3) m, frame level."""
    normal: Array
    """Contact normals, (n, 3): all vertical, as a foot does not measure the slope of the ground."""
    mu: Array
    """Coefficients of static friction of the feet that stand, (n,)."""
    force: Array
    """Force of the ground on each foot, base_link, (n, 3) N."""
    covariance: Array
    """Covariance of each force, base_link, (n, 3, 3) N^2."""
    observed: bool
    """True if the joint torques determine the force on every contact, False if not on each."""
    com: Array
    """Centre of mass by kinematics, (3,) m, frame level."""
    rot: Array
    """Rotation from base_link to frame level (z up, x along the heading), (3, 3)."""


@row_kernel
def _footing(
    model: KinematicModel,
    joints: Array,
    g_up: Array,
    torque: Array,
    touch: Flags,
    radius: Array,
    mu: float,
    variance: float,
) -> Footing:
    """Return contacts, forces and CoM of the feet that stand; the links' poses are computed once.

    Args:
        model: links and joints of the robot.
        joints: angles, (nj,) rad.
        g_up: upward specific force at rest, base_link, (3,) m/s^2.
        torque: torques of the joints, (nj,) Nm.
        touch: feet that stand, (L,).
        radius: radii of the foot spheres, (L,) m.
        mu: friction coefficient.
        variance: variance of a torque, Nm^2.
    """
    links, origins = forward(model, joints)
    feet, centre = foot_positions_of(model, links, origins), com_of(model, links, origins)
    forces, covariances, observed = leg_forces_of(model, links, origins, g_up, radius, torque, variance)
    rot, n, all_seen, com = level_from_base(g_up), 0, True, np.zeros(3)
    for foot in range(touch.size):
        n += 1 if touch[foot] else 0
    position, normal, friction = np.zeros((n, 3)), np.zeros((n, 3)), np.empty(n)
    force, covariance = np.empty((n, 3)), np.empty((n, 3, 3))
    for q in range(3):
        for p in range(3):
            com[q] += rot[q, p] * centre[p]
    i = 0
    for foot in range(touch.size):
        if not touch[foot]:
            continue
        for q in range(3):
            force[i, q] = forces[foot, q]
            for p in range(3):
                position[i, q] += rot[q, p] * feet[foot, p]
                covariance[i, q, p] = covariances[foot, q, p]
        position[i, 2] -= radius[foot]
        normal[i, 2], friction[i] = 1.0, mu
        all_seen = all_seen and bool(observed[foot])
        i += 1
    return Footing(position, normal, friction, force, covariance, all_seen, com, rot)


def watch(robot: Robot, joints: Array, touch: Flags, g_up: Array, torque: Array | None, params: WatchParams) -> Status:
    """Return the static stability of the robot on the feet that stand: region, CoM and margins.

    Args:
        robot: the robot.
        joints: angles, (nj,) rad.
        touch: feet that stand, (L,).
        g_up: upward specific force at rest, base_link, (3,) m/s^2.
        torque: measured joint torques, (nj,) Nm, or None.
        params: friction and accuracy.
    """
    measured_torque = np.zeros(robot.nj) if torque is None else torque
    f = _footing(robot.model, joints, g_up, measured_torque, touch, robot.foot_radii, params.mu, params.torque_variance)
    contacts = ContactSet(f.position, f.normal, f.mu)
    found = region(contacts, tolerance=params.tolerance, limit=params.directions)
    measured: MeasuredCom | None = None
    if torque is not None and f.observed and len(f.position):
        weight = params.least_load * robot.mass * norm(g_up)
        force, covariance = product(f.force, f.rot.T), product(product(f.rot, f.covariance), f.rot.T)
        measured = com_from_forces(f.position, force, covariance, weight)
    return Status(
        region=found,
        stance=touch,
        com_planned=f.com[:2],
        com_measured=measured,
        margin_planned=margin(found, f.com[:2]),
        margin_measured=None if measured is None else margin(found, measured.com),
    )
