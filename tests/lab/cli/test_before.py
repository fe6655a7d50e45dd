"""A world that cannot be built, or a gait out of its limits, is refused before anything starts, with the limits."""

import os
import shutil
import socket
from pathlib import Path

import pytest

from surefoot.errors import ConfigError
from surefoot.lab.cli.before import check_world
from surefoot.robot.profiles import CameraFile, DepthCameraFile, ImuFile, profile_names
from surefoot.schemas.sim import World

STARTS = ["up ragno", "up ragno -d", "run stand", "chaos stand --zenoh"]
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


@pytest.mark.parametrize("command", STARTS)
@pytest.mark.parametrize("listens", [True, False])
def test_a_taken_port_is_refused_before_any_work(complaint, listen, monkeypatch, command, listens):
    for work in ("before.check_system", "warming.warm_if_cold"):
        monkeypatch.setattr(f"surefoot.lab.cli.{work}", lambda *_: pytest.fail("works for a system that cannot start"))
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", int(listen.rpartition(":")[2])))
        if listens:
            taken.listen()
        words = complaint(*command.split(), "--listen", listen, code=1)
    owner, other = (
        f"{listen} is taken by process {os.getpid()} (",
        f"cannot listen on {listen}: another router holds it",
    )
    assert words.startswith(f"surefoot: {owner if listens else other}")
    assert "another" in words
    assert "with --listen" in words


@pytest.mark.parametrize("command", STARTS)
def test_a_port_that_another_address_listens_on_is_no_obstacle(in_process, listen, monkeypatch, command):
    monkeypatch.setattr("surefoot.lab.cli.before.check_system", lambda *_: pytest.fail("the checks begin"))
    port = int(listen.rpartition(":")[2])
    with socket.create_server(("127.0.0.2", port)), pytest.raises(pytest.fail.Exception, match="the checks begin"):
        in_process(*command.split(), "--listen", listen)
    for _ in range(2):  # the probe leaves nothing behind
        with pytest.raises(pytest.fail.Exception, match="the checks begin"):
            in_process(*command.split(), "--listen", listen)
