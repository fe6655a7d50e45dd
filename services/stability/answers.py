"""Handlers of the queries of the stability service, and conversion of its results to messages."""

import math
from typing import Any

import numpy as np

from surefoot.arrays import Array
from surefoot.geometry.constants import GRAVITY
from surefoot.geometry.linear import product
from surefoot.robot.description import Robot
from surefoot.robot.kinematics import foot_positions
from surefoot.schemas.stability import (
    CheckReply,
    CheckRequest,
    ComReply,
    ComRequest,
    EquilibriumReply,
    EquilibriumRequest,
    MarginGradient,
    RegionReply,
    RegionRequest,
    StabilityStatus,
    SupportPoint,
)
from surefoot.schemas.whatif import BatchReply, BatchRequest, Variant, WhatifReply, WhatifRequest

from .programs.contacts import StabilityError, contacts_of, within
from .regions.equilibrium import equilibrium, least_forces, least_friction
from .regions.many import STATUSES, Variants, batch, what_if
from .regions.margin import Extent
from .regions.model import Region, Support
from .regions.modes import in_common, regions_in
from .regions.movement import check_movement
from .regions.robust import MarginSlope
from .requests import (
    check_question,
    equilibrium_question,
    named_robot,
    packed_sets,
    region_question,
)
from .sensing.forces import FootForces, com_from_forces, forces_from_torques, fuse_normal, gain_from_weight
from .sensing.posture import posed
from .sensing.pressure import PressureSensor, read_loads
from .sensing.state import Status, WatchParams


def region_reply(request: RegionRequest, own: Robot) -> RegionReply:
    """Return the reply to `stability/region`, a support region; `own` is the robot if the request names none."""
    asked = region_question(request, own)
    found = in_common(regions_in(asked.mode, asked.contacts, asked.wanted))
    return RegionReply(**_region_fields(found, request.certificates, polygons=True))


def check_reply(request: CheckRequest, own: Robot) -> CheckReply:
    """Return the reply to `stability/check`, margins of a planned movement; `own`: robot if the request names none."""
    asked = check_question(request, own)
    found = check_movement(asked.movement)
    check, (x, y), after, shift = found.check, asked.movement.com.tolist(), found.check.com_after, asked.movement.shift
    return CheckReply(
        **_region_fields(found.region, request.certificates, request.polygons),
        stable=check.stable,
        margin=check.margin.value,
        margin_now=check.margin_now.value,
        margin_robust=found.robust,
        gradient=None if found.gradient is None else _gradient(found.gradient),
        extent=_length(check.extent),
        gsm=_length(check.gsm),
        extent_status=None if check.extent is None else check.extent.status,
        gsm_status=None if check.gsm is None else check.gsm.status,
        com=(x, y),
        com_after=(float(after[0]), float(after[1])),
        shift=(float(shift[0]), float(shift[1]), float(shift[2])),
        stance=asked.stance,
        reachable=asked.reachable,
    )


def whatif_reply(request: WhatifRequest) -> WhatifReply:
    """Return the reply to `stability/whatif`: margins now, without each contact, and with each candidate added."""
    contacts, candidates = contacts_of(request.contacts), contacts_of(request.candidates, "candidates")
    found = variants(what_if(contacts, within(request.com, "com"), candidates))
    n = len(contacts)
    return WhatifReply(now=found[0], lifts=found[1 : n + 1], candidates=found[n + 1 :])


def batch_reply(request: BatchRequest) -> BatchReply:
    """Return the reply to `stability/batch`: margins of many sets of contacts."""
    return BatchReply(results=variants(batch(packed_sets(request))))


def equilibrium_reply(request: EquilibriumRequest) -> EquilibriumReply:
    """Return the reply to `stability/equilibrium`: forces that hold the robot, or a proof that none do."""
    asked = equilibrium_question(request)
    found, back = equilibrium(asked.contacts, asked.com), asked.back
    if not found.held:
        proof = None
        if found.twist is not None:
            proof = tuple(np.concatenate((product(back, found.twist[:3]), product(back, found.twist[3:]))).tolist())
        return EquilibriumReply(held=False, forces_n=None, friction_share=None, certificate=proof)
    least, even = least_forces(asked.contacts, asked.com), least_friction(asked.contacts, asked.com)
    force = found.force if least is None else least
    return EquilibriumReply(
        held=True,
        forces_n=None if force is None else _triples(product(asked.weight * force, back.T)),
        friction_share=None if even is None else even.share,
        minmax_forces_n=None if even is None else _triples(product(asked.weight * even.force, back.T)),
        minmax_load_n=None if even is None else asked.weight * even.most,
    )


def com_reply(request: ComRequest, own: Robot) -> ComReply:
    """Return the reply to `stability/com`, the CoM of a posture; `own` is the robot when the request names none."""
    robot = named_robot(request.robot) if request.robot is not None else own
    stands = posed(robot, request.joints, request.base)
    joints, base, rot = stands.joints, stands.base, stands.rot
    x, y, z = stands.com().tolist()
    planned = (x, y, z)
    if request.torque is None:
        return ComReply(com=planned, mass_kg=robot.mass, com_measured=None)
    torque = np.array(request.torque)
    if torque.size != joints.size:
        raise StabilityError("shape", "torque", f"got {torque.size} torques, {robot.name} has {joints.size} joints")
    legs = len(robot.legs)
    touch = np.ones(legs, dtype=np.bool_) if request.touch is None else np.array(request.touch)
    if touch.size != legs:
        raise StabilityError("shape", "touch", f"got {touch.size} feet, {robot.name} has {legs}")
    up = GRAVITY * rot[2]
    gain: float | None = None
    if request.known_weight:
        gain = gain_from_weight(robot, joints, torque, up, touch)
        torque = torque if gain is None else gain * torque
    found = forces_from_torques(robot, joints, torque, up, WatchParams().torque_variance)
    found = FootForces(product(found.force, rot.T), product(product(rot, found.covariance), rot.T), found.observed)
    if request.load_n is not None:
        found = _with_loads(found, request.load_n, robot)
    force, spread = found.force, found.covariance
    measured = None
    if touch.any() and found.observed[touch].all():
        feet = base + product(foot_positions(robot.model, joints), rot.T)
        feet[:, 2] -= robot.foot_radii
        measured = com_from_forces(feet[touch], force[touch], spread[touch], tilt_sd=request.tilt_sd_rad)
    fields: dict[str, Any] = {}
    if measured is not None:
        fields = {"weight_n": measured.weight, "misfit": measured.misfit}
        fields["covariance"] = tuple(measured.covariance.ravel().tolist())
    return ComReply(
        com=planned,
        mass_kg=robot.mass,
        com_measured=None if measured is None else (float(measured.com[0]), float(measured.com[1])),
        forces_n=_triples(force),
        observed=tuple(found.observed.tolist()),
        gain=gain,
        **fields,
    )


def _with_loads(found: FootForces, loads: tuple[float | None, ...], robot: Robot) -> FootForces:
    """Return forces fused with readings `loads` (N, None = none) of sensors under the feet, along the vertical.

    Raises:
        StabilityError: the number of readings is not that of the feet.
    """
    if len(loads) != len(robot.legs):
        raise StabilityError("shape", "load_n", f"got {len(loads)} loads, {robot.name} has {len(robot.legs)} feet")
    sensor = PressureSensor()
    if robot.contacts.kind == "force":
        sensor = PressureSensor(least=robot.contacts.min_n, most=robot.contacts.max_n)
    value, variance = read_loads(np.array([math.nan if load is None else load for load in loads]), sensor)
    return fuse_normal(found, np.tile([0.0, 0.0, 1.0], (len(loads), 1)), value, variance)


def status_message(now: Status, mu: float, fresh: bool) -> StabilityStatus:
    """Return the message of a status; `mu`: friction coefficient of every foot; `fresh`: its samples are recent."""
    measured = now.com_measured
    return StabilityStatus(
        status=now.region.status,
        stance=tuple(now.stance.tolist()),
        region=_pairs(now.region.inner),
        com_planned=(float(now.com_planned[0]), float(now.com_planned[1])),
        com_measured=None if measured is None else (float(measured.com[0]), float(measured.com[1])),
        margin_planned=now.margin_planned.value,
        margin_measured=None if now.margin_measured is None else now.margin_measured.value,
        weight_n=None if measured is None else measured.weight,
        mu=mu,
        fresh=fresh,
    )


def no_status(legs: int, mu: float) -> StabilityStatus:
    """Return the status message of a robot with `legs` legs while a sample is missing; `mu`: friction coefficient."""
    return StabilityStatus(
        status="infeasible",
        stance=(False,) * legs,
        region=(),
        com_planned=None,
        com_measured=None,
        margin_planned=None,
        margin_measured=None,
        mu=mu,
        fresh=False,
    )


def _region_fields(found: Region, proofs: bool, polygons: bool) -> dict[str, Any]:
    """Return the region's fields that replies share; `proofs`: with certificates, `polygons`: with the polygons."""
    sinking = None if found.sinking is None else tuple(found.sinking.tolist())
    level = sinking is not None and len(sinking) == 4
    return {
        "status": found.status,
        "inner": _pairs(found.inner) if polygons else (),
        "outer": _pairs(found.outer) if polygons else (),
        "support": _support(found.support, proofs) if polygons else (),
        "gap": found.gap if math.isfinite(found.gap) else None,
        **found.areas,
        "certificate": sinking if level else None,
        "twist": None if level else sinking,
    }


def _support(support: Support, proofs: bool) -> tuple[SupportPoint, ...]:
    """Return support values as messages; `proofs`: adds certificate or twist, forces, and torques of limited servos."""
    direction, value, point = _pairs(support.direction), support.value.tolist(), _pairs(support.point)
    gap, name = support.gap.tolist(), {4: "certificate", 6: "twist", 0: ""}[support.twist.shape[1]]
    out: list[SupportPoint] = []
    for i, status in enumerate(support.status):
        ok = status == "ok"
        proof: dict[str, Any] = {}
        if proofs and ok and name:
            proof[name] = tuple(support.twist[i].tolist())
        if proofs and status != "infeasible":
            proof["forces"] = _triples(support.force[i])
            if support.torque is not None:
                proof["torques"] = _triples(support.torque[i])
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


def _gradient(slope: MarginSlope) -> MarginGradient:
    """Return the gradient of a margin as a message."""
    x, y = slope.com.tolist()
    return MarginGradient(com=(x, y), mu=tuple(slope.mu.tolist()), position=_triples(slope.position))


def _pairs(points: Array) -> tuple[tuple[float, float], ...]:
    """Return the rows of an array (n, 2) as tuples."""
    return tuple(map(tuple, points.tolist()))  # pyright: ignore[reportReturnType] - rows of two


def _triples(rows: Array) -> tuple[tuple[float, float, float], ...]:
    """Return the rows of an array (n, 3) as tuples."""
    return tuple(map(tuple, rows.tolist()))  # pyright: ignore[reportReturnType] - rows of three


def _length(extent: Extent | None) -> float | None:
    return None if extent is None else extent.value


def variants(found: Variants) -> tuple[Variant, ...]:
    """Return status and margin of many contact sets as messages."""
    status, margin, stable = found.status.tolist(), found.margin.tolist(), found.stable.tolist()
    return tuple(
        Variant(status=STATUSES[s], margin=None if m != m else m, stable=ok)
        for s, m, ok in zip(status, margin, stable, strict=True)
    )
