"""Stances of a recorded walk as learning samples: slip by the estimator, footholds where the robot placed its feet.

The stroke f of a stance, m, is the movement of its foot relative to the trunk from begin to end of the stance,

    f = R_0 (R_1^T (p - b_1) - R_0^T (p - b_0)),   p: foot; b, R: position and heading of the trunk, odom,

with the index 0 at the begin and 1 at the end.

Footholds are looked up in the recorded map, whose frame is taken as odom; without a map the ground is a plane.
"""

import math
from collections.abc import Callable, Iterable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from surefoot.errors import SurefootError
from surefoot.geometry.heightmap import HeightMap
from surefoot.record.recording import read_recording
from surefoot.robot.description import Robot
from surefoot.schemas.state import Odometry, StanceEnd
from surefoot.schemas.topics import HW_JOINTS, STATE_ODOMETRY, TERRAIN_MAP
from surefoot.services.footholds.ground import FootholdGround, build_ground
from surefoot.services.footholds.learning.samples import StanceSample
from surefoot.services.footholds.outcomes import sample_at

CELL_M, EDGE_M = 0.005, 0.1
"""`CELL_M`: cell size, m, of the plane used in place of a height map; `EDGE_M`: its margin around all footholds, m."""
MOST_CELLS = 4_000_000
"""Largest number of cells of the plane used in place of a height map; a recorded walk that needs more is refused."""


def samples_of(
    path: Path, robot: Robot, smooth: bool = True, progress: Callable[[float], None] | None = None
) -> list[StanceSample]:
    """Return a learning sample for each stance in the last epoch of a recording (after the last reset).

    Stances in which an encoder or the foot's contact switch failed (`healthy` is False) are left out.

    Args:
        path: MCAP file with `state/odometry`; its file name becomes the name of the trial.
        robot: description of the robot that walked.
        smooth: True: the height map is filtered by a 3 x 3 median; False: it is not.
        progress: called with the share of the recording that has been read, 0 to 1.

    Raises:
        SurefootError: the file cannot be read, or holds no healthy stance.
    """
    ground, poses, epoch = None, list[Odometry](), -1
    for item in read_recording(path, (TERRAIN_MAP.key, STATE_ODOMETRY.key), progress):
        message: Any = item.message()
        if message.epoch > epoch:
            ground, poses, epoch = None, [], message.epoch
        if item.key == TERRAIN_MAP.key:
            ground = HeightMap.from_wire(message.model_dump(), message.data)
        elif message.initialised:
            poses.append(message)
    ended = [(k, stance) for k, each in enumerate(poses) for stance in each.stances if stance.healthy]
    if not ended:
        raise SurefootError("missing", f"{path} holds no stance of a started estimator", STATE_ODOMETRY.key)
    heights = _plane(stance for _, stance in ended) if ground is None else ground
    built = build_ground(heights, robot.foot_radius, smooth)
    stamps = np.array([each.stamp_ns for each in poses])
    found: list[StanceSample] = []
    for number, (k, stance) in enumerate(ended):
        begin = int(np.searchsorted(stamps, stamps[k] - stance.samples * HW_JOINTS.period_ns))
        found.append(_sample(stance, poses[begin], poses[k], built, (path.stem, stance.foot, number)))
    return [replace(one, robot=robot.name, robot_hash=robot.hash, source="recorded walk") for one in found]


def _sample(
    stance: StanceEnd, begin: Odometry, end: Odometry, ground: FootholdGround, name: tuple[str, int, int]
) -> StanceSample:
    x, y, _ = stance.begin
    turn = begin.yaw - end.yaw
    dx, dy, dz = (p - b for p, b in zip(stance.begin, end.position, strict=True))
    ahead, aside = math.cos(turn) * dx - math.sin(turn) * dy, math.sin(turn) * dx + math.cos(turn) * dy
    before = [p - b for p, b in zip(stance.begin, begin.position, strict=True)]
    stroke = ahead - before[0], aside - before[1], dz - before[2]
    return sample_at(ground, (x, y), (x, y), stroke, stance.slip, name)


def _plane(stances: Iterable[StanceEnd]) -> HeightMap:
    """Return a height map of zeros around all footholds (raises SurefootError: it would exceed `MOST_CELLS`)."""
    places = np.array([stance.begin[:2] for stance in stances])
    low = places.min(axis=0) - EDGE_M
    cols, rows = (math.ceil(float(way) / CELL_M) for way in places.max(axis=0) + EDGE_M - low)
    if rows * cols > MOST_CELLS:
        text = f"the walk covers {rows * CELL_M:.0f} x {cols * CELL_M:.0f} m, at most {MOST_CELLS} cells are laid"
        raise SurefootError("too_large", f"{text}: record the map, or a shorter walk", TERRAIN_MAP.key)
    z = np.zeros((rows, cols), dtype=np.float32)
    return HeightMap(z=z, cell=CELL_M, origin=(float(low[0]), float(low[1])))
