"""Ground by its name in a scenario, and random differences of the simulated robot from its description."""

from pathlib import Path

import numpy as np

from surefoot.geometry.heightmap_exchange import SUFFIXES, load_any

from ..ground.terrain import (
    KINDS,
    Terrain,
    TerrainError,
    make_terrain,
    random_stream,
    terrain_from_map,
)
from .model import Perturbation

COM_M = (0.004, 0.003, 0.005)  # m, offset of the trunk's CoM at level 1, uniform within these
TRUNK_MASS = 0.08  # part of the trunk's mass at level 1, uniform within
SERVO_GAIN = 0.15  # part of each servo's gain at level 1, uniform within
FRICTION = 0.4  # part of the friction coefficient at level 1, uniform within
ZERO_RAD = np.radians(0.3)  # rad, standard deviation of each servo's zero at level 1, of bipeds only
FLOOR_RAD = np.radians(0.7)  # rad, roll and pitch of the floor under a biped at level 1, uniform within
MAX_FRICTION_LEVEL = 2.0  # beyond it a coefficient could become negative


def find_ground(name: str, seed: int, amplitude: float | None) -> Terrain:
    """Return the terrain of a generated kind or of a map file, by its name in a scenario.

    Args:
        name: kind of a generated terrain, or path of a height map with a known suffix.
        seed: seed of a generated terrain.
        amplitude: amplitude of a generated terrain's relief, m; None = that of the kind.

    Raises:
        TerrainError: the name is neither a kind nor a readable file.
        HeightMapError: the file is no height map.
    """
    if name in KINDS:
        return make_terrain(name, seed, amplitude)
    if not name.endswith(SUFFIXES):
        known, files = ", ".join(KINDS), ", ".join(SUFFIXES)
        raise TerrainError("terrain", f"got {name!r}, which is neither a kind ({known}) nor a file of {files}")
    try:
        return terrain_from_map(load_any(Path(name)))
    except OSError as error:
        raise TerrainError("terrain", f"{name!r} cannot be read: {error.strerror}") from None


def perturbation(level: float, seed: int, nj: int, kind: str = "hexapod") -> Perturbation:
    """Return differences of the simulated robot from its description: uniform draws, scaled by the level.

    Args:
        level: factor on all differences, >= 0; 0 = as described.
        seed: seed of the draws.
        nj: number of joints.
        kind: kind of the robot; a biped also gets servo zero errors and a floor that is not level.
    """
    if level == 0.0:
        return Perturbation()
    rng = random_stream(seed, "perturbation")
    x, y, z = level * np.array(COM_M) * rng.uniform(-1.0, 1.0, 3)
    tilt, zero = (0.0, 0.0), 0.0
    if kind == "biped":
        roll, pitch = level * FLOOR_RAD * random_stream(seed, "perturbation/floor").uniform(-1.0, 1.0, 2)
        tilt, zero = (float(roll), float(pitch)), float(level * ZERO_RAD)
    return Perturbation(
        zero_sigma=zero,
        floor_tilt=tilt,
        trunk_mass_scale=1.0 + TRUNK_MASS * level * rng.uniform(-1.0, 1.0),
        trunk_com_offset=(float(x), float(y), float(z)),
        kp_scale=1.0 + SERVO_GAIN * level * rng.uniform(-1.0, 1.0, nj),
        friction_scale=1.0 + FRICTION * min(level, MAX_FRICTION_LEVEL) * rng.uniform(-1.0, 1.0),
    )
