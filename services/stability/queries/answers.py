"""Answers to `stability/whatif`, `batch`, `equilibrium` and `com`."""

import math
from typing import Any

import numpy as np

from surefoot.geometry.constants import GRAVITY
from surefoot.robot.description import Robot
from surefoot.robot.kinematics import com, foot_positions
from surefoot.schemas.stability import ComReply, ComRequest, EquilibriumReply, EquilibriumRequest
from surefoot.schemas.whatif import BatchReply, BatchRequest, Variant, WhatifReply, WhatifRequest

from ..programs.contacts import StabilityError, within
from ..regions import whatif
from ..regions.effective import lean, stays_down, upward
from ..regions.equilibrium import equilibrium, least_forces, least_friction
from ..regions.many import STATUSES, Variants
from ..sensing.forces import (
    FootForces,
    com_from_forces,
    forces_from_torques,
    fuse_normal,
    gain_from_weight,
)
from ..sensing.pressure import PressureSensor, read_loads
from ..sensing.state import WatchParams
from .messages import contacts_of, named_robot, posture, triples


def whatif_reply(request: WhatifRequest) -> WhatifReply:
    """Answer to `stability/whatif`."""
    contacts, candidates = contacts_of(request.contacts), contacts_of(request.candidates, "candidates")
    found = variants(whatif.what_if(contacts, within(request.com, "com"), candidates))
    n = len(contacts)
    return WhatifReply(now=found[0], lifts=found[1 : n + 1], candidates=found[n + 1 :])


def batch_reply(request: BatchRequest) -> BatchReply:
    """Answer to `stability/batch`."""
    return BatchReply(results=variants(whatif.batch(_batch_of(request))))


def _batch_of(request: BatchRequest) -> whatif.Batch:
    if not request.counts:
        if request.data:
            raise StabilityError("missing", "counts", f"got {len(request.data)} bytes of raw numbers, but no counts")
        every = [c for s in request.sets for c in s.contacts]
        return whatif.pack(
            [c.position for c in every],
            [c.normal for c in every],
            [math.inf if c.mu is None else c.mu for c in every],
            [len(s.contacts) for s in request.sets],
            [s.com for s in request.sets],
        )
    if request.sets:
        raise StabilityError("unsupported", "sets", "cannot be given together with counts")
    count, total = len(request.counts), sum(request.counts)
    wanted = 8 * (2 * count + 7 * total)
    if len(request.data) != wanted:
        raise StabilityError("shape", "data", f"got {len(request.data)} bytes, the counts ask for {wanted}")
    numbers = np.frombuffer(request.data, dtype="<f8")
    contacts = numbers[2 * count :].reshape(-1, 7)
    return whatif.pack(contacts[:, :3], contacts[:, 3:6], contacts[:, 6], request.counts, numbers[: 2 * count])


def variants(found: Variants) -> tuple[Variant, ...]:
    """Verdicts as they travel."""
    status, margin, stable = found.status.tolist(), found.margin.tolist(), found.stable.tolist()
    return tuple(
        Variant(status=STATUSES[s], margin=None if m != m else m, stable=ok)
        for s, m, ok in zip(status, margin, stable, strict=True)
    )


def equilibrium_reply(request: EquilibriumRequest) -> EquilibriumReply:
    """Answer to `stability/equilibrium`."""
    contacts, place = contacts_of(request.contacts), within(request.com, "com")
    within(request.com_height_m, "com_height_m")
    weight, back = request.weight_n, np.eye(3)
    if any(request.acceleration):
        up = upward(np.array(request.acceleration))
        stays_down(up, np.array(request.acceleration))
        leaning = lean(contacts, up)
        contacts, place = leaning.contacts, leaning.seen(np.append(place, request.com_height_m))
        weight, back = weight * leaning.strength / GRAVITY, leaning.rot.T
    found = equilibrium(contacts, place)
    if not found.held:
        proof = None
        if found.twist is not None:
            proof = tuple(np.concatenate((back @ found.twist[:3], back @ found.twist[3:])).tolist())
        return EquilibriumReply(held=False, forces_n=None, friction_share=None, certificate=proof)
    least, even = least_forces(contacts, place), least_friction(contacts, place)
    force = found.force if least is None else least
    return EquilibriumReply(
        held=True,
        forces_n=None if force is None else triples(weight * force @ back.T),
        friction_share=None if even is None else even.share,
        minmax_forces_n=None if even is None else triples(weight * even.force @ back.T),
    )


def com_reply(request: ComRequest, own: Robot) -> ComReply:
    """Answer to `stability/com`; `own` is the robot when the request names none."""
    robot = named_robot(request.robot) if request.robot is not None else own
    joints, base, rot = posture(robot, request.joints, request.base)
    c = base + rot @ com(robot.model, joints)
    planned = (float(c[0]), float(c[1]), float(c[2]))
    if request.torque is None:
        return ComReply(com=planned, mass_kg=robot.mass, com_measured=None)
    torque = np.array(request.torque)
    if torque.size != joints.size:
        raise StabilityError("shape", "torque", f"got {torque.size} torques, {robot.name} has {joints.size} joints")
    legs = len(robot.legs)
    touch = np.ones(legs, dtype=np.bool_) if request.touch is None else np.array(request.touch)
    if touch.size != legs:
        raise StabilityError("shape", "touch", f"got {touch.size} feet, {robot.name} has {legs}")
    up = np.ascontiguousarray(rot.T @ np.array([0.0, 0.0, GRAVITY]))
    gain: float | None = None
    if request.known_weight:
        gain = gain_from_weight(robot, joints, torque, up, touch)
        torque = torque if gain is None else gain * torque
    found = forces_from_torques(robot, joints, torque, up, WatchParams().torque_variance)
    found = FootForces(found.force @ rot.T, rot @ found.covariance @ rot.T, found.observed)
    if request.load_n is not None:
        found = _with_loads(found, request.load_n, robot)
    force, spread = found.force, found.covariance
    measured = None
    if touch.any() and found.observed[touch].all():
        feet = base + foot_positions(robot.model, joints) @ rot.T
        feet[:, 2] -= [leg.foot.radius for leg in robot.legs]
        measured = com_from_forces(feet[touch], force[touch], spread[touch], tilt_sd=request.tilt_sd_rad)
    fields: dict[str, Any] = {}
    if measured is not None:
        fields = {"weight_n": measured.weight, "misfit": measured.misfit}
        fields["covariance"] = tuple(measured.covariance.ravel().tolist())
    return ComReply(
        com=planned,
        mass_kg=robot.mass,
        com_measured=None if measured is None else (float(measured.com[0]), float(measured.com[1])),
        forces_n=triples(force),
        observed=tuple(found.observed.tolist()),
        gain=gain,
        **fields,
    )


def _with_loads(found: FootForces, loads: tuple[float | None, ...], robot: Robot) -> FootForces:
    """Forces fused with what sensors under the feet say, taken along the vertical."""
    if len(loads) != len(robot.legs):
        raise StabilityError("shape", "load_n", f"got {len(loads)} loads, {robot.name} has {len(robot.legs)} feet")
    sensor = PressureSensor()
    if robot.contacts.kind == "force":
        sensor = PressureSensor(least=robot.contacts.min_n, most=robot.contacts.max_n)
    value, variance = read_loads(np.array([math.nan if load is None else load for load in loads]), sensor)
    return fuse_normal(found, np.tile([0.0, 0.0, 1.0], (len(loads), 1)), value, variance)
