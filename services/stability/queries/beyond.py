"""Answers to `stability/region` beyond rest: acceleration, doubtful gravity; `limited` has those of limited torques."""

import math
from typing import Any

import numpy as np

from surefoot.geometry.constants import GRAVITY
from surefoot.geometry.polygon import area
from surefoot.robot.description import Robot
from surefoot.schemas.stability import RegionReply, RegionRequest, SupportPoint

from ..programs.contacts import Array, refuse
from ..regions.effective import Leaning, lean, stays_down, tilt_robust, upward
from ..regions.region import Region, distance, region
from .limited import limited_reply
from .messages import (
    contacts_of,
    directions_of,
    pairs,
    region_of,
    region_reply,
    triples,
)


def region_answer(request: RegionRequest, own: Robot | None) -> RegionReply:
    """Answer to `stability/region`; `own` is the robot when the request names none (needed with actuation only)."""
    moving, leaning = any(request.acceleration), request.tilt_rad > 0.0
    if request.actuation is not None:
        refuse(moving, "acceleration", "actuation")
        refuse(leaning, "tilt_rad", "actuation")
        refuse(request.adaptive is True, "adaptive", "actuation")
        assert own is not None
        return limited_reply(request, request.actuation, own)
    if leaning:
        refuse(request.directions is not None, "directions", "tilt_rad")
        refuse(request.certificates, "certificates", "tilt_rad")
        return _tilted_reply(request)
    if moving:
        return _moving_reply(request)
    return region_reply(region_of(request), request)


# -- acceleration ------------------------------------------------------------------------------------------------------


def _moving_reply(request: RegionRequest) -> RegionReply:
    """The region of the leaning frame, cut by the horizontal plane at the height of the CoM.

    A point p of the leaning frame lies at c = M p + c0 in that plane: with a = M'd / |M'd| the support value of the cut
    in direction d is |M'd| h(a) + d'c0.
    """
    push = np.array(request.acceleration)
    up = upward(push)
    stays_down(up, push)
    seen = lean(contacts_of(request.contacts), up)
    matrix, given = seen.to_world(), directions_of(request)
    steep = seen.rot[2, 2]  # cosine of the lean: the plane cuts lengths of the frame up to 1 / steep
    if given is not None:
        given = given @ matrix
        given = np.ascontiguousarray(given / np.hypot(given[:, 0], given[:, 1])[:, None])
    found = region(
        seen.contacts,
        given,
        adaptive=request.adaptive,
        tolerance=request.tolerance_m * steep,
        limit=request.max_directions,
    )
    h, proven = request.com_height_m, request.certificates
    inner, outer = seen.at_height(found.inner, h), seen.at_height(found.outer, h)
    sinking = None if found.sinking is None else _twist(seen, found.sinking, np.zeros(2))
    return RegionReply(
        status=found.status,
        inner=pairs(inner),
        outer=pairs(outer),
        support=_moved_support(found, seen, matrix, h, proven),
        gap=found.gap / steep if math.isfinite(found.gap) else None,
        area=max(0.0, float(area(inner))),
        area_outer=max(0.0, float(area(outer))) if len(outer) else None,
        twist=sinking,
    )


def _moved_support(
    found: Region, seen: Leaning, matrix: Array, height: float, proven: bool
) -> tuple[SupportPoint, ...]:
    s, back = found.support, np.linalg.inv(matrix)
    direction = s.direction @ back  # rows d' = a'M^-1
    size = np.hypot(direction[:, 0], direction[:, 1])
    direction = direction / size[:, None]
    point = seen.at_height(s.point, height)
    zero = seen.at_height(np.zeros((1, 2)), height)[0]
    out: list[SupportPoint] = []
    for k, status in enumerate(s.status):
        ok = status == "ok"
        proof: dict[str, Any] = {}
        if proven and ok:
            proof["twist"] = _twist(seen, s.twist[k], s.direction[k])
        if proven and status != "infeasible":
            proof["forces"] = triples(s.force[k] @ seen.rot * (seen.strength / GRAVITY))
        out.append(
            SupportPoint(
                direction=pairs(direction[k : k + 1])[0],
                value=float(s.value[k] / size[k] + direction[k] @ zero) if ok else None,
                point=pairs(point[k : k + 1])[0] if ok else None,
                status=status,
                gap=max(0.0, float(s.gap[k] / size[k])) if ok else None,
                **proof,
            )
        )
    return tuple(out)


def _twist(seen: Leaning, twist: Array, a: Array) -> tuple[float, float, float, float, float, float]:
    """(v, Om) in the world from (v, w_z) of the leaning frame and a direction."""
    spin = np.array([-a[1], a[0], twist[3]])
    vx, vy, vz = (seen.rot.T @ twist[:3]).tolist()
    wx, wy, wz = (seen.rot.T @ spin).tolist()
    return vx, vy, vz, wx, wy, wz


# -- doubtful gravity --------------------------------------------------------------------------------------------------


def _tilted_reply(request: RegionRequest) -> RegionReply:
    push, tolerance = np.array(request.acceleration), request.tolerance_m * math.cos(request.tilt_rad)
    contacts = contacts_of(request.contacts)
    found = tilt_robust(
        contacts,
        request.tilt_rad,
        request.com_height_m,
        acceleration=push,
        tolerance=tolerance,
        limit=request.max_directions,
    )
    left = len(found.polygon) > 0
    return RegionReply(
        status=found.status,
        inner=pairs(found.polygon),
        outer=pairs(found.outer),
        support=(),
        gap=distance(found.polygon, found.outer) if left else None,
        area=max(0.0, float(area(found.polygon))) if left else 0.0,
        area_outer=max(0.0, float(area(found.outer))) if left else None,
    )
