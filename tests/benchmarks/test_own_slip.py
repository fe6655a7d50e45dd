"""Slip measured in a walk beside the truth, and a short walk whose outcomes are learned from."""

import math

import pytest

from benchmarks.own_slip import SlipFollower, closed, explored, rms, rough, squared_errors, start
from surefoot.lab.footholds.walks import JoinedWalk, Setting
from surefoot.services.footholds.learning.fit import Candidate
from surefoot.services.footholds.learning.relearn import relearned
from surefoot.services.footholds.models.files import load, shipped
from tests.services.footholds.learning.made import samples, spoiled


def test_a_walk_on_flat_ground_slips_little_and_the_robot_knows() -> None:
    joined = JoinedWalk(3, Setting("flat", 0.12, profile="exact"), None)
    follower = SlipFollower(joined)
    while joined.tick():
        follower.look()
    assert len(follower.found) >= 12
    assert {each.leg for each in follower.found} == set(range(6))
    assert max(each.own for each in follower.found) < 0.003
    assert rms([each.own - each.inside for each in follower.found]) < 0.001
    assert all(0.0 <= each.inside <= each.whole for each in follower.found)
    total = sum(each.whole for each in follower.found)
    assert total == pytest.approx(sum(joined.stances.sliding), rel=0.5)
    assert rms([3.0, 4.0]) == pytest.approx(3.5355339)


def test_the_first_model_closes_nothing_and_that_of_all_data_everything() -> None:
    begin = start(samples(800, noise=0.1), Candidate(12, 0.3, 1e-6))
    assert closed(begin.first, begin) == (0.0, 1.0)
    assert closed(begin.full, begin)[0] == 1.0
    assert {each.trial for each in begin.held.kept}.isdisjoint(line.split()[-1] for line in begin.full.provenance)
    new = [spoiled(each, trial=f"n{each.trial}") for each in samples(400, seed=9, noise=0.1)]
    share, old = closed(relearned(begin.first, new), begin)
    assert 0.8 < share < 1.2
    assert old > 0.0
    assert all(value > 0.0 for value in squared_errors(begin.first, begin.held))


def test_outcomes_of_an_exploring_walk_are_those_of_its_own_choices() -> None:
    model = load(shipped("ragno") or "")
    own, true = explored(1, Setting("rough", 0.12, 0.04, 0.5, profile="exact"), model, 0.5)
    assert len(own) == len(true) >= 6
    for a, b in zip(own, true, strict=True):
        assert (a.trial, a.leg, a.step, a.k1, a.k2, a.k4) == (b.trial, b.leg, b.step, b.k1, b.k2, b.k4)
        assert a.problem == b.problem
        assert math.isnan(a.friction)
    sound = [one for one in own if not one.problem]
    assert len(sound) >= 6
    assert all(0.0 < one.length < 0.06 for one in sound)
    assert relearned(model, own).name.endswith("+1")
    assert sum(map(rough, own)) < len(own)
