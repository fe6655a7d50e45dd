"""Transfer of a fit to live runs: errors, ranking, failed runs."""

import pytest

from benchmarks import goals as bench
from benchmarks.goals import Compared, compare, wrong_pairs
from surefoot.services.navigator.policy.params import load


def line(arm, seed, time, problems=()):
    return {"arm": arm, "world": "hard", "seed": seed, "problems": list(problems), "values": {"goal_time_s": time}}


def row(arm, times, predicted):
    return Compared(arm, dict(enumerate(times)), 0, predicted, 1.0)


def test_an_error_is_relative_to_the_live_mean():
    assert row("hand", (90.0, 110.0), 103.0).error == pytest.approx(3.0)


def test_pairs_that_live_runs_tell_apart_must_keep_their_order():
    slow, fast = row("hand", (120.0, 130.0, 110.0), 118.0), row("planner", (100.0, 109.0, 91.0), 101.0)
    assert wrong_pairs([slow, fast]) == ([], 1)
    turned = row("planner", (100.0, 109.0, 91.0), 119.0)
    assert wrong_pairs([slow, turned]) == ([("hand", "planner")], 1)


def test_pairs_that_live_runs_do_not_tell_apart_do_not_count():
    rows = [row("hand", (100.0, 130.0, 110.0), 118.0), row("tuned", (120.0, 100.0, 115.0), 125.0)]
    assert wrong_pairs(rows) == ([], 0)


def test_pairs_are_compared_over_the_same_seeds():
    a = Compared("hand", {1: 100.0, 2: 110.0, 3: 999.0}, 0, 90.0, 1.0)
    b = Compared("tuned", {1: 101.0, 2: 111.1, 4: 1.0}, 0, 91.0, 1.0)
    assert wrong_pairs([a, b]) == ([], 1)


def test_failed_runs_are_counted_and_not_averaged(monkeypatch):
    monkeypatch.setattr(bench, "predicted", lambda *_: {"mean_s": 99.0, "success": 1.0})
    lines = [line("hand", 1, 100.0), line("hand", 2, 104.0), line("hand", 3, None), line("hand", 4, 50.0, ["fell"])]
    base = load("nao-paper")
    (hand,) = compare([*lines, line("planner", 1, 90.0)], base, base, 10)  # one run of a policy is too few
    assert (hand.arm, hand.live, hand.failed) == ("hand", 102.0, 2)
    assert hand.predicted == pytest.approx(99.0 + base.switching["walk"]["stand"])
