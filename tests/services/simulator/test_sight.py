"""Camera, ultrasound and bumpers of a robot in its world: times and values of samples, and what a restore keeps."""

import math

import numpy as np
import pytest

from surefoot.robot.description import RobotError
from surefoot.robot.reader import load_robot
from surefoot.services.simulator.ground.terrain import make_terrain
from surefoot.services.simulator.messages import sight_messages
from surefoot.services.simulator.physics.faults import Fault
from surefoot.services.simulator.physics.model import Physics
from surefoot.services.simulator.sensors.sight import CameraFrame, Floor, Reach, Senses
from surefoot.services.simulator.sensors.walls import read_ranger
from surefoot.services.simulator.world import PhysicsWorld, WorldConfig
from tests.services.refusals import refused
from tests.services.simulator.stepping import steps

NAO = load_robot("nao")
RANGER = read_ranger("nao_walls")
FRONT = 1.5  # m, inner face of the wall ahead in the terrain `room`


def world(terrain="room", seed=1, pose=(0.0, 0.0, 0.0), **config):
    made = PhysicsWorld(NAO, make_terrain(terrain), seed, WorldConfig(**config))
    made.reset(pose=pose)
    return made


def sight_of(made: PhysicsWorld) -> Senses:
    assert made.sight is not None
    return made.sight


def run(made: PhysicsWorld, ticks: int) -> tuple[list[CameraFrame], list[Reach]]:
    frames, reaches = [], []
    for _ in range(ticks):
        made.step_tick()
        sight = sight_of(made)
        frames += [] if sight.frame is None else [sight.frame]
        reaches += [] if sight.reach is None else [sight.reach]
    return frames, reaches


def test_only_robots_that_have_them_see_and_feel():
    for name in ("bioloid", "ragno", "messor"):
        made = PhysicsWorld(load_robot(name), make_terrain("flat"), 1)
        assert made.sight is None
        assert sight_messages(made.sight, made.stamp_ns) == []


def test_a_frame_and_an_echo_each_100_ms_numbered_in_order():
    frames, reaches = run(world(floor=Floor(goal=(0.45, 0.0))), 50)
    assert [f.seq for f in frames] == [r.seq for r in reaches] == [1, 2, 3, 4, 5]
    assert all(frame.landmarks for frame in frames)
    assert all(frame.goal is not None for frame in frames)
    assert frames[0].goal.range == pytest.approx(0.45, rel=0.2)


def test_messages_carry_what_was_seen():
    made = world(floor=Floor(goal=(0.45, 0.0)))
    run(made, 10)
    marks, near = sight_messages(made.sight, made.stamp_ns)
    assert (marks.topic.key, near.topic.key) == ("hw/landmarks", "hw/range")
    assert marks.stamp_ns == near.stamp_ns == made.stamp_ns == 100_000_000
    frame = sight_of(made).frame
    assert [m.range for m in marks.message.landmarks] == [d.range for d in frame.landmarks]
    assert marks.message.goal.bearing == frame.goal.bearing
    assert near.message.bump == (False, False)
    for message in (marks.message, near.message):
        assert type(message).model_validate_json(message.model_dump_json()) == message


@pytest.mark.parametrize(
    ("pose", "expected"),
    [
        ((0.0, 0.0, 0.0), FRONT),
        ((0.5, 0.2, 0.0), FRONT - 0.5),
        ((0.0, 0.0, math.pi / 2), 1.0),
        ((0.5, 0.0, math.pi), 1.5),
    ],
)
def test_ultrasound_measures_the_distance_of_the_nearest_wall(pose, expected):
    """A square look at a wall: its distance less the place of the sensor."""
    _, reaches = run(world(pose=pose), 100)
    found = np.mean([r.distance for r in reaches])
    assert found == pytest.approx(expected - RANGER.position[0], abs=0.02)


def test_ultrasound_hears_nothing_in_the_open_and_no_nearer_than_it_can():
    _, reaches = run(world("flat"), 20)
    assert {r.distance for r in reaches} == {None}
    _, reaches = run(world(pose=(FRONT - 0.2, 0.0, 0.0)), 20)
    assert {r.distance for r in reaches} == {RANGER.shortest}


def test_a_foot_that_is_pushed_against_a_wall_reports_it():
    made = world(pose=(FRONT - 0.085, 0.0, 0.0), physics=Physics(friction=0.1))
    _, before = run(made, 20)
    assert not any(any(r.bump) for r in before)
    made.push((15.0, 0.0, 0.0), 0.4)
    _, reaches = run(made, 60)
    assert any(any(r.bump) for r in reaches)
    assert made.truth().foot_position[:, 0].max() < FRONT


def test_to_lean_on_a_wall_is_no_fall():
    made = world(pose=(FRONT - 0.093, 0.0, 0.0))
    made.push((8.0, 0.0, 0.0), 0.4)
    leaned = False
    for _ in range(60):
        made.step_tick()
        leaned |= bool(np.isin(made.data.contact.geom, made.address.belly_geoms).any())
    assert leaned
    assert not made.truth().fallen


def test_equal_seeds_see_the_same_and_others_do_not():
    def seen(seed):
        frames, reaches = run(world(seed=seed), 30)
        return str([[d.range for d in f.landmarks] for f in frames]) + str([r.distance for r in reaches])

    assert seen(3) == seen(3)
    assert seen(3) != seen(4)


def test_a_restored_world_sees_what_it_saw():
    made = world(floor=Floor(goal=(0.45, 0.0)))
    run(made, 17)
    saved = made.checkpoint()
    first = run(made, 30)
    made.restore(saved)
    assert str(run(made, 30)) == str(first)


@pytest.mark.parametrize("kind", ["camera_dark", "range_drop", "range_stuck", "landmarks_drop"])
def test_faults_of_camera_and_ultrasound_act_in_their_time(kind):
    made = world(floor=Floor(goal=(0.45, 0.0)))
    made.add_fault(Fault(kind, 15, 0.2, value=1.0 if kind == "landmarks_drop" else 0.0))
    frames, reaches = run(made, 50)
    assert [r.seq for r in reaches] == ([1, 4, 5] if kind == "range_drop" else [1, 2, 3, 4, 5])
    dark = [f.seq for f in frames if not f.landmarks]
    assert dark == ([2, 3] if kind in ("camera_dark", "landmarks_drop") else [])
    assert [f.seq for f in frames if f.goal is None] == ([2, 3] if kind == "camera_dark" else [])
    assert [r.seq for r in reaches if r.distance == RANGER.shortest] == ([2, 3] if kind == "range_stuck" else [])


def test_eyes_change_nothing_else():
    """Camera and ranger only look: the physics of the robot without them is the same to the bit."""
    seeing, blind = world(), world()
    blind.sight = None
    for made in (seeing, blind):
        run_blind = made.sight is None
        steps(made, 30)
        assert (made.sight is None) == run_blind
    assert seeing.truth().position.tobytes() == blind.truth().position.tobytes()
    assert seeing.samples.imu.acc.tobytes() == blind.samples.imu.acc.tobytes()


@pytest.mark.parametrize(("terrain", "area"), [("flat", 100.0), ("room", 5.0), ("corridor", 15.0), ("corner", 20.0)])
def test_landmarks_lie_on_the_whole_floor_and_nowhere_else(terrain, area):
    ground = make_terrain(terrain)
    made = PhysicsWorld(NAO, ground, 3, WorldConfig(floor=Floor(landmarks=40.0)))
    points = sight_of(made).sensor.field.position
    assert ground.on_floor(points).all()
    assert len(points) == pytest.approx(40.0 * area, rel=0.12)
    if ground.floor:
        outline = np.array(ground.floor)
        assert np.all(points.min(axis=0) < outline.min(axis=0) + 0.3)
        assert np.all(points.max(axis=0) > outline.max(axis=0) - 0.3)


def test_copied_landmarks_look_alike_in_groups():
    ground = make_terrain("corridor")
    floor = Floor(landmarks=40.0, copied=0.5, copies=10)
    plain, made = (PhysicsWorld(NAO, ground, 3, WorldConfig(floor=f)) for f in (Floor(landmarks=40.0), floor))
    field, before = sight_of(made).sensor.field, sight_of(plain).sensor.field
    assert np.array_equal(field.position, before.position)
    _, count = np.unique(field.descriptor, axis=0, return_counts=True)
    groups = round(0.5 * len(field.position)) // 10
    assert sorted(set(count.tolist())) == [1, 10]
    assert int(np.sum(count == 10)) == groups
    assert len(np.unique(before.descriptor, axis=0)) == len(before.descriptor)


def test_unknown_profiles_are_refused_by_name():
    with refused(RobotError, "unknown_name", "ranger"):
        read_ranger("bat")
