"""Stability while standing or walking: contacts from kinematics, region, CoM planned and measured, margins."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from services.stability.contacts import Array, ContactSet
from services.stability.forces import MeasuredCom, com_from_forces, forces_from_torques
from services.stability.margin import Margin, margin
from services.stability.region import Region, region
from surefoot.jit import row_kernel
from surefoot.kinematics import com, foot_positions
from surefoot.robot import KinematicModel, Robot, load_robot

Flags = NDArray[np.bool_]


@dataclass(frozen=True, slots=True)
class WatchParams:
    """What is taken for granted while walking."""

    mu: float = 0.6
    """Friction coefficient of every foot."""
    tolerance: float = 1e-3
    """m, distance of outer from inner polygon."""
    directions: int = 24
    """At most so many directions a region."""
    torque_variance: float = 4e-4
    """Nm^2, of a measured joint torque (servo friction 0.02 Nm)."""
    hold_s: float = 0.4
    """s, an open switch of a foot that is planned to stand is bridged so long. 68 gaps in 16 walks over rough ground:
    one sample of 33 ms 49 times, two to four 13 times, the longest, 0.37 s, of a foot that touched down and carried
    nothing until the other feet were lifted."""
    least_load: float = 0.5
    """Share of the weight the measured forces must carry before their CoM is believed."""


class StandingFeet:
    """Which feet stand, from switches that chatter.

    A foot that has landed and is planned to stand is still at its place when its load vanishes for a moment (the impact
    of another foot, a stiff edge): it takes load again as soon as the trunk sinks, so it bounds the static region. A
    switch is therefore held for `hold_s`, but only in a planned stance; a foot that is planned to swing counts while
    its switch is closed and not longer, one that has not touched the ground since it swung does not count at all.

    Args:
        legs: number of feet.
        hold_s: how long an open switch of a planned stance is bridged, s.
    """

    def __init__(self, legs: int, hold_s: float) -> None:
        self._hold_s = hold_s
        self._touched = np.full(legs, -np.inf)  # time of the last closed switch in this stance

    def update(self, stamp: float, touch: Flags, planned: Flags | None) -> Flags:
        """Feet that stand at `stamp` (s); `planned` stance (L,), None = nobody plans: the switches alone count."""
        self._touched[touch] = stamp
        if planned is None:
            return touch
        self._touched[~planned & ~touch] = -np.inf
        return touch | (planned & (stamp - self._touched <= self._hold_s + 1e-9))


@dataclass(frozen=True, slots=True)
class Status:
    """Static stability now; frame `level`: origin of base_link, z up, x along the heading."""

    region: Region
    stance: Flags
    com_planned: Array
    """(2,) m, from kinematics."""
    com_measured: MeasuredCom | None
    """From foot forces."""
    margin_planned: Margin
    margin_measured: Margin | None


@row_kernel
def level_from_base(g_up: Array) -> Array:
    """rot_level_from_base (3, 3): z along g_up, x the horizontal part of the trunk's x axis."""
    rot = np.empty((3, 3))
    up = g_up / np.sqrt(np.sum(g_up * g_up))
    x = np.array([1.0 - up[0] * up[0], -up[0] * up[1], -up[0] * up[2]])
    length = np.sqrt(np.sum(x * x))
    if length < 1e-9:  # nose straight up or down: there is no heading
        x, length = np.array([0.0, 1.0, 0.0]), 1.0
    x /= length
    rot[0], rot[2] = x, up
    rot[1, 0] = up[1] * x[2] - up[2] * x[1]
    rot[1, 1] = up[2] * x[0] - up[0] * x[2]
    rot[1, 2] = up[0] * x[1] - up[1] * x[0]
    return rot


@row_kernel
def _place(model: KinematicModel, joints: Array, g_up: Array, radius: Array) -> tuple[Array, Array, Array]:
    """Contact points (L, 3) and CoM (3,) in frame level, and rot_level_from_base; the ground is touched below."""
    rot = level_from_base(g_up)
    feet, centre = foot_positions(model, joints), com(model, joints)
    points, c = np.zeros(feet.shape), np.zeros(3)
    for q in range(3):
        for p in range(3):
            c[q] += rot[q, p] * centre[p]
    for i in range(feet.shape[0]):
        for q in range(3):
            for p in range(3):
                points[i, q] += rot[q, p] * feet[i, p]
        points[i, 2] -= radius[i]
    return points, c, rot


def watch(robot: Robot, joints: Array, touch: Flags, g_up: Array, torque: Array | None, params: WatchParams) -> Status:
    """Stability of the present stance.

    Args:
        robot: the robot.
        joints: (nj,) rad.
        touch: (L,) feet that touch.
        g_up: upward specific force at rest, base_link, (3,) m/s2.
        torque: measured joint torques, (nj,) Nm, or None.
        params: friction and accuracy. Normals are taken as vertical: a foot does not know the ground's slope.
    """
    radius = np.array([leg.foot.radius for leg in robot.legs])
    points, centre, rot = _place(robot.model, joints, g_up, radius)
    standing = np.ascontiguousarray(points[touch])
    up = np.zeros_like(standing)
    up[:, 2] = 1.0
    contacts = ContactSet(standing, up, np.full(len(standing), params.mu))
    found = region(contacts, tolerance=params.tolerance, limit=params.directions)
    measured: MeasuredCom | None = None
    if torque is not None and touch.any():
        forces = forces_from_torques(robot, joints, torque, g_up, params.torque_variance)
        if forces.observed[touch].all():
            weight = params.least_load * robot.mass * float(np.linalg.norm(g_up))
            turned = rot @ forces.covariance[touch] @ rot.T
            measured = com_from_forces(standing, forces.force[touch] @ rot.T, turned, weight)
    return Status(
        region=found,
        stance=touch,
        com_planned=centre[:2],
        com_measured=measured,
        margin_planned=margin(found, centre[:2]),
        margin_measured=None if measured is None else margin(found, measured.com),
    )


def warm() -> None:
    """Compile everything a status needs."""
    robot = load_robot("ragno")
    touch = np.ones(len(robot.legs), dtype=np.bool_)
    watch(robot, robot.neutral, touch, np.array([0.0, 0.0, 9.81]), np.zeros(len(robot.neutral)), WatchParams())
