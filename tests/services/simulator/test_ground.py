"""Grounds that a scenario asks for: by name or file, perturbation by level."""

import numpy as np
import pytest

from surefoot.geometry import heightmap_files
from surefoot.geometry.heightmap import HeightMapError
from surefoot.services.simulator.ground.terrain import TerrainError, make_terrain
from surefoot.services.simulator.physics import perturb as ground
from surefoot.services.simulator.physics.perturb import find_ground, perturbation


def test_kind_and_file(tmp_path: object) -> None:
    made = make_terrain("hills", 3)
    path = heightmap_files.save(made.map, f"{tmp_path}/hills", kind="hills", seed=3)
    assert find_ground("hills", 3, None).map.sha256 == made.map.sha256
    assert find_ground(str(path), 0, None).map.sha256 == made.map.sha256


def test_refusals(tmp_path: object) -> None:
    for name in ("moon", f"{tmp_path}/absent.npz"):
        with pytest.raises(TerrainError):
            find_ground(name, 0, None)
    broken = f"{tmp_path}/broken.npz"
    with open(broken, "wb") as stream:
        stream.write(b"no archive")
    with pytest.raises(HeightMapError):
        find_ground(broken, 0, None)


def test_level_zero_is_the_description() -> None:
    assert perturbation(0.0, 5, 18).kp_scale == 1.0


def test_perturbation_is_seeded_and_within_its_level() -> None:
    draws = [perturbation(1.0, seed, 18) for seed in range(200)]
    np.testing.assert_array_equal(perturbation(1.0, 7, 18).kp_scale, draws[7].kp_scale)
    com = np.array([d.trunk_com_offset for d in draws])
    assert (np.abs(com) <= ground.COM_M).all()
    assert np.abs(np.array([d.kp_scale for d in draws]) - 1.0).max() == pytest.approx(ground.SERVO_GAIN, rel=0.05)
    assert np.abs(np.array([d.friction_scale for d in draws]) - 1.0).max() <= ground.FRICTION
    assert min(perturbation(10.0, seed, 18).friction_scale for seed in range(200)) > 0.0
