"""Statements of the text of section VI, measured on episodes made for it, and on the kernels."""

import math

import numpy as np
import pytest

from surefoot.lab.statistics import welch
from surefoot.papers.osswald import measures
from surefoot.papers.osswald.episode import Episode, drift_of, follow_all
from surefoot.services.navigator.environment.draws import seed
from surefoot.services.navigator.environment.model import CELL, episode_room, episode_state, squares
from surefoot.services.navigator.environment.world import look
from surefoot.services.navigator.policy.arrays import arrays
from surefoot.services.navigator.policy.decider import hand
from surefoot.services.navigator.policy.params import load


def made(stands=(), turns=(), drift=1.0, d=None, h=None) -> Episode:
    """An episode of which only these parts are looked at; each action takes 1 s."""
    k = max(len(stands), len(turns))
    stands = np.array(stands if len(stands) else np.zeros(k), dtype=bool)
    turns = np.array(turns if len(turns) else np.zeros(k), dtype=np.int64)
    features = np.zeros((k + 1, 3))
    features[:, 0] = np.linspace(5.0, 0.0, k + 1) if d is None else d
    features[:, 2] = 0.0 if h is None else h
    return Episode(
        np.arange(k + 1.0), np.zeros((k + 1, 3)), np.zeros((k + 1, 3)), np.zeros((k + 1, 3, 3)), features,
        np.zeros(k + 1, dtype=bool), np.zeros(k, dtype=np.int64), stands, turns, drift, np.zeros((0, 2)), True,
    )  # fmt: skip


def test_a_training_has_converged_when_it_stays_at_its_last_level():
    steady = np.concatenate((np.full(300, 700.0), np.full(1200, 110.0)))
    assert measures.moving_mean(steady, 3)[:2] == pytest.approx([700.0, 700.0])
    assert 295 <= measures.converged(steady) <= 300
    upset = steady.copy()
    upset[1300:1350] = 140.0
    assert 1300 <= measures.converged(upset) <= 1350
    assert measures.first_near_the_end(upset) == pytest.approx(measures.converged(steady), abs=2)
    assert measures.converged(np.full(1500, 110.0)) == 0
    assert measures.converged(np.linspace(700.0, 100.0, 1500)) > 1000


def test_stands_in_a_row_are_one_stop():
    e = made(stands=[1, 1, 0, 0, 1, 0, 0, 1, 1, 1])
    assert measures.stops(e).tolist() == [0, 4, 7]
    assert measures.spread_of_intervals([e]) == pytest.approx(0.5 / 3.5)
    assert measures.spread_of_intervals([made(stands=[1, 0, 0] * 5)]) == 0.0
    assert math.isnan(measures.spread_of_intervals([made(stands=[0, 0, 0])]))


def test_stands_and_entropy_far_from_the_goal_and_near_it():
    e = made(stands=[1, 0, 0, 0, 1, 1], d=[5, 4, 3, 2, 0.5, 0.4, 0.1], h=[-1, -2, -3, 0, -5, -7, 0])
    assert measures.stand_rates([e]) == pytest.approx((1 / 3, 1.0))
    assert measures.entropy_by_distance([e]) == pytest.approx((-2.0, -6.0))


def test_turns_are_set_against_the_drift_and_against_each_other():
    assert measures.turns_against_drift([made(turns=[-1, 0, -1, 1, -1], drift=0.3)]) == 0.75
    assert measures.turns_against_drift([made(turns=[-1, 0, -1, 1, -1], drift=-0.3)]) == 0.25
    assert measures.reversals(made(turns=[1, -1, 1, 0, -1, 0, 0, 1])) == 3
    assert measures.reversals(made(turns=[1, 1, 1])) == 0


def test_the_typical_episode_is_neither_short_nor_long():
    assert measures.typical([made(stands=[0] * n) for n in (3, 50, 54, 58, 99)]).seconds == 54


def test_t_tests():
    rng = np.random.default_rng(0)
    a, b = rng.normal(100, 10, 60), rng.normal(110, 5, 40)
    p = welch(a, b)
    se = math.sqrt(a.var(ddof=1) / 60 + b.var(ddof=1) / 40)
    assert p < 1e-4
    mean, low, high = measures.difference(a, b)
    assert low < mean < high
    assert mean == pytest.approx(100 * (a.mean() - b.mean()) / b.mean())
    assert (high - low) / 2 == pytest.approx(100 * 2.0 * se / b.mean(), rel=0.02)
    n = b.size
    same = welch(a[:n], b)
    assert measures.welch_of(a[:n].mean(), a[:n].std(ddof=1), b.mean(), b.std(ddof=1), n) == pytest.approx(same)


@pytest.mark.parametrize("params", ["paper", "paper-blur"])
def test_expected_matches_are_those_of_the_kernel_on_average(params):
    world = arrays(load(params, ("filter.states=3",)))
    walks = follow_all(world, hand(world), 5, 0, 3)
    counts, state, room = [], episode_state(world), episode_room(3)
    nx, ny = squares(world.tables.scene[0])
    for e in walks:
        square = ((e.marks - (world.tables.scene[0].x_min, world.tables.scene[0].y_min)) // CELL).astype(int) @ [ny, 1]
        state = state._replace(marks=e.marks, first=np.searchsorted(square, np.arange(nx * ny + 1)))
        for i, (pose, index) in enumerate(zip(e.truth[1:], e.actions, strict=True)):
            if e.stands[i]:
                continue
            for again in range(20):
                seed(state.rng, 77, i, again)
                state.truth[:3], state.mean[:], state.cov[:] = pose, e.mean[i], e.cov[i]
                counts.append(look(world.tables.scene[0], world.tables.actions[index], state, room))
    assert len(counts) > 2000
    assert measures.matches_expected(world, walks) == pytest.approx(
        np.mean(counts), abs=5 * np.std(counts) / len(counts) ** 0.5
    )


def test_the_drift_of_an_episode_is_known_beforehand():
    world = arrays(load("paper"))
    drifts = [drift_of(world, e, 3) for e in range(8)]
    assert drifts == [e.drift for e in follow_all(world, hand(world), 3, 0, 8)]
    assert len(set(drifts)) == 2
    assert sum(set(drifts)) == 0.0
