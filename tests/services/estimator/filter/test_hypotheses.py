"""Hypotheses about sliding feet: mixtures and weights against closed forms, and what they find on made-up walks."""

from dataclasses import replace

import numpy as np
import pytest

from surefoot.lab.estimation.scores import score
from surefoot.lab.estimation.track import track
from surefoot.papers.wawrzynski.synthetic import KINDS, synthesize
from surefoot.services.estimator.feet.contact import SeenPoints
from surefoot.services.estimator.filter import hypotheses
from surefoot.services.estimator.filter.layout import E, M, P, X
from surefoot.services.estimator.filter.noise import FIXED
from surefoot.services.estimator.filter.point import retract
from surefoot.services.estimator.filter.setting import best_noise
from surefoot.services.estimator.filter.state import fit_in, new_state, rotation, turn_matrix
from surefoot.services.estimator.filter.update import persistence, remember_slides, take_points
from surefoot.services.estimator.params import EstimatorParams
from tests.services.estimator.mounts import OPEN, balls

FOOT = np.arange(2)
NOISE = best_noise(EstimatorParams(), True)
BOTH = np.ones(2)


def standing(seed=0):
    """A biped on both point feet, with four hypotheses that differ at random."""
    rng, state = np.random.default_rng(seed), new_state(2, 4)
    state.x[12:] = rng.normal(size=state.x[12:].shape)
    state.x[X.vel : X.vel + 3] = rng.normal(size=3)
    state.points[:, P.down] = 1.0
    root = rng.normal(size=state.cov.shape) * 1e-2
    state.cov[...] = root @ root.T
    for h in range(4):
        one = hypotheses.mode(state, h)
        fit_in(hypotheses.mode(replace_modes(state), 0), one)
        retract(one, 0.05 * rng.normal(size=len(state.cov)))
        one.cov[...] = state.cov * rng.uniform(0.5, 2.0)
    return state


def replace_modes(state):
    """A state whose first hypothesis is the state itself."""
    out = new_state(2, 4)
    fit_in(state, out)
    for name in ("x", "cov", "points", "turn", "memory"):
        getattr(out, f"mode_{name}")[0] = getattr(state, name)
    return out


def test_the_mean_of_hypotheses_has_the_moments_of_their_mixture():
    state, shares = standing(), np.array([0.2, 0.0, 0.5, 0.3])
    for h in range(4):  # vectors only: means of rotations are no linear combinations
        state.mode_x[h, :9] = np.eye(3).ravel()
    out = new_state(2)
    hypotheses.mean_of(state, shares, out)
    v = state.mode_x[:, X.vel : X.vel + 3]
    mean = shares @ v
    block = slice(E.vel, E.vel + 3)
    cov = sum(
        w * (c[block, block] + np.outer(x - mean, x - mean)) for w, c, x in zip(shares, state.mode_cov, v, strict=True)
    )
    np.testing.assert_allclose(out.x[X.vel : X.vel + 3], mean, atol=1e-12)
    np.testing.assert_allclose(out.x[X.pos : X.pos + 3], shares @ state.mode_x[:, X.pos : X.pos + 3], atol=1e-12)
    np.testing.assert_allclose(out.cov[block, block], cov, atol=1e-12)
    assert np.linalg.eigvalsh(out.cov).min() > 0.0


def test_equal_hypotheses_turned_by_an_angle_meet_in_the_middle():
    state = replace_modes(standing())
    turn = turn_matrix(np.array([0.0, 0.1, 0.2]))
    state.mode_x[1], state.mode_cov[1] = state.mode_x[0], state.mode_cov[0]
    state.mode_points[1] = state.mode_points[0]
    state.mode_x[1, :9] = (turn @ rotation(state.x)).ravel()
    out = new_state(2)
    hypotheses.mean_of(state, np.array([0.5, 0.5, 0.0, 0.0]), out)
    np.testing.assert_allclose(rotation(out.x), turn_matrix(np.array([0.0, 0.05, 0.1])) @ rotation(state.x), atol=1e-9)


def test_weights_are_those_of_bayes_and_the_unlikely_are_left_out():
    state = standing()
    state.weight[:] = 0.4, 0.1, 0.5, 0.0
    likely = np.array([800.0, 801.0, 780.0, 900.0])
    hypotheses.weigh(state, likely)
    want = np.array([0.4, 0.1 * np.e, 0.5 * np.exp(-20.0)])
    assert want[2] < FIXED.least_weight * want.sum()
    np.testing.assert_allclose(state.weight, [*(want[:2] / want[:2].sum()), 0.0, 0.0])


@pytest.mark.parametrize("before", [(1.0, 0.0, 0.0, 0.0), (0.5, 0.3, 0.2, 0.0)])
def test_probabilities_before_a_sample_follow_from_what_may_begin_or_end(before):
    state = standing()
    state.weight[:] = before
    hypotheses.mix(state, BOTH, FOOT, NOISE)
    begin, go_on = NOISE.slip_begin, NOISE.go_on
    slides = [sum(w for h, w in enumerate(before) if (h >> f) & 1) for f in (0, 1)]
    for f in (0, 1):
        found = sum(w for h, w in enumerate(state.weight) if (h >> f) & 1)
        assert found == pytest.approx(go_on * slides[f] + begin * (1.0 - slides[f]), abs=3 * FIXED.least_prior)


def test_a_foot_in_the_air_does_not_slide_and_one_that_lands_may():
    state = standing()
    state.weight[:] = 0.0, 0.0, 0.0, 1.0
    hypotheses.mix(state, np.array([1.0, 0.0]), FOOT, NOISE)
    assert state.weight[2] == state.weight[3] == 0.0
    state = standing()
    state.mode_points[:, 1, P.down] = 0.0
    state.weight[:] = 1.0, 0.0, 0.0, 0.0
    hypotheses.mix(state, BOTH, FOOT, NOISE)
    assert state.weight[2] == pytest.approx(NOISE.slip_landing * (1.0 - NOISE.slip_begin))


def test_what_is_published_keeps_what_belongs_to_the_whole():
    state = standing()
    state.weight[:] = 0.6, 0.4, 0.0, 0.0
    state.memory[M.rest] = 7.0
    hypotheses.publish_mean(state, FOOT)
    assert state.memory[M.rest] == 7.0
    assert state.points[:, P.seen].tolist() == [0.4, 0.0]
    assert hypotheses.likeliest(state) == 0
    hypotheses.collapse(state, FOOT)
    assert hypotheses.likeliest(state) == -1


def test_robots_with_more_feet_carry_none():
    assert [hypotheses.modes_of(feet) for feet in (1, 2, 3, 4, 6)] == [2, 4, 0, 0, 0]


def test_sliding_feet_are_found_and_cost_less():
    """Half of the stances slide by 9 mm: the hypotheses know which, and the velocity errs by less than without them."""
    walk = replace(KINDS["slip"], duration_s=8.0, slip=(0.009, 0.009), slip_share=(0.5, 0.5))
    errors, right = [], []
    for seed in (3, 4):
        log = synthesize(walk, seed)
        found = track("best", log)
        errors.append(score(log, found).rmse / score(log, track("best", log, hypotheses=False)).rmse)
        true = synthesize(replace(walk, slip=(0.0, 0.0)), seed)  # the same walk without slides
        shift = np.linalg.norm(log.foot_position - true.foot_position, axis=-1)
        rows = np.clip(np.searchsorted(log.stamp_ns, log.foot_ns), 0, len(log.stamp_ns) - 1)
        seen = found.slipping[rows]
        sliding = log.contact & (np.gradient(shift, 0.033, axis=0) > 0.01)
        still = log.contact & (shift < 1e-3)
        right.append((np.nanmean(seen[sliding]), np.nanmean(seen[still])))
    assert np.mean(errors) < 0.6
    slides, stays = np.mean(right, axis=0)
    assert slides > 0.5 > 2.0 * stays


def two_points():
    """A state of two standing feet, and where they are."""
    state = new_state(2, 4)
    state.points[:, P.down] = 1.0
    state.cov[...] = 1e-8 * np.eye(len(state.cov))
    place = np.array([[0.0, 0.1, -0.3], [0.0, -0.1, -0.3]])
    state.x[21:] = place.ravel()
    return state, place


def show(state, y, slides):
    """Let the filter see the feet at y, `slides` those that slide, 33 ms after the last sample."""
    state.memory[M.since] = 0.033
    seen = SeenPoints(y, np.tile(np.eye(3), (2, 1, 1)), BOTH, OPEN)
    take_points(state, seen, balls(2), NOISE, False, slides, 1.0)


def test_the_velocity_of_a_slide_is_learned_unless_all_feet_slide():
    for slides, learns in ((1, True), (3, False)):
        state, place = two_points()
        for step in range(1, 30):
            show(state, place + np.outer([1.0, 0.0], [0.02 * 0.033 * step, 0.0, 0.0]), slides)
        assert (state.points[0, P.along] == pytest.approx(0.02, rel=0.2)) == learns
        assert state.points[1, P.along] == 0.0


@pytest.mark.parametrize(("way", "goes_on"), [(lambda k: k, True), (lambda k: (k // 3) % 2, False)])
def test_a_slide_is_expected_to_go_on_where_slides_do(way, goes_on):
    """A foot that is pushed along, and one that rocks to and fro: m.s over s.s, by an independent sum."""
    state, place = two_points()
    whole, product, square = new_state(2, 4), 0.0, 0.0
    whole.weight[1] = 0.5
    assert persistence(whole.memory) == 1.0
    for step in range(1, 60):
        learned, start = state.points[0, P.along : P.along + 2].copy(), state.x[21:23].copy()
        show(state, place + np.outer([1.0, 0.0], [0.001 * way(step), 0.0, 0.0]), 1)
        seen = (state.x[21:23] - start) / 0.033
        keep = FIXED.slide_memory
        product, square = keep * product + 0.5 * seen @ learned, keep * square + 0.5 * learned @ learned
        whole.mode_memory[1] = state.memory
        remember_slides(whole)
        np.testing.assert_allclose(
            whole.memory[[M.slide_product, M.slide_square]], (product, square), rtol=1e-9, atol=1e-15
        )
    assert (persistence(whole.memory) > 0.9) == goes_on
    assert (persistence(whole.memory) == 0.0) == (not goes_on)
