"""Images of the floor: geometry against a projection of its own, blur as a mean of still images, faults, refusals."""

import math
import os
from base64 import b64decode
from io import BytesIO

import numpy as np
import pytest
from PIL import Image

from surefoot.geometry.rotations import matrix_from_rpy
from surefoot.robot.profiles import CameraFile, read_profile
from surefoot.robot.reader import load_robot
from surefoot.services.simulator.ground.terrain import TerrainError, make_terrain
from surefoot.services.simulator.messages import image_message, lacking, sight_messages
from surefoot.services.simulator.physics.faults import Fault, FaultBank, FaultError
from surefoot.services.simulator.sensors import floors, images
from surefoot.services.simulator.sensors.landmarks import CAMERA_AXES, CameraPose
from surefoot.services.simulator.sensors.sight import Floor
from surefoot.services.simulator.world import PhysicsWorld, WorldConfig

OPTICS = images.Optics(160, 120, 190.0, 20, 0.0, 0.0, 0.01, 0.0, 0.0, 0.0, 0.0)


def texture(grey: np.ndarray, corner=(0.0, 0.0), edge=0.002) -> floors.Texture:
    return floors._sizes(grey.astype(np.float32), (*corner, edge, 1.0))


def pose(x=0.0, y=0.0, height=0.45, pitch=0.8, yaw=0.0) -> CameraPose:
    rot = matrix_from_rpy(0.0, pitch, yaw) @ CAMERA_AXES
    return CameraPose(np.array([x, y, height]), rot, np.zeros(3))


def spots(places) -> floors.Texture:
    """A dark floor with bright discs of 2 cm."""
    x, y = np.meshgrid(0.002 * (np.arange(1024) + 0.5), 0.002 * (np.arange(512) + 0.5) - 0.5)
    return texture(sum((np.hypot(x - a, y - b) < 0.01).astype(float) for a, b in places), (0.0, -0.5))


def take(optics: images.Optics, floor: floors.Texture, path: list[CameraPose]) -> np.ndarray:
    """Light of the image that ends with the path, not rounded."""
    sensor = images.ImageSensor(optics, floor, 0)
    sensor.path.extend(path)
    sensor.take(0, len(path) - 1)
    return sensor._out.copy()


def test_a_spot_of_the_floor_is_where_the_pinhole_projection_puts_it():
    for at in ((0.4, 0.0), (0.55, 0.12), (0.7, -0.2)):
        for camera in (pose(), pose(x=0.03, y=-0.05, height=0.5, pitch=0.7, yaw=0.1)):
            seen = take(OPTICS, spots([at]), [camera, camera])
            local = camera.rot.T @ (np.array([*at, 0.0]) - camera.position)
            u, v = 190.0 * local[:2] / local[2] + np.array([80.0, 60.0])
            rows, cols = np.mgrid[:120, :160] + 0.5
            assert (seen * cols).sum() / seen.sum() == pytest.approx(u, abs=0.4)
            assert (seen * rows).sum() / seen.sum() == pytest.approx(v, abs=0.4)


def test_the_exposure_is_the_mean_of_still_images_along_the_path():
    grey = floors._noise((512, 1024), (6.0, 6.0), np.random.default_rng(0))
    floor = texture(np.clip(0.5 + 0.2 * grey, 0.0, 1.0), (0.0, -0.5))
    path = [pose(x=0.1 + 0.004 * k, yaw=0.01 * k) for k in range(6)]
    moving = take(images.Optics(*{**vars(OPTICS), "exposure": 0.04}.values()), floor, path)
    times = 0.03 + 0.04 * ((np.arange(images.SUBFRAMES) + 0.5) / images.SUBFRAMES - 0.5)
    stills = [take(OPTICS, floor, [pose(x=0.1 + 0.4 * t, yaw=t)] * 2) for t in times]
    assert np.abs(moving - np.mean(stills, axis=0)).mean() < 1.5
    assert np.abs(stills[0] - stills[-1]).mean() > 10.0
    assert np.abs(np.diff(moving, axis=1)).mean() < 0.7 * np.abs(np.diff(stills[3], axis=1)).mean()


def test_a_rolling_shutter_takes_the_last_row_later_than_the_first():
    rng = np.random.default_rng(1)
    floor = texture(rng.random((512, 1024)), (0.0, -0.5))
    path = [pose(yaw=0.05 * k) for k in range(6)]
    rolled = take(images.Optics(*{**vars(OPTICS), "readout": 0.04}.values()), floor, path)
    early, late = (take(OPTICS, floor, [pose(yaw=5.0 * t)] * 2) for t in (0.0102, 0.0498))
    assert np.abs(rolled[0] - early[0]).mean() < 4.0 < 15.0 < np.abs(rolled[0] - late[0]).mean()
    assert np.abs(rolled[-1] - late[-1]).mean() < 4.0 < 15.0 < np.abs(rolled[-1] - early[-1]).mean()


def test_walls_hide_the_floor_behind_them_and_a_picture_has_its_scale(tmp_path):
    terrain = make_terrain("room")
    painted = floors.paint(terrain, "tiles", 1.0, 1.0, 0)
    rows, cols = painted.levels[0, 1:]
    grey = painted.texels[: rows * cols].reshape(rows, cols)
    outside = grey[:, 0]
    assert np.unique(outside).size < 12
    assert grey[rows // 2, :].std() > 5.0
    picture = np.zeros((100, 200), np.uint8)
    picture[:, 100:] = 255
    Image.fromarray(picture).save(tmp_path / "half.png")
    floor = floors.paint(make_terrain("flat"), str(tmp_path / "half.png"), 0.8, 1.0, 0)
    rows, cols = floor.levels[0, 1:]
    line = floor.texels[: rows * cols].reshape(rows, cols)[rows // 2] > 100
    edges = np.flatnonzero(np.diff(line.astype(int))) * floors.TEXEL
    assert np.diff(edges) == pytest.approx(np.full(len(edges) - 1, 0.8), abs=0.01)  # mirrored: half, whole, whole


def test_impossible_floors_are_refused_by_name():
    with pytest.raises(TerrainError, match=r"texture.*none of random, carpet"):
        floors.paint(make_terrain("flat"), "lawn", 1.0, 1.0, 0)
    with pytest.raises(TerrainError, match="level floor"):
        floors.paint(make_terrain("rough"), "tiles", 1.0, 1.0, 0)


def faulty(kind: str, value=0.0) -> FaultBank:
    bank = FaultBank((), ())
    bank.add(Fault(kind, 0, 10.0, value=value))
    return bank


def taken(seq: int) -> images.TakenImage:
    pixels = np.random.default_rng(seq).integers(40, 200, (16, 16)).astype(np.uint8)
    return images.TakenImage(seq, seq, pixels, np.zeros(3), np.eye(3), 100.0, 0.03, 0.01, "gray8")


@pytest.mark.parametrize("width", [2.0, 30.0])
def test_a_picture_that_is_a_pipe_or_becomes_too_large_is_refused(tmp_path, width):
    path = tmp_path / "picture.png"
    if width == 2.0:
        os.mkfifo(path)
    else:
        Image.new("L", (100, 100)).save(path)
    with pytest.raises(TerrainError, match="texture"):
        floors.paint(make_terrain("flat"), str(path), width, 1.0, 0)
    with pytest.raises(TerrainError, match="texture"):
        floors.paint(make_terrain("flat"), "a\0b", width, 1.0, 0)


def test_faults_of_the_camera_do_what_their_names_state():
    floor = texture(np.zeros((64, 64)))

    def twice(kind, value=0.0):
        sensor = images.ImageSensor(OPTICS, floor, 0)
        assert sensor.spoil(FaultBank((), ()), 0, taken(0)) is not None
        return sensor, sensor.spoil(faulty(kind, value), 1, taken(1))

    assert twice("camera_dark")[1].pixels.max() < 4
    assert twice("camera_bright")[1].pixels.min() >= 250
    assert np.array_equal(twice("camera_flip")[1].pixels, taken(1).pixels[::-1, ::-1])
    assert twice("camera_cover")[1].pixels[:, :8].max() < 16
    frozen, repeated = twice("camera_freeze")[1], twice("camera_repeat")[1]
    assert np.array_equal(frozen.pixels, taken(0).pixels)
    assert (frozen.stamp_ns, repeated.stamp_ns) == (1, 0)
    assert twice("camera_zoom", 0.1)[1].focal == pytest.approx(110.0)
    sensor, late = twice("camera_late", 100.0)
    assert late is None
    assert [(tick, image.seq) for tick, image in sensor.waiting] == [(100, 1)]


def test_the_message_holds_the_pixels_and_a_jpeg_is_nearly_the_same():
    grey = taken(3)._replace(pixels=np.tile(np.arange(0, 128, 2, dtype=np.uint8), (64, 1)))
    message = image_message(grey)
    assert np.array_equal(np.frombuffer(b64decode(message.pixels), np.uint8).reshape(64, 64), grey.pixels)
    with Image.open(BytesIO(b64decode(image_message(grey._replace(format="jpeg")).pixels))) as file:
        assert np.abs(np.asarray(file).astype(int) - grey.pixels).max() < 12


def test_a_world_with_a_texture_has_images_and_no_landmarks_and_a_restore_repeats_them():
    made = PhysicsWorld(
        load_robot("nao"), make_terrain("flat"), 2, WorldConfig(floor=Floor(texture="random"), camera="nao_eyes")
    )
    lacks = {topic.key for topic in lacking(made.sight, None)}
    assert lacks == {"hw/landmarks", "hw/depth", "terrain/landmarks", "terrain/map"}
    for kind, target in (("sensor_off", "landmarks"), ("landmarks_drop", "")):
        with pytest.raises(FaultError, match="landmarks"):  # none are seen: the fault would break nothing
            made.add_fault(Fault(kind, 0, 1.0, target))
    made.add_fault(Fault("camera_zoom", 1000, 1.0, value=0.1))
    for _ in range(15):
        made.step_tick()
    saved, runs = made.checkpoint(), []
    for _ in range(2):
        made.restore(saved)
        found = []
        for _ in range(30):
            made.step_tick()
            found += [due for due in sight_messages(made.sight, made.stamp_ns) if due.topic.key == "hw/image"]
        runs.append([(due.stamp_ns, due.message.pixels) for due in found])
    assert len(runs[0]) == 2
    assert runs[0] == runs[1]
    exposure = read_profile(CameraFile, "nao_eyes", "camera")[0]
    before = 0.5e6 * (exposure.exposure_ms + exposure.readout_ms)
    assert runs[0][0][0] == pytest.approx(200_000_000 - before, abs=1.0)
    assert math.isclose(found[0].message.focal, 160.0 / math.tan(math.radians(23.2)))
