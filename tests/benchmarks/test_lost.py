"""The study of lost robots runs the navigator itself: robots notice, recover rightly, raise no false alarm."""

import numpy as np
import pytest

from benchmarks.lost import put_down, told_apart, undisturbed, with_map
from benchmarks.lost_floor import MIDDLE, World, corridor, special
from benchmarks.lost_robot import Robot
from surefoot.services.navigator.belief.relocalise import placed

EASY = World()


def test_robots_that_were_put_down_elsewhere_notice_and_recover_rightly() -> None:
    lines = [
        put_down(seed, distance, turn, walking, EASY)
        for seed, (distance, turn, walking) in enumerate([(0.35, 20.0, True), (0.7, 90.0, False), (3.0, 180.0, True)])
    ]
    assert not any(line["early"] or line["wrong"] for line in lines)
    assert all(line["noticed"] is not None and line["noticed"] <= 3.0 for line in lines)
    assert all(line["recovered"] is not None for line in lines)


def test_a_seed_gives_a_robot_to_the_bit() -> None:
    one, same, other = (Robot(seed, World(camera="hard")) for seed in (3, 3, 4))
    for robot in (one, same, other):
        robot.step(1.0)
    poses = [(*robot.walker.pose, *robot.navigator.localiser.tracker.pose) for robot in (one, same, other)]
    assert poses[0] == poses[1] != poses[2]


def test_oracles_weigh_poses_by_the_frames_of_three_seconds() -> None:
    robot = Robot(3, World(camera="hard"))
    robot.step(5.0)
    robot.put(0.0, 0.0)
    robot.step(8.0)
    assert [known for known, _ in robot.evidence] == [0.0, 0.0]  # it is where it was
    assert np.exp(robot.weights).sum() == pytest.approx(1.0, abs=0.2)  # of all places of the corridor
    robot.evidence.clear()
    robot.put(3.0, 180.0)
    before = np.array(placed(robot.before or (0.0, 0.0, 0.0), tuple(robot.walker.pose.tolist())))
    assert np.hypot(*(before - robot.walker.pose)[:2]) == pytest.approx(3.0)
    robot.step(3.5)
    known, anywhere = (sum(each[i] for each in robot.evidence) for i in (0, 1))
    assert known > 8.6  # ten landmarks in two frames of a robot that stands
    assert np.logaddexp.reduce(robot.weights + anywhere) < known
    assert np.logaddexp.reduce(robot.weights + anywhere) > np.max(anywhere[1::2] + robot.weights[1::2])


def test_floors_of_the_study_have_their_hole_and_stand_twice() -> None:
    places, looks = corridor(3, 40.0, 0.0)
    found, same = special(places, looks, World(hole=1.5))
    assert 0 < len(found) < len(places)
    assert np.hypot(*(found - MIDDLE).T).min() >= 0.75
    np.testing.assert_array_equal(special(places, looks, World())[0], places)
    assert len(same) == len(found)
    found, same = special(places, looks, World(twice=1.0))
    off = np.hypot(*np.moveaxis(found[:, None] - (2.0 * MIDDLE - found), 2, 0)).min(axis=1)
    assert (off > 1e-9).sum() <= 1
    assert np.unique(same.round(6), axis=0).shape[0] == pytest.approx(0.5 * len(same), abs=1)


def test_a_lost_robot_walks_to_where_places_differ_and_finds_its_pose() -> None:
    line = told_apart(50002, World(twice=1.0, copied=0.0, apart=1.0))
    assert line["found"]
    assert not line["wrong"]
    assert 1.0 < line["way"] < 3.0  # seen from where it was put down, two places fit alike


def test_second_landmarks_look_like_no_others_near_the_ends() -> None:
    places, looks = special(*corridor(3, 40.0, 0.0), World(twice=1.0, apart=1.0))
    alike = np.isclose(looks @ looks.T, 1.0).sum(axis=1) == 2
    middle = np.abs(places[:, 0] - MIDDLE[0]) < 2.75
    assert alike[middle][:-1].mean() > 0.99
    assert not alike[~middle].any()


def test_maps_that_do_not_fit_are_noticed_within_a_third_of_a_metre() -> None:
    for kind in ("mirrored", "shuffled", "stretched"):
        line = with_map(1000, kind, EASY)
        assert line["noticed"] is not None
        assert line["walked"] <= 0.35


def test_an_undisturbed_robot_raises_no_alarm() -> None:
    assert undisturbed(1, 1.0, EASY)["alarms"] == 0
