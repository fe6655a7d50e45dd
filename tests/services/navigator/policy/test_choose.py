"""Decisions: the rules of the hand controllers, guards of all policies, and when a look pays."""

import math
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from surefoot.services.navigator.policy.arrays import TURNING, arrays
from surefoot.services.navigator.policy.decider import Decider, hand
from surefoot.services.navigator.policy.library import find
from surefoot.services.navigator.policy.params import load
from surefoot.services.navigator.policy.planner import planner

GOAL = (5.0, 0.0)
SURE = np.diag([1e-4, 1e-4, 1e-4, 1e-3])


def belief(x=0.0, y=0.0, deg=0.0, drift=0.0):
    return np.array([x, y, math.radians(deg), drift])


@pytest.fixture(scope="module")
def world():
    return arrays(load("paper"))


@pytest.fixture(scope="module")
def blurred():
    return arrays(load("paper-blur"))


@pytest.fixture(scope="module")
def arcs():
    return arrays(load("paper", ["use='arcs'"]))


@cache
def policy_of(name, params="paper"):
    """Policy of a model without changes; the planner of one takes a second."""
    return find(name, load(params))


@cache
def blurred_planner():
    return planner(arrays(load("paper-blur")))


def name_of(decider, *args, blocked=False):
    return decider.decide(*args, GOAL, blocked=blocked).action


def test_the_hand_controller_follows_its_three_rules(world):
    d = Decider(world, policy_of("hand"))
    assert name_of(d, belief(), SURE) == "walk"
    assert name_of(d, belief(deg=-34), SURE) == "walk"
    assert name_of(d, belief(deg=-36), SURE) == "left"
    assert name_of(d, belief(deg=36), SURE) == "right"
    assert name_of(d, belief(deg=179), SURE) == "right"
    assert name_of(d, belief(deg=36), np.diag([0.5, 0.5, 0.5, 1.0])) == "stand"


def test_steering_takes_the_arc_that_leaves_least(arcs):
    d = Decider(arcs, find("steer", load("paper", ["use='arcs'"])))
    for deg, want in ((0, "walk"), (-12, "arc_left_11"), (12, "arc_right_11"), (-22, "arc_left_23"), (-70, "left")):
        assert name_of(d, belief(deg=deg), SURE) == want
    assert name_of(d, belief(drift=math.radians(115)), SURE) == "arc_right_11"  # what 10 cm will turn it left


def test_only_turns_are_allowed_while_blocked_and_a_turn_goes_on(world):
    for name in ("hand", "tuned", "planner"):
        d = Decider(world, policy_of(name))
        first = d.decide(belief(deg=5), SURE, GOAL, blocked=True)
        turns = [name for name, action in zip(world.names, world.tables.actions, strict=True) if action.kind == TURNING]
        assert first.action in turns
        assert list(first.values) == turns
        again = d.decide(belief(deg=-40), SURE, GOAL, blocked=True)
        assert again.action == first.action


def test_stands_and_turns_in_a_row_are_capped(world):
    unsure = np.diag([0.5, 0.5, 0.5, 1.0])
    d = Decider(world, hand(world))
    made = [name_of(d, belief(), unsure) for _ in range(17)]
    assert (made[:15], made[15]) == (["stand"] * 15, "walk")
    assert d.status.stands == 1
    d.begin()
    d.status.turns = 16
    assert name_of(d, belief(deg=90), SURE) == "walk"


def test_a_belief_inside_the_goal_does_not_turn_for_ever(blurred):
    """The belief has arrived, the robot has not: within a bounded number of decisions something else is tried."""
    for name in ("hand", "tuned", "planner"):
        d = Decider(blurred, policy_of(name, "paper-blur"))
        made = [name_of(d, belief(x=4.97, deg=170), SURE) for _ in range(20)]
        assert set(made) - {"left", "right"}


def test_the_planner_stands_where_a_look_can_change_the_way_and_never_when_sure(blurred):
    policy = blurred_planner()
    d = Decider(blurred, policy)
    unsure = np.diag([0.15**2, 0.25**2, math.radians(20) ** 2, 0.3**2])
    assert name_of(d, belief(x=4.3, deg=30), unsure) == "stand"
    d.begin()
    assert name_of(d, belief(x=4.3, deg=0), SURE) == "walk"
    blind = replace(policy, tables=policy.tables._replace(shown=np.eye(3) * 1e4))
    assert name_of(Decider(blurred, blind), belief(x=4.3, deg=30), unsure) != "stand"


def test_what_a_look_gains_is_never_negative(blurred):
    """The gain is a mean of maxima less a maximum of means, so a stand costs its seconds at most."""
    policy, rng = blurred_planner(), np.random.default_rng(2)
    for _ in range(100):
        a = rng.normal(size=(4, 4)) * [0.1, 0.1, 0.2, 0.4]
        mean = belief(*rng.uniform([-0.5, -0.8], [4.8, 0.8]), rng.uniform(-180, 180), rng.normal())
        values = Decider(blurred, policy).decide(mean, a.T @ a + SURE, GOAL, blocked=False).values
        assert values.pop("stand") >= max(values.values()) - 0.7 - 1e-9


def test_switching_costs_make_a_look_dearer(blurred):
    costly = arrays(load("paper-blur", ["switching.walk.stand=0.9", "switching.stand.walk=1.0"]))
    mean, cov = belief(x=4.3, deg=30), np.diag([0.15**2, 0.25**2, math.radians(20) ** 2, 0.3**2])
    cheap, dear = Decider(blurred, blurred_planner()), Decider(costly, planner(costly))
    for d in (cheap, dear):
        d.did(0)
    value = [d.decide(mean, cov, GOAL, blocked=False).values for d in (cheap, dear)]
    gain = [each.pop("stand") - max(each.values()) for each in value]
    assert gain[1] < gain[0]


def test_every_policy_gives_reasons_in_words(world):
    for name in ("hand", "tuned", "steer", "planner"):
        verdict = Decider(world, policy_of(name)).decide(belief(deg=50), SURE, GOAL, blocked=False)
        assert verdict.action in verdict.reason
        assert tuple(verdict.values) == world.names


def test_a_goal_far_beyond_the_table_keeps_its_estimated_time(world):
    d = Decider(world, policy_of("planner"))
    far = d.decide(belief(x=-15), SURE, GOAL, blocked=False).values
    near = d.decide(belief(x=-5), SURE, GOAL, blocked=False).values
    assert max(near.values()) - max(far.values()) == pytest.approx(175.0, rel=1e-6)
