"""Episodes step by step are those that evaluation and training count."""

import numpy as np
import pytest

from surefoot.lab.train.sarsa import Schedule, Training
from surefoot.papers.osswald.episode import follow_all
from surefoot.papers.osswald.learner import Learner, paths
from surefoot.services.navigator.environment.episodes import (
    run_episodes,
)
from surefoot.services.navigator.policy.arrays import REACHED, arrays
from surefoot.services.navigator.policy.decider import hand
from surefoot.services.navigator.policy.params import load


@pytest.mark.parametrize("states", [3, 4])
def test_an_episode_is_the_one_that_is_evaluated(states):
    world = arrays(load("paper-blur", (f"filter.states={states}",)))
    policy = hand(world, stand_above=-3.0)
    results, walked = run_episodes(world, policy, 7, 3, 4), follow_all(world, policy, 7, 3, 4)
    for row, e in zip(results, walked, strict=True):
        error = np.hypot(*(e.truth - e.mean)[-1, :2])
        got = e.seconds, REACHED if e.reached else 2, len(e.actions), e.stands.sum(), np.abs(e.turns).sum(), error
        want = row.seconds, row.ended, row.decisions, row.stands, row.turns, row.error
        assert np.array_equal(got[:5], want[:5])
        assert got[5] == pytest.approx(want[5], rel=1e-12)  # hypot and sqrt differ in the last bit
        assert np.diff(e.time).sum() == pytest.approx(0.7 * e.stands.sum() + 1.75 * (~e.stands).sum())
        assert e.truth.shape == e.mean.shape == e.features.shape == (len(e.actions) + 1, 3)
        assert np.allclose(e.cov, e.cov.transpose(0, 2, 1))


def test_features_are_equations_4_to_6():
    world = arrays(load("paper", ("filter.states=3",)))
    (e,) = follow_all(world, hand(world), 1, 0, 1)
    dx, dy = 5.0 - e.mean[:, 0], -e.mean[:, 1]
    phi = np.arctan2(dy, dx) - e.mean[:, 2]
    h = 0.5 * np.log((2 * np.pi * np.e) ** 3 * np.abs(np.linalg.det(e.cov)))
    assert e.features[:, 0] == pytest.approx(np.hypot(dx, dy))
    assert np.exp(1j * e.features[:, 1]) == pytest.approx(np.exp(1j * phi))
    assert (np.abs(e.features[:, 1]) <= np.pi).all()
    assert e.features[:, 2] == pytest.approx(h)


@pytest.mark.parametrize(("accumulate", "mirrored"), [(False, True), (True, False)])
def test_plain_sarsa_leaves_the_table_of_the_kernel_bit_for_bit(accumulate, mirrored):
    schedule = Schedule(episodes=60, accumulate=accumulate, mirrored=mirrored)
    training = Training(load("paper", ("filter.states=3",)), 5, schedule)
    for upto in (0, 1, 40):
        training.advance(upto - training.done)
        learner = Learner(training)
        walked = learner.walk()
        training.advance(1)
        assert training.seconds[training.done - 1] == walked.seconds
        assert np.array_equal(learner.table, training.table)


def test_paths_of_a_training_are_drawn_beside_it():
    model, schedule = load("paper"), Schedule(episodes=40)
    training, other = Training(model, 3, schedule), Training(model, 3, schedule)
    found = paths(training, 10)
    other.advance(40)
    assert np.array_equal(training.table, other.table)
    assert [number for number, _ in found] == [0, 10, 20, 30]
    assert [e.seconds for _, e in found] == [other.seconds[n] for n, _ in found]
