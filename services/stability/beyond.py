"""Answers to `stability/region` beyond rest and strong servos: acceleration, doubtful gravity, limited torques."""

import math
from typing import Any

import numpy as np

from schemas.stability import RegionReply, RegionRequest, SupportPoint
from services.stability.actuated import ActuatedRegion, Legs, actuated_region
from services.stability.contacts import Array, ContactSet, StabilityError
from services.stability.directions import equally_spaced
from services.stability.effective import GRAVITY, Leaning, lean, stays_down, tilt_robust, upward
from services.stability.forces import contact_jacobians
from services.stability.messages import (
    contacts_of,
    directions_of,
    named_robot,
    pairs,
    posture,
    region_of,
    region_reply,
    triples,
)
from services.stability.region import Region, region
from services.stability.shift import NEAR
from surefoot.kinematics import foot_positions, gravity_torques
from surefoot.polygon import area, half_planes, hull, signed_distance
from surefoot.robot import Robot


def region_answer(request: RegionRequest, own: Robot | None) -> RegionReply:
    """Answer to `stability/region`; `own` is the robot when the request names none (needed with actuation only)."""
    moving, leaning = any(request.acceleration), request.tilt_rad > 0.0
    if request.actuation is not None:
        refuse(moving, "acceleration", "actuation")
        refuse(leaning, "tilt_rad", "actuation")
        refuse(request.adaptive is True, "adaptive", "actuation")
        assert own is not None
        return _actuated_reply(request, own)
    if leaning:
        refuse(request.directions is not None, "directions", "tilt_rad")
        refuse(request.certificates, "certificates", "tilt_rad")
        return _tilted_reply(request)
    if moving:
        return _moving_reply(request)
    return region_reply(region_of(request), request)


def refuse(given: bool, field: str, other: str) -> None:
    """Refuse a field that cannot be combined with another."""
    if given:
        raise StabilityError("unsupported", field, f"cannot be asked for together with {other}")


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
    unbounded = found.regions[-1].status == "unbounded"
    left = len(found.polygon) > 2
    return RegionReply(
        status="ok" if left else "unbounded" if unbounded else "infeasible",
        inner=pairs(found.polygon) if left else (),
        outer=pairs(found.outer) if left else (),
        support=(),
        gap=_between(found.polygon, found.outer) if left else None,
        area=max(0.0, float(area(found.polygon))) if left else 0.0,
        area_outer=max(0.0, float(area(found.outer))) if left else None,
    )


def _between(inner: Array, outer: Array) -> float:
    """Largest distance of a corner of `outer` from `inner`, m."""
    return max(0.0, *(-float(signed_distance(inner, float(x), float(y))) for x, y in outer))


# -- limited torques ---------------------------------------------------------------------------------------------------


def _actuated_reply(request: RegionRequest, own: Robot) -> RegionReply:
    assert request.actuation is not None
    contacts = contacts_of(request.contacts)
    legs = _legs(request, own, contacts)
    given = directions_of(request)
    first = equally_spaced(16)  # they alone tell point, segment and area
    found = actuated_region(contacts, legs, first if given is None else np.concatenate((first, given)))
    inner, outer = np.ascontiguousarray(found.inner), np.ascontiguousarray(found.inner)
    if found.status == "ok":
        size = float(np.abs(found.outer_value).max() + np.abs(inner).max())
        cut = half_planes(np.ascontiguousarray(found.direction), found.outer_value.copy(), 8.0 * size + 1.0)
        outer = hull(cut)
    return RegionReply(
        status=found.status,
        inner=pairs(inner),
        outer=pairs(outer),
        support=_actuated_support(found, 0 if given is None else len(first), request.certificates),
        gap=None if found.status == "infeasible" else _between(inner, outer) if found.status == "ok" else 0.0,
        area=max(0.0, float(area(inner))),
        area_outer=max(0.0, float(area(outer))) if len(outer) else None,
    )


def _actuated_support(found: ActuatedRegion, begin: int, proven: bool) -> tuple[SupportPoint, ...]:
    out: list[SupportPoint] = []
    held = found.status != "infeasible"
    for k in range(begin, len(found.direction)):
        proof: dict[str, Any] = {}
        if held and proven:
            proof = {"forces": triples(found.force[k]), "torques": triples(found.torque[k])}
        out.append(
            SupportPoint(
                direction=pairs(found.direction[k : k + 1])[0],
                value=float(found.outer_value[k]) if held else None,
                point=pairs(found.point[k : k + 1])[0] if held else None,
                status="ok" if held else "infeasible",
                gap=found.gap if held else None,
                **proof,
            )
        )
    return tuple(out)


def _legs(request: RegionRequest, own: Robot, contacts: ContactSet) -> Legs:
    """What the servos of the legs on the contacts can do, in the order of the contacts."""
    asked = request.actuation
    assert asked is not None
    try:
        robot = named_robot(asked.robot) if asked.robot is not None else own
        joints, base, rot = posture(robot, asked.joints, asked.base)
    except StabilityError as error:
        raise StabilityError(error.code, f"actuation.{error.field}", error.message) from None
    model = robot.model
    if model.leg_joints.shape[1] != 3 or (model.leg_joints < 0).any():
        raise StabilityError(
            "unsupported", "actuation.robot", f"the legs of {robot.name} have not three joints each: no answer for it"
        )
    limit = np.array([joint.servo.max_torque for joint in robot.joints])
    if isinstance(asked.max_torque_nm, float):
        limit[:] = asked.max_torque_nm
    elif asked.max_torque_nm is not None:
        limit = np.array(asked.max_torque_nm)
    if limit.size != robot.nj:
        wanted = f"got {limit.size} limits, {robot.name} has {robot.nj} joints"
        raise StabilityError("shape", "actuation.max_torque_nm", wanted)
    for i in np.flatnonzero(~(limit > 0.0)):
        raise StabilityError("not_positive", f"actuation.max_torque_nm.{i}", f"got {limit[i]}, must be more than 0")
    up = np.ascontiguousarray(rot.T @ np.array([0.0, 0.0, 1.0]))
    radius = np.array([leg.foot.radius for leg in robot.legs])
    feet = base + foot_positions(model, joints) @ rot.T
    chosen = _standing(robot, feet, radius, contacts, tuple(c.leg for c in request.contacts))
    jacobian = rot @ contact_jacobians(model, joints, up, radius)[chosen]
    index = model.leg_joints[chosen]
    own_weight = gravity_torques(model, joints, GRAVITY * up)[index]
    return Legs(jacobian, own_weight, limit[index], robot.mass * GRAVITY)


def _standing(
    robot: Robot, feet: Array, radius: Array, contacts: ContactSet, names: tuple[str | None, ...]
) -> list[int]:
    """The leg of each contact: by name, else that whose foot is nearest (within 3 cm)."""
    known, out = [leg.name for leg in robot.legs], list[int]()
    for i, name in enumerate(names):
        field = f"contacts.{i}.leg"
        if name is not None and name not in known:
            allowed = ", ".join(known)
            raise StabilityError("unknown_leg", field, f"got {name!r}, legs of {robot.name} are {allowed}")
        distance = np.linalg.norm(feet - contacts.position[i], axis=1) - radius
        leg = int(distance.argmin()) if name is None else known.index(name)
        if distance[leg] >= NEAR:
            who = f"the foot nearest to it, of {known[leg]}" if name is None else f"the foot of {name}"
            raise StabilityError("missing", field, f"{who}, is {distance[leg]:.3f} m away in the posture given")
        if leg in out:
            raise StabilityError("duplicate_leg", field, f"{known[leg]!r} stands on another contact already")
        out.append(leg)
    return out
