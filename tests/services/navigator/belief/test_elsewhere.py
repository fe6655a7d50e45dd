"""Landmarks that agree on one other place: robots put down elsewhere, robots that were not, false landmarks alone."""

import math

import numpy as np

from surefoot.services.navigator.belief.elsewhere import OtherPlaces
from surefoot.services.navigator.belief.matching import Detections
from surefoot.services.navigator.belief.moved import Sight
from tests.services.navigator.belief.floors import ROUGH, Eye, floor

COV = np.diag([0.05**2, 0.05**2, math.radians(5.0) ** 2])
BELIEVED = (2.0, 0.0, 0.0)


def looked(seed, truth, frames=1, scattered=False):
    world = floor(seed, copied=0.5)
    eye, places = Eye(world, ROUGH, seed, recognised=0.32, false=0.1, most=10), OtherPlaces(world, ROUGH)
    for k in range(frames):
        seen, _ = eye.look(truth)
        if scattered:  # each landmark where another was seen: they agree on nothing
            order = np.roll(np.arange(len(seen)), 1)
            seen = Detections(seen.ranges[order], seen.bearings[order], seen.looks)
        places.look(seen, Sight(BELIEVED, COV, ROUGH, 1.7 * (k + 1)), BELIEVED)
    return places


def test_one_frame_of_landmarks_that_agree_decides_where_the_robot_was_put_down():
    found = [looked(seed, (4.0, 0.1, math.pi)).probability for seed in range(20)]
    assert np.mean(np.array(found) > 0.9) >= 0.8


def test_frames_of_a_right_pose_favour_no_other_place():
    rng = np.random.default_rng(5)
    for seed in range(40):
        truth = np.array(BELIEVED) + np.sqrt(np.diag(COV)) * np.clip(rng.standard_normal(3), -2.0, 2.0)
        assert looked(seed, truth, frames=3).probability < 0.9


def test_landmarks_that_agree_on_no_place_are_worth_less():
    agreeing, scattered = (
        np.mean([looked(seed, (4.0, 0.1, math.pi), scattered=each).probability > 0.9 for seed in range(20)])
        for each in (False, True)
    )
    assert scattered <= 0.5 * agreeing


def test_a_stated_pose_forgets_the_frames():
    places = looked(1, (4.0, 0.1, math.pi), frames=2)
    assert places.probability > 0.0
    places.begin()
    assert places.probability == 0.0
