"""Grounds and poses the foothold tests share."""

from functools import lru_cache

import numpy as np

from surefoot.geometry.heightmap import HeightMap
from surefoot.robot.description import Robot
from surefoot.robot.kinematics import foot_positions
from surefoot.robot.reader import load_robot
from surefoot.services.footholds.ground import FootholdGround, build_ground
from surefoot.services.footholds.select import Landing, TrunkPose

CELL = 0.005
STROKE = (-0.05, 0.0, 0.0)


@lru_cache
def ragno() -> Robot:
    """The robot of the tests."""
    return load_robot("ragno")


def ground_of(
    z: np.ndarray, origin: tuple[float, float] = (-0.5, -0.4), version: int = 1, smooth: bool = False
) -> FootholdGround:
    """Prepared ground from heights (ny, nx)."""
    return build_ground(heights_of(z, origin, version), ragno().foot_radius, smooth)


def heights_of(z: np.ndarray, origin: tuple[float, float] = (-0.5, -0.4), version: int = 1) -> HeightMap:
    """The map of heights (ny, nx)."""
    return HeightMap(z=z.astype(np.float32), cell=CELL, origin=origin, version=version)


def flat(ny: int = 160, nx: int = 200) -> np.ndarray:
    """Heights of flat ground."""
    return np.zeros((ny, nx))


def neutral(leg: int) -> np.ndarray:
    """Neutral foot centre in base_link, (3,) m."""
    return foot_positions(ragno().model, ragno().neutral)[leg]


def standing(x: float = 0.0, y: float = 0.0, ground: float = 0.0) -> TrunkPose:
    """The base over flat ground of a height, legs neutral."""
    return TrunkPose((x, y, ground + ragno().foot_radius - float(neutral(0)[2])))


def landing(leg: int, x: float = 0.0, y: float = 0.0, stroke: tuple[float, float, float] = STROKE) -> Landing:
    """A landing at the leg's neutral foothold with the base at (x, y)."""
    at = neutral(leg)
    return Landing(leg, (x + float(at[0]), y + float(at[1]), 0.0), stroke)


def rough(seed: int, amplitude: float = 0.01) -> np.ndarray:
    """Hills and steps under the robot."""
    rng = np.random.default_rng(seed)
    x, y = np.meshgrid(CELL * np.arange(200), CELL * np.arange(160))
    z = amplitude * np.sin(x / rng.uniform(0.02, 0.1) + rng.uniform(0, 6)) * np.cos(y / rng.uniform(0.02, 0.1))
    return z + amplitude * (rng.random((20, 25)).repeat(8, 0).repeat(8, 1) > 0.6)
