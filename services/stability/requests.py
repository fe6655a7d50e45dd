"""Requests of the service as objects of the domain, checked once."""

import math
import re
from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from surefoot.geometry.constants import GRAVITY
from surefoot.geometry.linear import product
from surefoot.robot.description import Robot
from surefoot.robot.reader import load_robot, robot_names
from surefoot.schemas.stability import (
    Actuation,
    BasePose,
    CheckRequest,
    Contact,
    EquilibriumRequest,
    RegionFields,
    RegionRequest,
)
from surefoot.schemas.whatif import BatchRequest
from surefoot.tables import TableError

from .programs.contacts import Array, ContactSet, StabilityError, contacts_of, directions_of, refuse, within
from .regions.many import PackedSets, pack
from .regions.modes import Actuated, AtRest, Mode, Moving, Refinement, Tilted, leanings
from .regions.movement import Movement
from .regions.robust import Uncertainty
from .sensing.posture import PosedRobot, posed, torque_limits

MOST_ACCELERATION = 1e4  # m/s^2; with more of it the effective gravity is level to the last digits
REST = AtRest()
_NAME = re.compile(r"[A-Za-z0-9_-]+")


class RegionQuestion(NamedTuple):
    """Region that a request asks for."""

    mode: Mode
    """Mode of the robot."""
    contacts: ContactSet
    """Contacts, frame world."""
    wanted: Refinement
    """Directions to solve for."""


@dataclass(frozen=True, slots=True)
class CheckQuestion:
    """Check that a request asks for."""

    movement: Movement
    """Movement to check."""
    stance: tuple[str, ...]
    """Names of the legs whose feet were held in place."""
    reachable: bool
    """Every stance leg reaches its foot after the movement."""


def region_question(request: RegionRequest, own: Robot) -> RegionQuestion:
    """Read a request for a region; `own` is the robot when the request names none.

    Raises:
        StabilityError: a field that cannot be used.
    """
    if (actuation := request.actuation) is None:
        mode, contacts = _mode(request), contacts_of(request.contacts)
    else:
        refuse(any(request.acceleration), "acceleration", "actuation")
        refuse(request.tilt_rad > 0.0, "tilt_rad", "actuation")
        refuse(request.adaptive is True, "adaptive", "actuation")
        contacts = contacts_of(request.contacts)
        stands, legs, limit = _servos(actuation, request.contacts, contacts, own)
        mode = Actuated(stands.servo_legs(legs, limit))
    given = directions_of(request.directions)
    wanted = Refinement(given, request.adaptive, request.tolerance_m, request.max_directions, request.certificates)
    return RegionQuestion(mode, contacts, wanted)


def check_question(request: CheckRequest, own: Robot) -> CheckQuestion:
    """Read a request for a check; `own` is the robot when the request names none.

    Raises:
        StabilityError: a field that cannot be used.
    """
    robot = named_robot(request.robot) if request.robot is not None else own  # refused if wrong, even without joints
    if request.actuation is not None:
        return _limited_check(request, request.actuation, own)
    if any(request.acceleration) or request.tilt_rad > 0.0:
        refuse(request.gradient, "gradient", "acceleration or tilt_rad")
        refuse(request.doubt is not None, "doubt", "acceleration or tilt_rad")
    contacts, way = contacts_of(request.contacts), within(request.movement, "movement")
    shift, reachable, legs, now = np.zeros(3), True, tuple[str, ...](), request.com
    if request.joints is not None:
        base = within(request.base.position, "base.position")
        stands = posed(robot, request.joints, request.base.quat_wxyz, base)
        stance = stands.standing_legs(contacts, tuple(c.leg for c in request.contacts))
        moved = stands.moved(way, stance)
        shift, reachable = moved.vector, moved.reachable
        legs = tuple(leg.name for leg, held in zip(robot.legs, stance, strict=True) if held)
        if now is None:
            x, y, _ = stands.com().tolist()
            now = (x, y)
    if now is None:
        raise StabilityError("missing", "com", "neither com nor joints are given; one of them is needed")
    com, mode = within(now, "com"), _mode(request)
    given, doubt = directions_of(request.directions), request.doubt
    wanted = Refinement(given, request.adaptive, request.tolerance_m, request.max_directions, request.certificates)
    unknown: Uncertainty | None = None
    if doubt is not None:
        unknown = Uncertainty(
            com=doubt.com_sd_m**2 * np.eye(2),
            foot=np.tile(doubt.foot_sd_m**2 * np.eye(3), (len(contacts), 1, 1)),
            friction=doubt.friction,
            normal=doubt.normal_rad,
            kappa=doubt.kappa,
        )
    movement = Movement(contacts, mode, mode, wanted, com, way, shift, unknown, request.gradient)
    return CheckQuestion(movement, legs, reachable)


def _limited_check(request: CheckRequest, actuation: Actuation, own: Robot) -> CheckQuestion:
    """Read a check with torque limits, before and after the movement."""
    refuse(any(request.acceleration), "acceleration", "actuation")
    refuse(request.joints is not None, "joints", "actuation")
    refuse(request.doubt is not None, "doubt", "actuation")
    for field in ("tilt_rad", "adaptive", "gradient", "robot"):
        refuse(bool(getattr(request, field)), field, "actuation")
    refuse(request.base != BasePose(), "base", "actuation")
    contacts, way = contacts_of(request.contacts), within(request.movement, "movement")
    stands, legs, limit = _servos(actuation, request.contacts, contacts, own)
    wanted = Refinement(directions_of(request.directions))
    stance = np.zeros(stands.robot.nlegs, dtype=np.bool_)
    stance[legs] = True
    moved = stands.moved(way, stance)
    mode = after = Actuated(stands.servo_legs(legs, limit))
    if way.any():
        later = PosedRobot(stands.robot, moved.joints, stands.base + way, stands.rot)
        after = Actuated(later.servo_legs(legs, limit))
    now = within(request.com or (stands.base + product(stands.rot, stands.com_in_base()))[:2], "com")
    names = tuple(stands.robot.legs[i].name for i in sorted(legs))
    return CheckQuestion(Movement(contacts, mode, after, wanted, now, way, moved.vector), names, moved.reachable)


def _mode(request: RegionFields) -> Mode:
    """Read the mode of a request without torque limits."""
    tilted = request.tilt_rad > 0.0
    if not tilted and not any(request.acceleration):
        return REST
    if tilted:
        refuse(request.directions is not None, "directions", "tilt_rad")
        refuse(request.certificates, "certificates", "tilt_rad")
    push = within(request.acceleration, "acceleration", MOST_ACCELERATION, "m/s^2")
    return Tilted(request.tilt_rad, push, request.com_height_m) if tilted else Moving(push, request.com_height_m)


@lru_cache(maxsize=16)
def named_robot(name: str, field: str = "robot") -> Robot:
    """Robot description by name (not by path: a request must not read files of its own choice).

    Raises:
        StabilityError: there is none, by `field`.
    """
    if not _NAME.fullmatch(name):
        raise StabilityError("unknown_robot", field, f"got {name!r}; known are {', '.join(robot_names())}")
    try:
        return load_robot(name)
    except TableError as error:
        raise StabilityError("unknown_robot", field, error.message) from None


def _servos(
    asked: Actuation, given: tuple[Contact, ...], contacts: ContactSet, own: Robot
) -> tuple[PosedRobot, list[int], Array]:
    """Read a posture with the leg on each contact and the torque limits (nj,) Nm."""
    robot = own if asked.robot is None else named_robot(asked.robot, "actuation.robot")
    base = within(asked.base.position, "actuation.base.position")
    stands = posed(robot, asked.joints, asked.base.quat_wxyz, base, "actuation.")
    limit = torque_limits(robot, asked.max_torque_nm)
    return stands, stands.loaded_legs(contacts, tuple(c.leg for c in given)), limit


def packed_sets(request: BatchRequest) -> PackedSets:
    """Read a batch: as sets, or as counts and raw numbers.

    Raises:
        StabilityError: a field that cannot be used.
    """
    if not request.counts:
        if request.data:
            raise StabilityError("missing", "counts", f"got {len(request.data)} bytes of raw numbers, but no counts")
        every = [c for s in request.sets for c in s.contacts]
        return pack(
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
    return pack(contacts[:, :3], contacts[:, 3:6], contacts[:, 6], request.counts, numbers[: 2 * count])


@dataclass(frozen=True, slots=True)
class EquilibriumQuestion:
    """Forces that a request asks for, in the frame along the effective gravity."""

    contacts: ContactSet
    """Contacts."""
    com: Array
    """(2,) m."""
    weight: float
    """N, mass times effective gravity."""
    back: Array
    """rot_world_from_leaning, (3, 3)."""


def equilibrium_question(request: EquilibriumRequest) -> EquilibriumQuestion:
    """Read a request for forces.

    Raises:
        StabilityError: a field that cannot be used, or the robot would fly.
    """
    contacts, place = contacts_of(request.contacts), within(request.com, "com")
    within(request.com_height_m, "com_height_m")
    if not any(request.acceleration):
        return EquilibriumQuestion(contacts, place, request.weight_n, np.eye(3))
    push = within(request.acceleration, "acceleration", MOST_ACCELERATION, "m/s^2")
    (leaning,) = leanings(Moving(push, request.com_height_m), contacts)
    place = leaning.seen(np.append(place, request.com_height_m))
    return EquilibriumQuestion(leaning.contacts, place, request.weight_n * leaning.strength / GRAVITY, leaning.rot.T)
