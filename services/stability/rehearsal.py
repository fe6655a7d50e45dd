"""A dry run of the stability service: made-up requests and stances of its robot, and contact sets of every kind."""

import math

import numpy as np

from surefoot.arrays import Array
from surefoot.geometry.constants import GRAVITY
from surefoot.geometry.linear import solve
from surefoot.robot.description import Robot
from surefoot.robot.kinematics import foot_positions
from surefoot.schemas.stability import Actuation, CheckRequest, ComRequest, Contact, EquilibriumRequest, RegionRequest
from surefoot.schemas.whatif import BatchRequest, WhatifRequest

from .answers import batch_reply, check_reply, com_reply, equilibrium_reply, region_reply, whatif_reply
from .programs.contacts import AXES, ContactSet
from .regions.margin import extent, margin
from .regions.region import region
from .sensing import state
from .sensing.forces import leg_inverses

UP = (0.0, 0.0, 1.0)
AT_REST = np.array([0.0, 0.0, GRAVITY])
"""Specific force at rest of a level trunk, base_link, (3,) m/s^2."""
MOVEMENT = (0.01, 0.0, 0.0)
"""Movement of the trunk in a made-up request, frame world, (3,) m."""


def rehearse(robot: Robot, params: state.WatchParams) -> None:
    """Run the requests of a walking robot, and the contact sets that its feet can make, so that kernels are loaded."""
    _regions()
    contacts, joints = _contacts(robot), tuple(robot.neutral.tolist())
    com = contacts[0].position[:2]
    region_reply(RegionRequest(contacts=contacts), robot)
    region_reply(RegionRequest(contacts=contacts, directions=4, certificates=True), robot)
    for chosen in (contacts, contacts[::2]):
        check_reply(CheckRequest(contacts=chosen, joints=joints, movement=MOVEMENT), robot)
    check_reply(CheckRequest(contacts=contacts, com=com), robot)
    com_reply(ComRequest(joints=joints, torque=(0.1,) * robot.nj), robot)
    equilibrium_reply(EquilibriumRequest(contacts=contacts, com=com))
    _statuses(robot, params)


def rehearse_rare(robot: Robot) -> None:
    """Run the queries with kernels of their own that no walk requests: many sets at once, limits of servos."""
    contacts, joints = _contacts(robot), tuple(robot.neutral.tolist())
    com = contacts[0].position[:2]
    whatif_reply(WhatifRequest(contacts=contacts, com=com))
    batch_reply(BatchRequest.model_validate({"sets": [{"contacts": contacts, "com": com}]}))
    if robot.kind == "hexapod":
        region_reply(RegionRequest(contacts=contacts, actuation=Actuation(joints=joints)), robot)


def _contacts(robot: Robot) -> tuple[Contact, ...]:
    """Return the contacts of the neutral stance: points under the feet, m, frame base_link."""
    feet = foot_positions(robot.model, robot.neutral) - robot.foot_radius * np.array(UP)
    return tuple(Contact(position=tuple(foot.tolist()), normal=UP, mu=0.5) for foot in feet)


def _regions() -> None:
    """Compute regions of sets with an area and without, level and not, with no friction and with unlimited."""
    feet = np.array([[0.1, 0.1, 0.0], [0.1, -0.1, 0.0], [-0.1, 0.0, 0.02], [0.0, 0.1, 0.0]])
    for chosen, mu in (
        ([0, 1, 2, 3], 0.5),
        ([0, 1, 3], 0.5),
        ([0, 2], 0.5),
        ([0, 1, 2, 3], 0.0),
        ([0, 1, 2, 3], math.inf),
    ):
        some = ContactSet(feet[chosen], np.tile(UP, (len(chosen), 1)), np.full(len(chosen), mu))
        region(some)
        found = region(some, AXES)
        if found.status == "ok":
            margin(found, np.zeros(2))
            extent(found, np.zeros(2), np.array([1.0, 0.0]))


def _statuses(robot: Robot, params: state.WatchParams) -> None:
    """Compute the status of the neutral stance on all feet and on every second."""
    every, torque = np.ones(len(robot.legs), dtype=np.bool_), _holding(robot)
    standing = state.StandingFeet(len(robot.legs), params.hold_s)
    for touch in (every, np.arange(len(robot.legs)) % 2 == 0):
        state.watch(robot, robot.neutral, standing.update(0.0, touch, every), AT_REST, torque, params)
        state.watch(robot, robot.neutral, touch, AT_REST, None, params)


def _holding(robot: Robot) -> Array:
    """Return torques, (nj,) Nm, with which every foot carries an equal share of the weight."""
    found = leg_inverses(robot, robot.neutral, AT_REST)
    torque = found.own.copy()
    for i in np.flatnonzero(found.observed):
        push = solve(found.inverse[i], np.array([[0.0], [0.0], [GRAVITY * robot.mass / len(robot.legs)]]))[:, 0]
        torque[robot.model.leg_joints[i, :3]] -= push
    return torque
