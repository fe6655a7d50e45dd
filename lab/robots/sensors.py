"""Sensor tables of an imported robot: pose of the inertial unit, and assumed contacts, encoders and currents."""

# mujoco has no type stubs for its compiled modules:
# pyright: reportAttributeAccessIssue=false
import re
from typing import Any

import mujoco
import numpy as np

from surefoot.arrays import Array
from surefoot.geometry.constants import GRAVITY
from surefoot.nearest import did_you_mean
from surefoot.robot.description import RobotError
from surefoot.tables import shown

from .anatomy import Segment, floats, quaternion
from .packages import MOST_NAMES

FARTHEST = 10.0  # m, of an inertial unit from the trunk's origin: farther, the numbers have another unit


def sensors(
    model: mujoco.MjModel, segs: list[Segment], imu: str | None, notes: tuple[list[str], list[str], list[str]]
) -> dict[str, Any]:
    """Return the sensor tables of a robot.

    Args:
        model: compiled model.
        segs: all segments of the robot, the trunk first.
        imu: name of a site or body of the trunk at which the inertial unit is, or `x,y,z` in m in the trunk's frame;
            None = the first whose name has imu in it, else the trunk's frame, which is noted as assumed.
        notes: lists of what was found, assumed and is missing, to which sentences are added.

    Raises:
        RobotError: the trunk has no such site or body, or the place is none.
    """
    found, assumed, missing = notes
    position, rot = np.zeros(3), np.eye(3)
    spots = _spots(model, segs[0])
    name = next((each for each in spots if "imu" in each.lower()), None) if imu is None else imu
    if imu is not None and imu not in spots and re.fullmatch(r"[^,]*,[^,]*,[^,]*", imu):
        position = _place(imu)
        found.append(f"inertial unit: at {imu} m")
    elif name is not None:
        if name not in spots:
            some = ", ".join(list(spots)[:MOST_NAMES])
            allowed = f"allowed are x,y,z in m, or a site or link of the trunk: {some}"
            raise RobotError("unknown_name", "imu", f"got {shown(name)}{did_you_mean(name, list(spots))}, {allowed}")
        position, rot = spots[name]
        found.append(f"inertial unit: {name!r}")
    else:
        assumed.append(
            "inertial unit: at the trunk's frame; better: --imu LINK or --imu x,y,z of this command, or [imu]"
        )
    weight = GRAVITY * sum(s.mass for s in segs)
    missing += ["noise of the inertial unit (that of adis16365 is taken)", "contact thresholds"]
    return {
        "imu": {
            "source": "assumed", "profile": "adis16365", "position": floats(position), "quat_wxyz": quaternion(rot),
        },
        "contacts": {
            "source": "assumed", "kind": "switch", "switches": 1, "on_n": 0.03 * weight, "off_n": 0.02 * weight,
        },
        "encoders": {"source": "assumed", "resolution_deg": 0.0, "zero_sigma_deg": 0.0},
        "current": {"source": "assumed", "torque_per_ampere": 1.0, "noise_ampere": 0.0},
        "gait": {"source": "assumed"},
    }  # fmt: skip


def _spots(model: mujoco.MjModel, base: Segment) -> dict[str, tuple[Array, Array]]:
    """Return position (3,) m and rot_trunk_from_spot (3, 3) of the trunk's sites and bodies, by name, sites first."""
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    at, axes = data.xpos[base.body], data.xmat[base.body].reshape(3, 3)
    sites = [i for i in range(model.nsite) if model.site_bodyid[i] in base.bodies]
    spots = [(model.site(i).name, data.site_xpos[i], data.site_xmat[i]) for i in sites]
    spots += [(model.body(i).name, data.xpos[i], data.xmat[i]) for i in base.bodies]
    found: dict[str, tuple[Array, Array]] = {}
    for name, place, rot in spots:
        if name:
            found.setdefault(name, (axes.T @ (place - at), axes.T @ rot.reshape(3, 3)))
    return found


def _place(text: str) -> Array:
    """Return the position `x,y,z`, (3,) m (raises RobotError: these are no numbers within `FARTHEST`)."""
    try:
        place = np.array([float(part) for part in text.split(",")])
    except ValueError:
        place = np.full(3, np.nan)
    if not (np.abs(place) <= FARTHEST).all():
        allowed = f"allowed are three numbers in m from -{FARTHEST:g} to {FARTHEST:g}, as 0.03,0,0.02, or a link"
        raise RobotError("value", "imu", f"got {shown(text)}, {allowed}")
    return place
