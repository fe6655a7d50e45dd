"""Answers to `stability/region` and `stability/check` where the torques of the servos are limited too."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from surefoot.geometry.constants import GRAVITY
from surefoot.geometry.polygon import area, half_planes, hull
from surefoot.robot.description import Robot
from surefoot.robot.kinematics import com, foot_positions, gravity_torques
from surefoot.schemas.stability import (
    Actuation,
    BasePose,
    CheckRequest,
    Contact,
    RegionFields,
    RegionReply,
    SupportPoint,
)

from ..programs.contacts import Array, ContactSet, StabilityError, refuse, within
from ..programs.directions import equally_spaced
from ..programs.oracle import Support
from ..regions.actuated import ActuatedRegion, Legs, actuated_region
from ..regions.movement import Check, check
from ..regions.region import Region, distance
from ..sensing.forces import contact_jacobians
from ..sensing.shift import NEAR, Shift, kinematic_shift
from .messages import (
    contacts_of,
    directions_of,
    named_robot,
    pairs,
    posture,
    triples,
)


@dataclass(frozen=True, slots=True)
class LimitedStance:
    """A robot that stands on contacts, one leg on each."""

    robot: Robot
    joints: Array
    """(nj,) rad."""
    base: Array
    """(3,) m."""
    rot: Array
    """rot_world_from_base."""
    chosen: list[int]
    """Index of the leg on each contact."""
    limit: Array
    """(nj,) Nm."""

    def legs(self) -> Legs:
        """What the servos of the legs on the contacts can do, in the order of the contacts."""
        model, up = self.robot.model, self.rot.T @ np.array([0.0, 0.0, 1.0])
        radius = np.array([leg.foot.radius for leg in self.robot.legs])
        jacobian = self.rot @ contact_jacobians(model, self.joints, np.ascontiguousarray(up), radius)[self.chosen]
        index = model.leg_joints[self.chosen]
        own = gravity_torques(model, self.joints, np.ascontiguousarray(GRAVITY * up))[index]
        return Legs(jacobian, own, self.limit[index], self.robot.mass * GRAVITY)

    def com(self) -> Array:
        """Centre of mass by kinematics, (3,) m."""
        return np.asarray(self.base + self.rot @ com(self.robot.model, self.joints))

    def moved(self, movement: Array) -> tuple["LimitedStance", Shift]:
        """The posture after the trunk has moved over the feet, and what that does to the CoM in the trunk."""
        stance = np.zeros(len(self.robot.legs), dtype=np.bool_)
        stance[self.chosen] = True
        shift = kinematic_shift(self.robot, self.joints, self.rot, movement, stance)
        return replace(self, joints=shift.joints, base=self.base + movement), shift


@dataclass(frozen=True, slots=True)
class Moved:
    """A planned movement under torque limits."""

    before: LimitedStance
    now: tuple[float, float]
    """Where the CoM was taken to be."""
    shift: Shift
    verdict: Check
    reply: RegionReply
    """Of the posture after the movement."""


def limited_reply(asked: RegionFields, actuation: Actuation, own: Robot) -> RegionReply:
    """Answer to `stability/region`; `own` is the robot when the request names none."""
    contacts = contacts_of(asked.contacts)
    return _reply(asked, contacts, standing(actuation, asked.contacts, contacts, own))[1]


def limited_check(request: CheckRequest, actuation: Actuation, own: Robot) -> Moved:
    """A movement judged by the region of the posture after it; the CoM now, and its way to the edge, by that of now."""
    refuse(any(request.acceleration), "acceleration", "actuation")
    refuse(request.joints is not None, "joints", "actuation")
    refuse(request.doubt is not None, "doubt", "actuation")
    for field in ("tilt_rad", "adaptive", "gradient", "robot"):
        refuse(bool(getattr(request, field)), field, "actuation")
    refuse(request.base != BasePose(), "base", "actuation")
    contacts, movement = contacts_of(request.contacts), within(request.movement, "movement")
    before = standing(actuation, request.contacts, contacts, own)
    after, shift = before.moved(movement)
    here, reply = _reply(request, contacts, before)
    there = here
    if movement.any():
        there, reply = _reply(request, contacts, after)
    planned = before.com()
    now = request.com or (float(planned[0]), float(planned[1]))
    within(now, "com")
    at_first = check(here, np.array(now), movement, shift.vector)
    then = check(there, np.array(now), movement, shift.vector)
    verdict = replace(then, margin_now=at_first.margin_now, extent=at_first.extent)
    return Moved(before, now, shift, verdict, reply)


def _reply(asked: RegionFields, contacts: ContactSet, stands: LimitedStance) -> tuple[Region, RegionReply]:
    """The region for margins, which lies inside the true one by at most its gap, and as it travels."""
    given = directions_of(asked)
    first = equally_spaced(16)  # they alone tell point, segment and area
    found = actuated_region(contacts, stands.legs(), first if given is None else np.concatenate((first, given)))
    inner = outer = np.ascontiguousarray(found.inner)
    if found.status == "ok":
        size = float(np.abs(found.outer_value).max() + np.abs(inner).max())
        cut = half_planes(np.ascontiguousarray(found.direction), found.outer_value.copy(), 8.0 * size + 1.0)
        outer = hull(cut)
    gap = None if found.status == "infeasible" else max(0.0, float(distance(inner, outer)))
    reply = RegionReply(
        status=found.status,
        inner=pairs(inner),
        outer=pairs(outer),
        support=_support(found, 0 if given is None else len(first), asked.certificates),
        gap=gap if found.status in ("ok", "infeasible") else 0.0,
        area=max(0.0, float(area(inner))),
        area_outer=max(0.0, float(area(outer))) if len(outer) else None,
    )
    k, held = len(found.direction), found.status != "infeasible"
    nan, status = np.full(k, np.nan), "ok" if held else "infeasible"
    support = Support(
        found.direction, found.outer_value, found.point, (status,) * k, nan, np.full((k, 4), np.nan), found.force
    )
    return Region(contacts, found.status, inner, outer, support, reply.gap or 0.0, True, k), reply


def _support(found: ActuatedRegion, begin: int, proven: bool) -> tuple[SupportPoint, ...]:
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


def standing(asked: Actuation, given: tuple[Contact, ...], contacts: ContactSet, own: Robot) -> LimitedStance:
    """The posture of a request, checked.

    Raises:
        StabilityError: the field of it that cannot be used.
    """
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
    radius = np.array([leg.foot.radius for leg in robot.legs])
    feet = base + foot_positions(model, joints) @ rot.T
    chosen = _chosen(robot, feet, radius, contacts, tuple(c.leg for c in given))
    return LimitedStance(robot, joints, base, rot, chosen, limit)


def _chosen(robot: Robot, feet: Array, radius: Array, contacts: ContactSet, names: tuple[str | None, ...]) -> list[int]:
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
