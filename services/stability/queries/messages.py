"""Between the messages of `surefoot.schemas.stability` and the arrays of the algorithms."""

import math
import re
from functools import lru_cache
from typing import Any

import numpy as np

from surefoot.geometry.polygon import area
from surefoot.geometry.rotations import matrix_from_quat
from surefoot.robot.description import Robot
from surefoot.robot.reader import load_robot, robot_names
from surefoot.schemas.stability import (
    BasePose,
    Contact,
    RegionFields,
    RegionReply,
    RegionRequest,
    SupportPoint,
)
from surefoot.tables import TableError

from ..programs.contacts import Array, ContactSet, StabilityError, contact_set, within
from ..programs.directions import equally_spaced, unit
from ..programs.oracle import Support
from ..regions.region import Region, region

_NAME = re.compile(r"[A-Za-z0-9_-]+")


def contacts_of(contacts: tuple[Contact, ...], field: str = "contacts") -> ContactSet:
    """Arrays of the contacts of a request; refusals name `field`."""
    try:
        return contact_set(
            [c.position for c in contacts],
            [c.normal for c in contacts],
            [math.inf if c.mu is None else c.mu for c in contacts],
        )
    except StabilityError as error:
        raise StabilityError(error.code, error.field.replace("contacts", field, 1), error.message) from None


def directions_of(request: RegionFields) -> Array | None:
    """Unit directions (k, 2) of a request; None = adaptive."""
    given = request.directions
    return None if given is None else equally_spaced(given) if isinstance(given, int) else unit(given)


def region_of(request: RegionFields) -> Region:
    """The region a request asks for."""
    return region(
        contacts_of(request.contacts),
        directions_of(request),
        adaptive=request.adaptive,
        tolerance=request.tolerance_m,
        limit=request.max_directions,
    )


def region_reply(found: Region, request: RegionRequest) -> RegionReply:
    """The region as it travels."""
    return RegionReply(**region_fields(found, request.certificates, polygons=True))


def region_fields(found: Region, certificates: bool, polygons: bool) -> dict[str, Any]:
    """The fields of a RegionReply."""
    closed = len(found.outer) > 0
    return {
        "status": found.status,
        "inner": pairs(found.inner) if polygons else (),
        "outer": pairs(found.outer) if polygons else (),
        "support": _support(found.support, certificates) if polygons else (),
        "gap": _finite(found.gap),
        "area": max(0.0, float(area(found.inner))),
        "area_outer": max(0.0, float(area(found.outer))) if closed else None,
        "certificate": None if found.sinking is None else tuple(found.sinking.tolist()),
    }


def _support(support: Support, certificates: bool) -> tuple[SupportPoint, ...]:
    direction, value, point = pairs(support.direction), support.value.tolist(), pairs(support.point)
    gap = support.gap.tolist()
    out: list[SupportPoint] = []
    for i, status in enumerate(support.status):
        ok = status == "ok"
        proof: dict[str, Any] = {}
        if certificates and ok:
            proof["certificate"] = tuple(support.twist[i].tolist())
        if certificates and status != "infeasible":
            proof["forces"] = tuple(map(tuple, support.force[i].tolist()))
        out.append(
            SupportPoint(
                direction=direction[i],
                value=value[i] if ok else None,
                point=point[i] if ok else None,
                status=status,
                gap=max(0.0, gap[i]) if ok else None,
                **proof,
            )
        )
    return tuple(out)


def pairs(points: Array) -> tuple[tuple[float, float], ...]:
    """Rows of two numbers as they travel."""
    return tuple(map(tuple, points.tolist()))  # pyright: ignore[reportReturnType] - rows of two


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None


# -- what several questions have in common ----------------------------------------------------------------------------


def posture(robot: Robot, joints: tuple[float, ...], base: BasePose) -> tuple[Array, Array, Array]:
    """Joint angles, position of base_link and rot_world_from_base of a request."""
    q = np.array(joints)
    if q.size != len(robot.joint_names):
        wanted = len(robot.joint_names)
        raise StabilityError("shape", "joints", f"got {q.size} angles, {robot.name} has {wanted} joints")
    quat = np.array(base.quat_wxyz)
    length = float(np.linalg.norm(quat))
    if not 1e-6 < length < 1e6:
        raise StabilityError("not_unit", "base.quat_wxyz", f"got {base.quat_wxyz}, must be a unit quaternion")
    return q, within(base.position, "base.position"), matrix_from_quat(quat / length)


@lru_cache(maxsize=16)
def named_robot(name: str) -> Robot:
    """Robot description by name (not by path: a request must not read files of its own choice)."""
    if not _NAME.fullmatch(name):
        raise StabilityError("unknown_robot", "robot", f"got {name!r}; known are {', '.join(robot_names())}")
    try:
        return load_robot(name)
    except TableError as error:
        raise StabilityError("unknown_robot", "robot", error.message) from None


def triples(rows: Array) -> tuple[tuple[float, float, float], ...]:
    """Rows of three numbers as they travel."""
    return tuple(map(tuple, rows.tolist()))  # pyright: ignore[reportReturnType] - rows of three
