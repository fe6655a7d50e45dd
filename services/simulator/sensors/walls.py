"""Sensors of walls: nearest echo of the ultrasound, and bumpers of the feet."""

# mujoco has no type stubs for its compiled modules:
# pyright: reportAttributeAccessIssue=false
import math
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from surefoot.arrays import Array
from surefoot.robot.profiles import RangerFile, read_profile
from surefoot.schemas.topics import HW_RANGE

from ..physics.addresses import Addresses
from ..physics.obstacles import UPRIGHT
from .rate import period_ms

RAYS = 13  # over the cone: 5 deg apart for 60 deg
TERRAIN_ONLY = np.array([1, 0, 0, 0, 0, 0], dtype=np.uint8)  # groups of geoms: the robot's are others


@dataclass(frozen=True, eq=False)
class Ranger:
    """Ultrasonic sensor of a robot: place, cone, range, noise, period; and the least force that a bumper reports."""

    name: str
    position: Array  # (3,) m, base_link
    half_cone: float  # rad
    shortest: float  # m
    longest: float  # m
    resolution: float  # m
    sigma: float  # m
    period_ms: int
    bump_n: float  # N


def read_ranger(name: str) -> Ranger:
    """Return the ultrasonic sensor of `robots/rangers/<name>.toml`.

    Raises:
        RobotError: unknown name, or a number is out of range; `field` names it.
    """
    file, _ = read_profile(RangerFile, name, "ranger")
    return Ranger(
        name=name,
        position=np.array(file.position),
        half_cone=0.5 * math.radians(file.field_deg),
        shortest=file.shortest,
        longest=file.longest,
        resolution=file.resolution,
        sigma=file.sigma,
        period_ms=period_ms(file.period_ms, HW_RANGE),
        bump_n=file.bump_n,
    )


def echo(model: Any, data: Any, place: Array, heading: float, half_cone: float, longest: float) -> float:
    """Return the distance of the nearest terrain in a level cone, m, or `longest`.

    The cone is level although the trunk is not: a smooth floor sends a slanting beam away, not back.

    Args:
        model: MuJoCo model of the world.
        data: state of MuJoCo's physics.
        place: position of the sensor, (3,) m, map.
        heading: heading of the middle of the cone, rad.
        half_cone: half the angle of the cone, rad.
        longest: range of the sensor, m.
    """
    best, hit = longest, np.zeros(1, dtype=np.int32)
    for angle in np.linspace(heading - half_cone, heading + half_cone, RAYS):
        ray = np.array([math.cos(angle), math.sin(angle), 0.0])
        distance = mujoco.mj_ray(model, data, place, ray, TERRAIN_ONLY, 1, -1, hit)
        if 0.0 <= distance < best:
            best = distance
    return best


def bumped(data: Any, address: Addresses, feet: int, least: float) -> NDArray[np.bool_]:
    """Return True for each of `feet` feet that pressed a wall in the last physics step by at least `least` N."""
    force, contact = np.zeros(feet), data.contact
    for i in np.flatnonzero(np.abs(contact.frame[:, 2]) < UPRIGHT):
        foot = address.foot_of_geom[contact.geom[i]].max()
        if foot >= 0 and contact.efc_address[i] >= 0:
            force[foot] += data.efc_force[contact.efc_address[i]]
    return force >= least
