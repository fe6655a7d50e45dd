"""Depth camera: what its pixels show of exact ground, its noise, and that a restore repeats it."""

import base64
import math

import numpy as np
import pytest

from surefoot.geometry.rotations import matrix_from_quat
from surefoot.robot.description import RobotError
from surefoot.robot.reader import load_robot
from surefoot.schemas.topics import HW_DEPTH, TERRAIN_MAP
from surefoot.services.simulator.ground.terrain import make_terrain
from surefoot.services.simulator.messages import lacking, sight_messages
from surefoot.services.simulator.sensors.depth import read_depth_camera
from surefoot.services.simulator.world import PhysicsWorld, WorldConfig, WorldError

RAGNO = load_robot("ragno")
CAMERA = read_depth_camera("mast")


def world(terrain="rough", seed=1, **config):
    return PhysicsWorld(RAGNO, make_terrain(terrain, seed=seed), seed, WorldConfig(depth_camera="mast", **config))


def message(made):
    (due,) = (one for one in sight_messages(made.sight, made.stamp_ns) if one.topic is HW_DEPTH)
    return due.message


def points(made, image):
    """Places that the pixels show, (n, 3) m, by the pose of the trunk in the simulation; and the depths."""
    depths = np.frombuffer(base64.b64decode(image.depths), "<f4").reshape(image.height, image.width).astype(float)
    v, u = np.mgrid[0 : image.height, 0 : image.width] + 0.5
    local = np.stack(((u - image.center[0]) / image.focal, (v - image.center[1]) / image.focal, np.ones_like(u)), -1)
    local = local * depths[..., None] @ matrix_from_quat(np.array(image.quat_wxyz)).T + np.array(image.position)
    truth = made.truth()
    return local @ matrix_from_quat(truth.quat_wxyz).T + truth.position, depths


@pytest.mark.parametrize("terrain", ["flat", "rough", "steps"])
def test_pixels_lie_on_the_ground_up_to_the_stated_noise(terrain):
    made = world(terrain)
    image = message(made)
    place, depths = points(made, image)
    known = np.isfinite(depths)
    assert 0.5 < known.mean() < 0.97  # dropouts, and what lies beyond the reach
    ground = made.terrain.map.height(place[..., 0], place[..., 1])
    sigma = image.sigma + image.sigma_square * depths**2
    off = (place[..., 2] - ground) / sigma
    inside = known & np.isfinite(ground)
    assert inside.sum() > 1000
    assert abs(np.median(off[inside])) < 0.3
    assert np.mean(np.abs(off[inside]) < 3.0) > 0.9
    if terrain == "flat":
        assert np.std(off[inside]) < 1.0


def test_the_robot_itself_is_not_in_the_image():
    made = world("flat")
    place, depths = points(made, message(made))
    assert place[np.isfinite(depths)][:, 2].max() < 0.03  # femurs and knees are higher


def test_images_come_at_their_rate_and_a_restore_repeats_them():
    made = world("flat")
    every = CAMERA.file.period_ms // 10
    taken = []
    for tick in range(1, 2 * every + 1):
        if tick == every + 1:
            saved = made.checkpoint()
        made.step_tick()
        if made.sight.depths is not None:
            taken.append((tick, made.sight.depths.seq, made.sight.depths.depths.tobytes()))
    assert [one[:2] for one in taken] == [(every, 1), (2 * every, 2)]
    made.restore(saved)
    for _ in range(every):
        made.step_tick()
    assert made.sight.depths.depths.tobytes() == taken[1][2]


def test_a_robot_without_the_camera_samples_as_before_and_names_what_it_lacks():
    plain = PhysicsWorld(RAGNO, make_terrain("rough", seed=1), 1)
    seeing = world()
    for _ in range(30):
        plain.step_tick()
        seeing.step_tick()
    assert plain.truth().position.tobytes() == seeing.truth().position.tobytes()
    assert plain.sight is None
    assert HW_DEPTH in lacking(plain.sight, None)
    assert TERRAIN_MAP in lacking(plain.sight, None)
    assert HW_DEPTH not in lacking(seeing.sight, None)


def test_an_unknown_camera_is_refused_by_name():
    with pytest.raises(WorldError, match="known are mast"):
        PhysicsWorld(RAGNO, make_terrain("flat"), 1, WorldConfig(depth_camera="eyes"))
    with pytest.raises(RobotError):
        read_depth_camera("eyes")


def test_the_middle_ray_looks_along_the_pitch():
    middle = CAMERA.rays.reshape(CAMERA.file.height_px, CAMERA.file.width_px, 3)[
        CAMERA.file.height_px // 2, CAMERA.file.width_px // 2
    ]
    assert math.degrees(math.asin(-middle[2])) == pytest.approx(CAMERA.file.pitch_deg, abs=1.5)
