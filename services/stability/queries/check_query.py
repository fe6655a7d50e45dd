"""Answer to `stability/check`: the movement over the region at rest, of limited torques, or of every gravity."""

from typing import Any

import numpy as np

from surefoot.geometry.linear import product
from surefoot.robot.description import Robot
from surefoot.robot.kinematics import com
from surefoot.schemas.stability import (
    Actuation,
    CheckReply,
    CheckRequest,
    Doubt,
    MarginGradient,
    RegionReply,
    RegionRequest,
)

from ..programs.contacts import Array, StabilityError, refuse, within
from ..regions.effective import leanings
from ..regions.margin import Extent
from ..regions.movement import Check, check, worst
from ..regions.region import Region, region
from ..regions.robust import Uncertainty, margin_gradient, robust_margin
from ..sensing.shift import Shift, kinematic_shift, stance_legs
from .beyond import region_answer
from .limited import limited_check
from .messages import (
    contacts_of,
    named_robot,
    posture,
    region_fields,
    region_of,
    triples,
)


def check_reply(request: CheckRequest, own: Robot) -> CheckReply:
    """Answer to `stability/check`; `own` is the robot when the request names none."""
    robot = named_robot(request.robot) if request.robot is not None else own  # wrong without joints, too
    if request.actuation is not None:
        return _limited(request, request.actuation, own)
    leaning = any(request.acceleration) or request.tilt_rad > 0.0
    if leaning:
        refuse(request.gradient, "gradient", "acceleration or tilt_rad")
        refuse(request.doubt is not None, "doubt", "acceleration or tilt_rad")
    contacts = contacts_of(request.contacts)
    movement = within(request.movement, "movement")
    shift, now = Shift(np.zeros(3), np.empty(0), True), request.com
    legs: tuple[str, ...] = ()
    if request.joints is not None:
        joints, base, rot = posture(robot, request.joints, request.base)
        names = tuple(c.leg for c in request.contacts)
        stance = stance_legs(robot, joints, rot, base, contacts, names)
        shift = kinematic_shift(robot, joints, rot, movement, stance)
        legs = tuple(leg.name for leg, stands in zip(robot.legs, stance, strict=True) if stands)
        if now is None:
            c = base + product(rot, com(robot.model, joints))
            now = (float(c[0]), float(c[1]))
    if now is None:
        raise StabilityError("missing", "com", "neither com nor joints are given; one of them is needed")
    within(now, "com")
    if leaning:
        fields, verdict = _leaning(request, np.array(now), movement, shift.vector)
        return CheckReply(**fields, **_verdict(verdict, now, shift, legs))
    found = region_of(request)
    verdict = check(found, np.array(now), movement, shift.vector)
    return CheckReply(
        **region_fields(found, request.certificates, request.polygons),
        **_verdict(verdict, now, shift, legs),
        margin_robust=None if request.doubt is None else _robust(found, verdict.com_after, request.doubt),
        gradient=_gradient(found, verdict.com_after) if request.gradient else None,
    )


def _leaning(request: CheckRequest, now: Array, movement: Array, shift: Array) -> tuple[dict[str, Any], Check]:
    """Fields of the region in the plane of the CoM, and the worst verdict over every gravity that is possible."""
    asked = {name: getattr(request, name) for name in RegionRequest.model_fields if name in CheckRequest.model_fields}
    reply = region_answer(RegionRequest.model_construct(**asked), None)
    fields = _fields(reply, request.polygons)
    checks: list[Check] = []
    for seen in leanings(contacts_of(request.contacts), np.array(request.acceleration), request.tilt_rad):
        found = region(seen.contacts, tolerance=request.tolerance_m, limit=request.max_directions)
        checks.append(check(found, now, movement, shift, seen.plane(request.com_height_m)))
        if found.status == "infeasible":
            return fields, checks[-1]
    return fields, worst(checks)


def _limited(request: CheckRequest, actuation: Actuation, own: Robot) -> CheckReply:
    found = limited_check(request, actuation, own)
    legs = tuple(found.before.robot.legs[i].name for i in sorted(found.before.chosen))
    fields = _fields(found.reply, request.polygons)
    return CheckReply(**fields, **_verdict(found.verdict, found.now, found.shift, legs))


def _fields(reply: RegionReply, polygons: bool) -> dict[str, Any]:
    """The fields of a region's reply, as those of a CheckReply."""
    fields = {name: getattr(reply, name) for name in type(reply).model_fields}
    return fields if polygons else fields | {"inner": (), "outer": (), "support": ()}


def _verdict(verdict: Check, now: tuple[float, float], shift: Shift, legs: tuple[str, ...]) -> dict[str, Any]:
    return {
        "stable": verdict.stable,
        "margin": verdict.margin.value,
        "margin_now": verdict.margin_now.value,
        "extent": _length(verdict.extent),
        "gsm": _length(verdict.gsm),
        "extent_status": None if verdict.extent is None else verdict.extent.status,
        "gsm_status": None if verdict.gsm is None else verdict.gsm.status,
        "com": now,
        "com_after": (float(verdict.com_after[0]), float(verdict.com_after[1])),
        "shift": (float(shift.vector[0]), float(shift.vector[1]), float(shift.vector[2])),
        "stance": legs,
        "reachable": shift.reachable,
    }


def _robust(found: Region, com_after: Array, doubt: Doubt) -> float | None:
    n = len(found.contacts)
    return robust_margin(
        found.contacts,
        com_after,
        Uncertainty(
            com=doubt.com_sd_m**2 * np.eye(2),
            foot=np.tile(doubt.foot_sd_m**2 * np.eye(3), (n, 1, 1)),
            friction=doubt.friction,
            normal=doubt.normal_rad,
            kappa=doubt.kappa,
        ),
    )


def _gradient(found: Region, com_after: Array) -> MarginGradient | None:
    slope = margin_gradient(found.contacts, com_after)
    if slope is None:
        return None
    mu, place = tuple(slope.mu.tolist()), triples(slope.position)
    return MarginGradient(com=(float(slope.com[0]), float(slope.com[1])), mu=mu, position=place)


def _length(extent: Extent | None) -> float | None:
    return None if extent is None else extent.value
