"""Maps of images: by known poses, by poses that drift, and of a photograph."""

import math

import numpy as np
import pytest
from PIL import Image

from surefoot.bus.codec import encode
from surefoot.bus.interface import Raw
from surefoot.errors import SurefootError
from surefoot.lab.maps import images
from surefoot.lab.maps.images import map_of, map_of_photograph, map_of_source
from surefoot.lab.maps.turned import FloorLook
from surefoot.record.recording import RecordingWriter
from surefoot.robot.reader import load_robot
from surefoot.schemas.hw import JointState
from surefoot.schemas.state import Odometry
from surefoot.schemas.topics import HW_IMAGE, HW_JOINTS, STATE_ODOMETRY
from surefoot.services.vision.eye import Eye
from surefoot.services.vision.features import Extractor
from surefoot.services.vision.view import Patch
from tests.services.vision.shots import extractor, shot
from tests.surefoot.expect import expect_error

N = 160


def looks_of(poses, seed=0, noise=0.003, drift=0.0):
    """Looks of made-up features along true poses; those that are stated drift to the side by the way."""
    rng = np.random.default_rng(seed)
    places, looks = rng.uniform((-0.2, -0.8), (2.2, 0.8), (N, 2)), rng.integers(0, 256, (N, 32)).astype(np.uint8)
    made, way = [], 0.0
    for k, (x, y, yaw) in enumerate(poses):
        way += math.dist((x, y), poses[max(0, k - 1)][:2])
        d = places - (x, y)
        c, s = math.cos(yaw), math.sin(yaw)
        local = np.stack((c * d[:, 0] + s * d[:, 1], -s * d[:, 0] + c * d[:, 1]), axis=1)
        near = np.flatnonzero((np.abs(local[:, 1]) < 0.5) & (local[:, 0] > 0.3) & (local[:, 0] < 1.1))
        stated = (x, y + drift * way, yaw + drift * way)
        made.append(FloorLook(stated, local[near] + noise * rng.standard_normal((len(near), 2)), looks[near]))
    return made, places, looks


def nearest(world, places, looks):
    """Distance of each map feature from the true place of its look."""
    which = [int(np.flatnonzero((looks == row).all(axis=1))[0]) for row in world.descriptors]
    return np.hypot(*(world.positions - places[which]).T)


OUT_AND_BACK = [(0.1 * k, 0.0, 0.0) for k in range(12)] + [(1.1, 0.0, 0.4 * k) for k in range(1, 8)] + [
    (1.1 - 0.1 * k, 0.0, math.pi) for k in range(8)
]  # fmt: skip


def test_known_poses_place_features_to_the_millimetre():
    made, places, looks = looks_of(OUT_AND_BACK)
    world = map_of(made, Eye(extractor(), None), "c", "s", exact=True)
    assert len(world) > 60
    assert nearest(world, places, looks).max() < 0.006
    assert world.seen.min() >= 3


def test_poses_that_drift_are_improved_with_the_places():
    made, places, looks = looks_of(OUT_AND_BACK, drift=0.02)
    eye = Eye(extractor(), None)
    plain = nearest(map_of(made, eye, "c", "s", exact=True), places, looks)
    better = nearest(map_of(made, eye, "c", "s", exact=False), places, looks)
    assert len(better) > 50
    assert better.mean() < 0.6 * plain.mean()


def test_a_feature_that_is_seen_once_is_no_landmark():
    made, *_ = looks_of([(0.0, 0.0, 0.0), (0.05, 0.0, 0.0)])
    with pytest.raises(SurefootError, match="seen 3 times"):
        map_of(made, Eye(extractor(), None), "c", "s", exact=True)


@pytest.mark.parametrize("exact", [True, False])
@pytest.mark.parametrize("images", [0, 3])
def test_images_without_features_show_no_landmark(images, exact):
    blank = FloorLook((0.0, 0.0, 0.0), np.zeros((0, 2)), np.zeros((0, 32), np.uint8))
    with expect_error(SurefootError, "no_landmarks", None):
        map_of([blank] * images, Eye(extractor(), None), "c", "s", exact=exact)


@pytest.mark.parametrize("name", ["nao", "bioloid"])
def test_a_recording_is_read_with_the_legs_of_its_own_robot(tmp_path, monkeypatch, name):
    robot, path, used = load_robot(name), tmp_path / "walk.mcap", []
    odometry = Odometry(
        position=(0, 0, 0.3), quat_wxyz=(1, 0, 0, 0), yaw=0.0, velocity=(0, 0, 0), covariance=(0.0,) * 16,
        initialised=True,
    ).stamped(0, 0, 1, 0, "estimator")  # fmt: skip
    joints = JointState(position=tuple(robot.neutral.tolist())).stamped(0, 0, 1, 0, "simulator")
    writer = RecordingWriter(path, {"robot": name})
    for topic, message in ((STATE_ODOMETRY, odometry), (HW_JOINTS, joints), (HW_IMAGE, shot((0.0, 0.0, 0.0)))):
        writer.write(topic, message, Raw(*encode(message), ""))
    writer.close({})
    monkeypatch.setattr(images, "looks_of", lambda messages, eye, source, robot: used.append(robot.name) or [])
    assert images.read_looks(path, Eye(extractor(), None), None)[1] == STATE_ODOMETRY.key
    assert used == [name]


def test_a_photograph_has_its_features_where_its_scale_puts_them(tmp_path):
    grey = np.full((400, 800), 90, np.uint8)
    spots = [(100, 120), (300, 260), (520, 150), (700, 330)]
    rng = np.random.default_rng(0)
    for u, v in spots:
        grey[v - 12 : v + 12, u - 12 : u + 12] = rng.integers(0, 255, (24, 24))
    Image.fromarray(grey).save(tmp_path / "floor.png")
    world = map_of_photograph(tmp_path / "floor.png", 2.4, Extractor("orb", 500), Patch(pixel=0.003))
    for u, v in spots:
        at = 0.003 * np.array([u, 400 - v])
        assert np.hypot(*(world.positions - at).T).min() < 0.04
    assert {tuple(p) for p in np.round(world.positions, 9)}
    assert all(min(math.dist(p, (0.003 * u, 0.003 * (400 - v))) for u, v in spots) < 0.08 for p in world.positions)
    for bad in ("absent.png",):
        with pytest.raises(SurefootError, match="no picture"):
            map_of_photograph(tmp_path / bad, 1.0, Extractor("orb", 500), Patch())
    with pytest.raises(SurefootError, match="orb, sift"):
        map_of_source(tmp_path / "floor.png", "surf", None, 1.0, 1)
