"""Conversion of requests to the stability service to checked contact sets, modes and postures."""

import math
import re
from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from surefoot.arrays import Array
from surefoot.geometry.constants import GRAVITY
from surefoot.robot.description import Robot
from surefoot.robot.reader import load_robot, robot_names
from surefoot.schemas.stability import (
    BasePose,
    CheckRequest,
    Doubt,
    EquilibriumRequest,
    RegionRequest,
)
from surefoot.schemas.whatif import BatchRequest
from surefoot.tables import TableError

from .programs.contacts import ContactSet, StabilityError, contacts_of, directions_of, within
from .regions.many import PackedSets, pack
from .regions.modes import Actuated, AtRest, Mode, Moving, Refinement, Tilted, leanings
from .regions.movement import Movement
from .regions.robust import Uncertainty
from .sensing import posture

MOST_ACCELERATION = 1e4  # m/s^2; with more of it the effective gravity is level to the last digits
_NAME = re.compile(r"[A-Za-z0-9_-]+")


class RegionQuestion(NamedTuple):
    """Content of a request for a region: gravity, contacts, directions, posture."""

    mode: Mode
    """Mode of the robot: at rest, moving, tilted, or held by its servos."""
    contacts: ContactSet
    """Contacts of the robot with the ground, frame world."""
    wanted: Refinement
    """Directions in which the region is solved for, and their refinement."""
    held: posture.HeldRobot | None
    """Robot in the posture in which its servos hold it; None unless the mode is that of limited torques."""


@dataclass(frozen=True, slots=True)
class CheckQuestion:
    """Content of a request to `stability/check`: a planned movement, and the legs that stand."""

    movement: Movement
    """Planned movement of the trunk whose margins are requested."""
    stance: tuple[str, ...]
    """Names of the legs whose feet stay in place during the movement."""
    reachable: bool
    """True if every stance leg reaches its foot after the movement, False if one does not."""


def region_question(request: RegionRequest | CheckRequest, own: Robot) -> RegionQuestion:
    """Return the checked content of a request for a region; `own` is the robot when the request names none.

    Raises:
        StabilityError: a field that cannot be used.
    """
    tilted, pushed = request.tilt_rad > 0.0, any(request.acceleration)
    contacts, held = contacts_of(request.contacts), None
    mode: Mode = AtRest()
    if (actuation := request.actuation) is not None:
        _refuse("actuation", acceleration=pushed, tilt_rad=tilted, adaptive=request.adaptive is True)
        robot = own if actuation.robot is None else named_robot(actuation.robot, "actuation.robot")
        held = posture.held(robot, actuation, contacts, tuple(c.leg for c in request.contacts))
        mode = Actuated(held.servos)
    elif tilted or pushed:
        if tilted:
            _refuse("tilt_rad", directions=request.directions is not None, certificates=request.certificates)
        push, height = within(request.acceleration, "acceleration", MOST_ACCELERATION, "m/s^2"), request.com_height_m
        mode = Tilted(request.tilt_rad, push, height) if tilted else Moving(push, height)
    given = directions_of(request.directions)
    wanted = Refinement(given, request.adaptive, request.tolerance_m, request.max_directions, request.certificates)
    return RegionQuestion(mode, contacts, wanted, held)


def check_question(request: CheckRequest, own: Robot) -> CheckQuestion:
    """Return the checked content of a request for a check of a movement; `own`: robot if the request names none.

    Raises:
        StabilityError: a field that cannot be used.
    """
    robot = named_robot(request.robot) if request.robot is not None else own  # refused if wrong, even without joints
    joints, doubt = request.joints, request.doubt
    if request.actuation is not None:
        _refuse("actuation", joints=joints is not None, doubt=doubt is not None, gradient=request.gradient)
        _refuse("actuation", robot=request.robot is not None, base=request.base != BasePose())
    elif request.tilt_rad > 0.0 or any(request.acceleration):
        _refuse("acceleration or tilt_rad", gradient=request.gradient, doubt=doubt is not None)
    asked = region_question(request, own)
    contacts, way, now, after = asked.contacts, within(request.movement, "movement"), request.com, asked.mode
    shift, reachable, legs = np.zeros(3), True, tuple[str, ...]()
    stands = asked.held if joints is None else posture.posed(robot, joints, request.base)
    if stands is not None:
        step = posture.stepped(stands, contacts, tuple(c.leg for c in request.contacts), way)
        shift, reachable, legs = step.shift, step.reachable, step.legs
        if step.servos is not None:
            after = Actuated(step.servos)
        if now is None:
            now = step.com
    if now is None:
        raise StabilityError("missing", "com", "neither com nor joints are given; one of them is needed")
    com, unknown = within(now, "com"), None if doubt is None else _uncertainty(doubt, len(contacts))
    movement = Movement(contacts, asked.mode, after, asked.wanted, com, way, shift, unknown, request.gradient)
    return CheckQuestion(movement, legs, reachable)


def _refuse(other: str, **given: bool) -> None:
    """Raise StabilityError for the first field that is given (True) and cannot be combined with that named `other`."""
    for field, wanted in given.items():
        if wanted:
            raise StabilityError("unsupported", field, f"cannot be asked for together with {other}")


def _uncertainty(doubt: Doubt, n: int) -> Uncertainty:
    """Return the uncertainty of the inputs of a margin with n contacts, as a request states it."""
    return Uncertainty(
        com=doubt.com_sd_m**2 * np.eye(2),
        foot=np.tile(doubt.foot_sd_m**2 * np.eye(3), (n, 1, 1)),
        friction=doubt.friction,
        normal=doubt.normal_rad,
        kappa=doubt.kappa,
    )


@lru_cache(maxsize=16)
def named_robot(name: str, field: str = "robot") -> Robot:
    """Return a robot description by name (not by path: a request must not read files of its own choice).

    Raises:
        StabilityError: there is no such robot; its field is `field`.
    """
    if not _NAME.fullmatch(name):
        raise StabilityError("unknown_robot", field, f"got {name!r}; known are {', '.join(robot_names())}")
    try:
        return load_robot(name)
    except TableError as error:
        raise StabilityError("unknown_robot", field, error.message) from None


def packed_sets(request: BatchRequest) -> PackedSets:
    """Return the contact sets of a batch, which gives them as sets, or as counts and raw numbers.

    The raw numbers are little-endian doubles: x, y of the CoM of every set, then position, normal and friction
    coefficient of every contact (7 each).

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
    """Content of a request for contact forces, turned into the frame along the effective gravity."""

    contacts: ContactSet
    """Contacts that may carry the robot, frame with z against the effective gravity (at rest: frame world)."""
    com: Array
    """Centre of mass, x and y, (2,) m, in the frame of the contacts."""
    weight: float
    """Weight that the contacts carry, N: mass times effective gravity."""
    back: Array
    """Rotation from the frame of the contacts to frame world, (3, 3)."""


def equilibrium_question(request: EquilibriumRequest) -> EquilibriumQuestion:
    """Return the checked content of a request for the contact forces that hold the robot.

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
