"""Landmarks seen by a camera: projection and flow against finite differences, blur against the motion, calibration."""

import math

import numpy as np
import pytest

from surefoot.robot.description import RobotError
from surefoot.robot.reader import load_robot
from surefoot.services.simulator.sensors import landmarks as lm

NAO = load_robot("nao")
CAMERA = lm.read_camera("nao_bottom")
LEVEL = np.array([1.0, 0.0, 0.0, 0.0])
HEIGHT = 0.3128


def pose(x=0.0, y=0.0, z=HEIGHT, yaw=0.0, pitch=0.0):
    quat = np.array([math.cos(yaw / 2), 0.0, 0.0, math.sin(yaw / 2)])
    if pitch:
        quat = np.array([math.cos(pitch / 2), 0.0, math.sin(pitch / 2), 0.0])
    return lm.camera_pose(NAO, CAMERA, np.array([x, y, z]), quat, NAO.neutral)


def field(density=40.0):
    return lm.scatter(3, (-2.0, -2.0), (3.0, 2.0), density)


def test_camera_looks_at_the_floor_in_front_of_the_feet():
    index, local = lm.seen(CAMERA, pose(), field().position)
    points = field().position[index]
    assert 5 < len(index) < 60
    assert points[:, 0].min() > 0.1
    assert abs(points[:, 1].mean()) < 0.1
    assert np.all(local[:, 2] > 0.2)


def test_flow_is_the_derivative_of_the_image():
    rng, dt = np.random.default_rng(1), 1e-5
    spot = np.array([[0.45, 0.05], [0.5, -0.1], [0.35, 0.0]])
    for _ in range(20):
        a = pose()
        turn, move = rng.normal(size=3) * 0.5, rng.normal(size=3) * 0.2
        skew = np.array([[0, -turn[2], turn[1]], [turn[2], 0, -turn[0]], [-turn[1], turn[0], 0]])
        b = lm.CameraPose(a.position + a.rot @ move * dt, a.rot @ (np.eye(3) + skew * dt), a.base)
        (_, before), (_, after) = lm.seen(CAMERA, a, spot), lm.seen(CAMERA, b, spot)
        image = CAMERA.focal * (after[:, :2] / after[:, 2:] - before[:, :2] / before[:, 2:])
        expected = np.hypot(*image.T) * CAMERA.exposure / dt
        v, w = lm.motion(a, b, dt)
        assert v == pytest.approx(move, abs=1e-3)
        assert w == pytest.approx(turn, abs=1e-3)
        assert lm.blur(CAMERA, before, v, w) == pytest.approx(expected, rel=1e-3)


def count(speed=0.0, rate=0.0, frames=200):
    sensor = lm.LandmarkSensor(NAO, CAMERA, field(), seed=1)
    dt = 0.01
    seen = [len(sensor.look(pose(), pose(x=speed * dt, yaw=rate * dt), dt)[0]) for _ in range(frames)]
    return float(np.mean(seen))


def test_recognition_falls_with_linear_and_angular_speed():
    still = count()
    assert still > 5.0
    assert still > count(speed=0.05) > count(speed=0.15) > count(speed=0.5)
    assert still > count(rate=0.02) > count(rate=0.05) > count(rate=0.1) > count(rate=0.3)


def test_measurements_are_where_the_landmarks_are():
    land = field()
    sensor = lm.LandmarkSensor(NAO, CAMERA, land, seed=2)
    here = pose(x=0.3, y=-0.2, yaw=0.7)
    found = [d for _ in range(100) for d in sensor.look(here, here, 0.01)[0]]
    for d in found:
        dx, dy = land.position[d.landmark] - [0.3, -0.2]
        assert d.range == pytest.approx(math.hypot(dx, dy), rel=6 * CAMERA.range_sigma)
        error = d.bearing - (math.atan2(dy, dx) - 0.7)
        assert abs(math.atan2(math.sin(error), math.cos(error))) < 6 * CAMERA.bearing_sigma
        assert int(np.argmax(land.descriptor @ d.descriptor)) == d.landmark


def test_goal_marker_is_seen_in_the_image_only():
    near = lm.LandmarkSensor(NAO, CAMERA, field(), 1, goal=(0.45, 0.0))
    far = lm.LandmarkSensor(NAO, CAMERA, field(), 1, goal=(3.0, 0.0))
    assert near.look(pose(), pose(), 0.01)[1] is not None
    assert far.look(pose(), pose(), 0.01)[1] is None


def test_equal_seeds_see_the_same():
    def frames():
        sensor = lm.LandmarkSensor(NAO, CAMERA, field(), seed=7)
        return [sensor.look(pose(), pose(x=1e-3), 0.01) for _ in range(20)]

    assert str(frames()) == str(frames())


def test_unknown_cameras_and_robots_without_the_link_are_refused():
    with pytest.raises(RobotError) as error:
        lm.read_camera("eye")
    assert error.value.field == "camera"
    ragno = load_robot("ragno")
    with pytest.raises(RobotError) as error:
        lm.camera_pose(ragno, CAMERA, np.zeros(3), LEVEL, ragno.neutral)
    assert error.value.field == "link"


@pytest.mark.slow
def test_a_walking_nao_recognises_three_and_a_quarter_a_frame_and_a_standing_one_far_more():
    """Osswald et al.: 3.25 matched features a frame while walking slowly."""
    from surefoot.services.walker.interface import MotionCommand
    from tests.services.walker.biped.biped_plant import Plant

    plant = Plant("nao", seed=1, level=1.0).stand()
    sensor = lm.LandmarkSensor(plant.robot, CAMERA, field(), seed=1)
    before, frames = None, {"standing": [], "walking": []}

    def look(out):
        nonlocal before
        truth = plant.world.truth()
        now = lm.camera_pose(plant.robot, CAMERA, truth.position, truth.quat_wxyz, truth.joints)
        if before is not None and plant.world.tick * 10 % CAMERA.period_ms == 0 and out.state in frames:
            frames[out.state].append(len(sensor.look(before, now, 0.01)[0]))
        before = now
        return out.state == "standing" and len(frames["walking"]) > 40

    for _ in range(100):
        look(plant.tick())
    plant.walker.command(MotionCommand("walk", distance=0.4))
    plant.until(look, 1500)
    assert np.mean(frames["walking"]) == pytest.approx(3.25, abs=0.6)
    assert np.mean(frames["standing"]) > 2.0 * np.mean(frames["walking"])
