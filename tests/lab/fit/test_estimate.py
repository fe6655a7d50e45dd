"""Fits to the events of robots whose numbers are known."""

import numpy as np
import pytest

from surefoot.errors import SurefootError
from surefoot.lab.fit.estimate import fit
from surefoot.lab.fit.merged import merged
from surefoot.lab.fit.search import deviations
from surefoot.services.navigator.policy.params import load
from tests.lab.fit.robots import ARC_LEFT, ARC_RIGHT, LEFT, RIGHT, STAND, WALK, Robot, run_of, truth_of
from tests.surefoot.expect import expect_error

FOUR = [WALK, WALK, WALK, LEFT, WALK, WALK, STAND, WALK, RIGHT, WALK]
ARCS = [WALK, WALK, ARC_LEFT, WALK, STAND, WALK, ARC_RIGHT, WALK, ARC_RIGHT, ARC_LEFT]
WRONG = (
    "sight.range_sd=0.12", "sight.bearing_sd_deg=9.2", "sight.tilt_sd_deg=0.7", "sight.pitch_deg=0.0",
    "sight.sway_sd=0.06", "sight.sway_keep=0.72", "sight.standing_share=0.8", "drift.known_sd_deg=4.0",
    "actions.walk.along_sd=0.05", "actions.walk.heading_sd_deg=6.0",
)  # fmt: skip


@pytest.fixture(scope="module")
def wrong():
    return load("nao-paper", WRONG)


def runs_of(robot, seed, actions, count):
    return [run_of(robot, np.random.default_rng((seed, i)), actions) for i in range(count)]


@pytest.fixture(scope="module")
def fits(wrong):
    """Fits of the same robot, with the four actions, to four times five runs."""
    return [fit(runs_of(Robot(), seed, FOUR, 5), wrong) for seed in range(4)]


def test_intervals_hold_the_truth_at_their_rate(fits):
    truth = truth_of(Robot())
    rows = [(key, truth[key], f.values[key]) for f in fits for key in truth if key in f.values]
    missed = [(key, true, i) for key, true, i in rows if not i.low <= true <= i.high]
    assert len(rows) >= 4 * 12
    assert len(missed) <= 0.15 * len(rows), missed


def test_no_number_is_missed_every_time(fits):
    truth = truth_of(Robot())
    for key in truth:
        found = [f.values[key] for f in fits if key in f.values]
        assert not found or any(i.low <= truth[key] <= i.high for i in found), (key, truth[key], found)


def test_recordings_become_likelier_than_under_the_model_to_begin_with(fits):
    assert all(f.improvement > 100.0 for f in fits)
    assert all(f.runs == 5 and f.sightings == 5 * 10 * 10 for f in fits)


def test_walks_stretch_and_turns_differ_from_what_was_commanded(fits):
    """Where the robot goes less far, or turns farther, than commanded, most fits show it; none shows the opposite."""
    ways = [f.values["actions.walk.forward"] for f in fits if "actions.walk.forward" in f.values]
    turns = [f.values["actions.left.turn_deg"] for f in fits if "actions.left.turn_deg" in f.values]
    assert len(ways) >= 3
    assert all(way.high < 0.1 for way in ways)
    assert all(turn.low > 23.0 for turn in turns)


def test_ways_as_commanded_are_left_out(wrong):
    robot = Robot(forward=1.0, turned=1.0)
    found = [fit(runs_of(robot, seed, FOUR, 2), wrong) for seed in range(20, 23)]
    assert sum("actions.walk.forward" in f.undecided for f in found) >= 2
    assert all(("actions.walk.forward" in f.values) != ("actions.walk.forward" in f.undecided) for f in found)


@pytest.mark.slow
def test_arcs_have_noises_of_their_own_where_they_occur(wrong):
    robot = Robot()
    found = fit(runs_of(robot, 7, ARCS * 2, 5), wrong)
    truth = truth_of(robot, arcs=True)
    own = [key for key in truth if key.startswith("actions.arc") and key in found.values]
    assert {"actions.arc_left_11.heading_sd_deg", "actions.arc_left_11.along_sd"} <= set(own)
    held = [found.values[key].low <= truth[key] <= found.values[key].high for key in own]
    assert np.mean(held) >= 0.6
    assert found.values["actions.arc_left_11.along_sd"].low > found.values["actions.walk.along_sd"].value
    assert not any(key.startswith("actions.left") for key in found.values)  # none occurred


def test_arcs_that_do_not_occur_take_the_noises_of_walks(fits):
    values = fits[0].values
    assert values["actions.arc_left_23.across_sd"] == values["actions.walk.across_sd"]
    assert "actions.arc_left_23.turn_deg" not in values


def test_numbers_that_the_recordings_do_not_decide_are_left_out(wrong):
    found = fit([run_of(Robot(), np.random.default_rng(3), [WALK, WALK, LEFT], frames=1, seen=1)], wrong)
    assert "sight.tilt_sd_deg" in found.undecided
    assert not set(found.undecided) & set(found.values)
    for key, interval in found.values.items():
        if interval.low > 0.0:
            assert interval.high <= 100.0 * interval.low, key


def test_a_noise_that_is_not_told_from_zero_begins_there():
    robot = Robot(across=1e-6, sway=1e-6)
    steady = load("nao-paper", [*WRONG, "actions.walk.drift_walk_deg=0.05"])  # as the drift of that robot
    found = fit(runs_of(robot, 11, FOUR * 2, 4), steady)
    interval = found.values["sight.sway_sd"]
    assert interval.low == 0.0
    assert 0.0 < interval.value < interval.high < 0.03


def test_same_recordings_give_the_same_numbers(wrong):
    runs = runs_of(Robot(), 5, FOUR[:5], 2)
    assert fit(runs, wrong) == fit(runs, wrong)


def test_no_recordings_are_refused(wrong):
    with expect_error(SurefootError, "invalid", field="recordings"):
        fit([], wrong)


def test_merged_events_keep_ways_times_and_sightings():
    events = run_of(Robot(), np.random.default_rng(1), FOUR, frames=3).events
    few = merged(events)
    assert len(few) < 0.8 * len(events)
    for column, kind in ((2, 0.0), (1, 1.0)):
        assert few[few[:, 0] == kind, column].sum() == pytest.approx(events[events[:, 0] == kind, column].sum())
    np.testing.assert_array_equal(few[few[:, 0] == 2.0], events[events[:, 0] == 2.0])
    assert few[few[:, 0] == 0.0, 2].max() <= 1.0 + 1e-6


def test_frames_without_a_sighting_become_time():
    empty = [(1.0, 0.1, 0.0), (0.0, 0.0, 0.5), (1.0, 0.2, 0.0), (0.0, 0.0, 0.5), (0.0, 2.0, 0.5), (2.0, 1.0, 1.0)]
    events = np.array([(*row, 0.0, 0.0, 0.0) for row in [*empty, (1.0, 9.0, 0.0)]])
    expected = [(0.0, 0.0, 1.0), (0.0, 2.0, 0.5), (1.0, 0.3, 0.0), (2.0, 1.0, 1.0)]
    np.testing.assert_allclose(merged(events)[:, :3], expected)


@pytest.mark.slow
def test_merging_hardly_changes_the_numbers(wrong, monkeypatch):
    runs = runs_of(Robot(), 2, FOUR, 4)
    few = fit(runs, wrong)
    monkeypatch.setattr("surefoot.lab.fit.search.merged", lambda events: events)
    all_of = fit(runs, wrong)
    assert few.values.keys() == all_of.values.keys()
    for key, interval in few.values.items():
        other = all_of.values[key]
        assert abs(interval.value - other.value) <= 0.1 * (interval.high - interval.low) + 1e-12, key


def test_deviations_count_what_differs_between_recordings():
    """The mean of groups that differ: the curvature knows only the noise within, the slopes also what is between."""
    rng = np.random.default_rng(0)
    groups = rng.normal(0.0, 1.0, 40)[:, None] + rng.normal(0.0, 0.1, (40, 25))
    slopes = -(groups - groups.mean()).sum(axis=1, keepdims=True) / 0.1**2
    sigma = deviations(np.array([[groups.size / 0.1**2]]), slopes)
    assert sigma[0] == pytest.approx(groups.mean(axis=1).std(ddof=1) / np.sqrt(40), rel=1e-6)
    assert deviations(np.array([[groups.size / 0.1**2]]), slopes[:1])[0] == pytest.approx(0.1 / np.sqrt(1000))
