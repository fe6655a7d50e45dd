"""Recordings as events: what a made-up robot did and saw, and what is no such recording."""

import math

import numpy as np
import pytest

from surefoot.errors import SurefootError
from surefoot.lab.fit.counts import durations, matches
from surefoot.lab.fit.events import FRAME, KEYS, MOVE, SEE, Run, read_run
from surefoot.lab.fit.result import Fitted
from surefoot.services.navigator.belief.landmarks import FloorLandmarks
from surefoot.services.navigator.policy.params import load
from surefoot.services.navigator.policy.settings import Conduct
from tests.lab.fit.recordings import Story, tour, turn, walk
from tests.surefoot.expect import expect_error


@pytest.fixture(scope="module")
def model():
    return load("nao-paper")


@pytest.fixture(scope="module")
def run(model, tmp_path_factory):
    return read_run(tour(tmp_path_factory.mktemp("tour") / "tour.mcap"), model)


def shares(run, model):
    names, moves = list(model.actions), run.events[run.events[:, 0] == MOVE]
    return {names[int(i)]: float(moves[moves[:, 1] == i, 2].sum()) for i in np.unique(moves[:, 1])}


def test_each_action_is_carried_out_once_as_often_as_it_was_ordered(run, model):
    assert shares(run, model) == pytest.approx({"walk": 4.0, "left": 1.0, "arc_right_11": 1.0})


def test_durations_by_what_was_before(run):
    assert run.durations.keys() == {("stand", "walk"), ("walk", "walk"), ("walk", "left"), ("turn", "arc_right_11")}
    assert run.durations["stand", "walk"] == pytest.approx([2.8], abs=0.02)
    assert run.durations["walk", "walk"] == pytest.approx([1.8] * 3, abs=0.02)
    assert run.halts == {"walk": pytest.approx([0.9], abs=0.02)}


def test_the_trunk_follows_the_feet_in_the_events_as_in_the_navigator(run):
    """The first walk lands 2.8 s after its order; the trunk has gone its way a lag later, whole ticks of a frame."""
    time, done = 0.0, 0.0
    for kind, value, share, *_ in run.events:
        time += value if kind == FRAME else 0.0
        if kind == MOVE and value == 0.0:
            done += share
        if done >= 1.0 - 1e-9:
            break
    assert time == pytest.approx(0.5 + 2.8 + Conduct().lag, abs=0.11)


def test_sightings_are_those_of_the_map(run):
    seen = run.events[run.events[:, 0] == SEE]
    assert len(seen) > 100
    assert {0.0, 1.0} == set(seen[:, 5])
    standing = seen[seen[:, 5] == 1.0][:20]
    away = standing[:, 1:3]  # before the first order the robot stands at the origin
    np.testing.assert_allclose(np.hypot(*away.T), standing[:, 3], atol=0.1)
    np.testing.assert_allclose(np.arctan2(away[:, 1], away[:, 0]), standing[:, 4], atol=0.1)


def test_images_are_frames_of_which_all_that_was_recognised_counts(run, model, tmp_path):
    story = Story(tmp_path / "world.mcap")
    story.close()
    world = FloorLandmarks.from_bytes(story.world.to_bytes(), len(story.world), 8)
    seen = read_run(tour(tmp_path / "eyes.mcap", skip=("terrain/landmarks",), images=True), model, world)
    np.testing.assert_array_equal(seen.events, run.events)
    assert seen.density == pytest.approx(len(world) / world.area)
    assert run.density == 0.0
    for name, rows in seen.frames.items():
        assert [most for most, _ in rows] == [most for most, _ in run.frames[name]]
        assert {count == min(most, 20) for most, count in rows} == {True}
    found = Fitted()
    matches([seen], model, found)
    walking = np.array(seen.frames["walk"])
    assert found.values["actions.walk.match"].value == pytest.approx(walking[:, 1].sum() / walking[:, 0].sum(), 1e-6)
    assert found.values["scene.landmarks_per_m2"].value == pytest.approx(seen.density)


def test_images_without_a_map_are_refused(model, tmp_path):
    with expect_error(SurefootError, "invalid", field="terrain/landmarks"):
        read_run(tour(tmp_path / "eyes.mcap", skip=("terrain/landmarks",), images=True), model)


def test_switching_and_frames_go_to_both_of_a_mirrored_pair(run, model):
    found = Fitted()
    durations([run], model, found)
    values = {key: interval.value for key, interval in found.values.items()}
    assert values["switching.stand.walk"] == pytest.approx(1.0, abs=0.02)
    assert values["switching.walk.stand"] == pytest.approx(0.9, abs=0.02)
    assert values["actions.left.duration"] == values["actions.right.duration"] == pytest.approx(1.8, abs=0.02)
    assert values["actions.walk.frames"] == 18
    assert values["actions.stand.frames"] == 7
    assert not any("arc_left_23" in key or "arc_right_23" in key for key in values)


def test_match_shares_of_full_frames_are_larger_than_what_was_used(model, tmp_path):
    rng = np.random.default_rng(2)
    views = rng.integers(15, 35, 4000)
    used = np.minimum(rng.binomial(views, 0.45), model.sight.most)
    few = rng.binomial(views, 0.08)
    runs = []
    for part in range(4):
        run, rows = Run(tmp_path), slice(part, None, 4)
        run.frames = {
            "stand": list(zip(views[rows], used[rows], strict=True)),
            "right": list(zip(views[rows], few[rows], strict=True)),
        }
        runs.append(run)
    found = Fitted()
    matches(runs, model, found)
    stand = found.values["actions.stand.match"]
    assert stand.low <= 0.45 <= stand.high
    assert used.sum() / views.sum() < stand.low
    right = found.values["actions.right.match"]
    assert right == found.values["actions.left.match"]
    assert right.value == pytest.approx(few.sum() / views.sum(), abs=1e-3)
    assert "actions.walk.match" not in found.values


def test_match_share_of_frames_that_are_all_full_has_no_upper_end(model, tmp_path):
    run = Run(tmp_path)
    run.frames = {"stand": [(30, model.sight.most)] * 5}
    found = Fitted()
    matches([run], model, found)
    assert 0.33 < found.values["actions.stand.match"].value < 1.0
    assert found.values["actions.stand.match"].high == 1.0


def test_a_turn_by_another_angle_is_so_much_of_a_turn(model, tmp_path):
    run = read_run(tour(tmp_path / "turned.mcap", last=turn(-46.0)), model)
    assert shares(run, model)["right"] == pytest.approx(2.0)
    assert not any(name == "right" for _, name in run.durations)


def test_what_follows_a_walk_that_is_no_action_is_left_out(model, run, tmp_path):
    other = read_run(tour(tmp_path / "far.mcap", last=walk(angle=math.radians(-40.0))), model)
    assert len(other.events) < len(run.events)
    assert shares(other, model)["walk"] == pytest.approx(4.0)


@pytest.mark.parametrize("key", KEYS)
def test_recordings_without_what_is_needed_are_refused(model, tmp_path, key):
    with expect_error(SurefootError, "invalid", field=key):
        read_run(tour(tmp_path / "less.mcap", skip=(key,)), model)
