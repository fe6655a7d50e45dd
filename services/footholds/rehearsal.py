"""Requests of a dry run: choices and assessments on a flat map with a stone and a hole."""

import numpy as np

from surefoot.geometry.heightmap import HeightMap
from surefoot.robot.description import Robot
from surefoot.robot.kinematics import foot_positions
from surefoot.schemas.footholds import AssessRequest, BasePose, LegRequest, SelectRequest

from .ground import FootholdGround, build_ground, updated_ground

MAP_CELL = 0.005
"""Edge of a cell of the made-up map that requests are rehearsed on, m."""
HEIGHT = 0.1
"""Height of base_link over the ground in rehearsed requests, m."""
STROKE = (-0.03, 0.0, 0.0)
"""Movement of the feet relative to the body in stance in rehearsed requests, map axes, (3,) m."""


def made_up_map(robot: Robot) -> HeightMap:
    """Return a flat height map with a stone and a hole, under the feet of a robot in neutral stance."""
    half = int(np.abs(foot_positions(robot.model, robot.neutral)[:, :2]).max() / MAP_CELL) + 12
    z = np.zeros((2 * half + 1, 2 * half + 1), dtype=np.float32)
    z[half, half], z[half + 3, half + 3] = 0.02, np.nan
    return HeightMap(z=z, cell=MAP_CELL, origin=(-half * MAP_CELL, -half * MAP_CELL))


def made_up_ground(robot: Robot, smooth: bool) -> FootholdGround:
    """Return a made-up map prepared for the choice of footholds, with a corner changed after that.

    `smooth`: with the median filter.
    """
    heights = made_up_map(robot)
    changed = heights.z.copy()
    changed[:2, :2] = 0.01
    ground = build_ground(heights, robot.foot_radius, smooth)
    return updated_ground(ground, heights, heights.with_z(changed))


def made_up_requests(robot: Robot) -> tuple[list[SelectRequest], list[AssessRequest]]:
    """Return requests for footholds and for assessments that together run every branch of the service."""
    feet = foot_positions(robot.model, robot.neutral)
    places = [(float(foot[0]), float(foot[1]), robot.foot_radius) for foot in feet]
    base = BasePose(position=(0.0, 0.0, HEIGHT), quat_wxyz=(1.0, 0.0, 0.0, 0.0))
    legs = tuple(
        LegRequest(leg=leg, nominal=place, stroke=STROKE) for leg, place in zip(robot.leg_names, places, strict=True)
    )
    centre = places[0][:2]
    return (
        [SelectRequest(base=base, legs=legs, mode=mode) for mode in ("robust", "paper")],
        [AssessRequest(leg=robot.leg_names[0], base=base, centre=centre, stroke=STROKE), AssessRequest(stroke=STROKE)],
    )
