"""Where the robot is put: at the start of a run, and elsewhere while it stands; never into a wall or off the ground."""

import math

import numpy as np
import pytest

from surefoot.robot.description import Robot
from surefoot.robot.reader import load_robot
from surefoot.services.simulator.ground.terrain import make_terrain
from surefoot.services.simulator.physics.samples import Detection
from surefoot.services.simulator.world import PhysicsWorld, WorldConfig, WorldError
from tests.services.refusals import refused
from tests.services.simulator.stepping import steps

RAGNO, NAO = load_robot("ragno"), load_robot("nao")


@pytest.mark.parametrize("pose", [(0.0, 0.0, 0.0), (5.0, -0.5, 1.0), (-0.5, 0.5, -3.0)])
def test_a_run_begins_where_it_is_asked_to(pose: tuple[float, float, float]) -> None:
    truth = PhysicsWorld(NAO, make_terrain("corridor"), config=WorldConfig(start=pose)).truth()
    w, _, _, z = truth.quat_wxyz
    assert truth.position[:2] == pytest.approx(pose[:2], abs=0.01)
    assert 2.0 * math.atan2(z, w) == pytest.approx(pose[2], abs=0.02)


@pytest.mark.parametrize(
    "pose",
    [
        (0.0, 0.95, 0.0),  # a foot in the wall
        (2.9, 1.1, 0.0),  # behind it
        (3.05, 1.05, 0.7),  # across the corner that points inwards
        (2.93, 0.93, 0.785),
        (40.0, 0.0, 0.0),
        (1e9, 0.0, 0.0),
    ],
)
def test_no_run_begins_in_a_wall_or_off_the_ground(pose: tuple[float, float, float]) -> None:
    with refused(WorldError, field="pose"):
        PhysicsWorld(NAO, make_terrain("corner"), config=WorldConfig(start=pose))


def relative(truth: object, pose: tuple[float, float, float]) -> np.ndarray:
    """Feet (L, 3) as seen from a pose on the floor."""
    c, s = math.cos(pose[2]), math.sin(pose[2])
    rot = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    return (truth.foot_position - np.array([*pose[:2], 0.0])) @ rot  # type: ignore[attr-defined]


@pytest.mark.parametrize("robot", [RAGNO, NAO], ids=lambda robot: robot.name)
def test_a_displaced_robot_stands_elsewhere_as_it_stood(robot: Robot) -> None:
    world = PhysicsWorld(robot, make_terrain("corridor"), 1)
    stays = PhysicsWorld(robot, make_terrain("corridor"), 1)
    steps(world, 10)
    world.displace(0.7, -0.2, math.radians(90.0))
    steps(world, 100)
    steps(stays, 110)
    put, stood = world.truth(), stays.truth()
    assert put.position == pytest.approx(stood.position + np.array([0.7, -0.2, 0.0]), abs=1e-3)
    assert relative(put, (*put.position[:2], math.pi / 2)) == pytest.approx(
        relative(stood, (*stood.position[:2], 0.0)), abs=1e-3
    )
    assert not put.fallen
    assert np.all(put.stances == 0)
    assert put.foot_displacement == pytest.approx(0.0, abs=1e-3)
    assert put.contact_sliding == pytest.approx(stood.contact_sliding, abs=1e-3)
    assert put.foot_twist == pytest.approx(stood.foot_twist, abs=1e-3)


def test_a_displaced_robot_does_not_feel_it_but_its_camera_sees_another_floor() -> None:
    world = PhysicsWorld(NAO, make_terrain("corridor"), 1, WorldConfig(imu_profile="ideal"))
    steps(world, 9)
    assert world.sight is not None
    before = {mark.landmark for _ in range(20) for mark in looked(world)}
    world.displace(0.7, 0.0, 3.0)
    rates = []
    for _ in range(30):
        world.step_tick()
        rates.append(np.abs(world.samples.imu.gyro).max())
    assert max(rates) < 0.02
    after = {mark.landmark for _ in range(20) for mark in looked(world)}
    assert after
    assert not before & after


def looked(world: PhysicsWorld) -> list[Detection]:
    """Landmarks of the next image."""
    assert world.sight is not None
    world.step_tick()
    while world.sight.frame is None:
        world.step_tick()
    return world.sight.frame.landmarks


@pytest.mark.parametrize(
    ("move", "field"),
    [
        ((0.0, 0.95, 0.0), "forward"),  # into a wall
        ((0.0, 1.5, 0.0), "forward"),  # behind it
        ((50.0, 0.0, 0.0), "forward"),
        ((-100.0, 100.0, 6.0), "forward"),
    ],
)
def test_no_robot_is_put_into_a_wall_or_off_the_ground(move: tuple[float, float, float], field: str) -> None:
    world = PhysicsWorld(NAO, make_terrain("corridor"))
    before = world.truth().position
    with refused(WorldError, field=field):
        world.displace(*move)
    assert np.array_equal(world.truth().position, before)


def test_a_robot_is_not_put_on_other_ground_nor_with_a_foot_in_the_air() -> None:
    world = PhysicsWorld(RAGNO, make_terrain("steps"))
    with refused(WorldError, field="forward"):
        world.displace(0.3, 0.0, 0.0)  # across a riser
    world.displace(0.05, 0.05, 0.1)
    q = RAGNO.neutral.copy()
    q[RAGNO.legs[0].joints[1]] -= 0.5
    steps(world, 30, q)
    with refused(WorldError, field="at_tick"):
        world.displace(0.0, 0.0, 0.1)


def test_a_checkpoint_after_a_displacement_has_the_same_future() -> None:
    world = PhysicsWorld(NAO, make_terrain("corridor"), 2)
    world.displace(1.0, 0.3, -1.0)
    world.step_tick()
    saved, futures = world.checkpoint(), []
    for _ in range(2):
        world.restore(saved)
        steps(world, 20)
        futures.append(world.truth().position.tobytes())
    assert futures[0] == futures[1]
