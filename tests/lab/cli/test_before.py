"""A world that cannot be built, or a gait out of its limits, is refused before anything starts, with the limits."""

import shutil
from pathlib import Path

import pytest

from surefoot.errors import ConfigError
from surefoot.lab.cli.before import check_world
from surefoot.robot.profiles import CameraFile, DepthCameraFile, ImuFile, profile_names
from surefoot.schemas.sim import World

ROOT = Path(__file__).parents[3]


@pytest.mark.parametrize(
    ("field", "kind"), [("camera", CameraFile), ("depth_camera", DepthCameraFile), ("imu_profile", ImuFile)]
)
def test_an_unknown_sensor_is_refused_with_the_known_ones(field, kind):
    for name in profile_names(kind):
        check_world(World.model_validate({field: name}), 0)
    with pytest.raises(ConfigError) as refusal:
        check_world(World.model_validate({field: "nope"}), 0)
    assert refusal.value.field == f"world.{field}"
    assert "got 'nope', known are " in str(refusal.value)
    assert all(name in str(refusal.value) for name in profile_names(kind))


def test_the_exact_inertial_unit_and_the_robots_own_sensors_are_allowed():
    check_world(World(imu_profile="ideal"), 0)
    check_world(World(), 0)


def test_an_unknown_terrain_is_refused():
    with pytest.raises(ConfigError, match="nope") as refusal:
        check_world(World(terrain="nope"), 0)
    assert refusal.value.field == "terrain"


def test_a_scenario_with_an_unknown_depth_camera_ends_before_anything_starts(complaint, tmp_path):
    file = tmp_path / "looks.toml"
    own = (ROOT / "scenarios/ragno-own-map.toml").read_text()
    file.write_text(own.replace('depth_camera = "mast"', 'depth_camera = "nope"'))
    assert "world.depth_camera: got 'nope', known are mast" in complaint("run", str(file))


@pytest.mark.parametrize("command", ["robot check {}", "run crawl-flat --robot {}", "up lupo -d --robot {}"])
@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("stride_m = 0.200", "stride_m = 9", "gait.stride_m: got 9.0; input should be less than or equal to 5"),
        ("stride_m = 0.200", "strid_m = 0.2", "gait.stride_m: is missing; 'strid_m' is not known here"),
        ("overlap = 0.10", "overlap = 0.10\nlean_margn_m = 0.06", "gait.lean_margn_m: is not known here"),
    ],
)
def test_a_gait_that_no_walker_takes_is_refused_before_anything_starts(complaint, tmp_path, command, old, new, words):
    shutil.copytree(ROOT / "surefoot/robots/lupo", folder := tmp_path / "mine")
    content = (folder / "robot.toml").read_text()
    assert f"\n{old}" in content
    (folder / "robot.toml").write_text(content.replace(f"\n{old}", f"\n{new}"))
    assert words in complaint(*command.format(folder).split())
