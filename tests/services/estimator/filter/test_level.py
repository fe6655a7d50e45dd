"""Levels of the ground: the correction against dense algebra, floors, stairs, rough ground and slopes."""

from dataclasses import replace

import numpy as np
import pytest

from surefoot.lab.estimation.scores import score
from surefoot.lab.estimation.track import track
from surefoot.papers.wawrzynski.synthetic import KINDS, synthesize
from surefoot.services.estimator.filter.ground import forget_levels
from surefoot.services.estimator.filter.layout import LEVEL, LEVELS, E, M, P, X
from surefoot.services.estimator.filter.level import stand_on_levels
from surefoot.services.estimator.filter.noise import FIXED
from surefoot.services.estimator.filter.point import lift, put_down
from surefoot.services.estimator.filter.setting import best_limits, best_noise
from surefoot.services.estimator.filter.state import new_state
from surefoot.services.estimator.params import EstimatorParams, StartPose
from tests.services.estimator.mounts import balls

FEET, HIGH, ADVANCE, DRIFT = 4, 0.3, 0.05, 1e-3
NOISE = best_noise(EstimatorParams())
PLACES = np.array([[0.2, 0.1], [0.2, -0.1], [-0.2, 0.1], [-0.2, -0.1]])


def known(state):
    """Heights of the levels that the state knows, m, in order."""
    table = state.memory[M.levels : M.levels + LEVEL * LEVELS].reshape(LEVELS, LEVEL)
    return sorted(table[table[:, 1] > 0.0, 0].tolist())


def walk(ground, steps=60):
    """Walk along x with the four feet in turn over ground(x) m high, while the height drifts by 1 mm each step.

    Returns:
        The state, and by how much its height is wrong, m.
    """
    state = new_state(FEET)
    state.cov[...] = 0.0
    for i in (E.rot, E.rot + 1, E.pos + 2):
        state.cov[i, i] = 1e-6
    state.x[X.pos + 2] = HIGH
    forget_levels(state.memory)
    under, trunk, x = np.zeros(FEET), 0.0, 0.0
    for n in range(steps):
        foot, x = n % FEET, x + ADVANCE
        state.memory[M.age] += 0.2
        under[foot] = ground(x + PLACES[foot, 0])
        rise = np.mean(under) - trunk  # the trunk follows the ground, and the feet that stand fall behind
        trunk += rise
        state.x[X.pos + 2] += rise + DRIFT
        state.cov[E.pos + 2, E.pos + 2] += (2.0 * DRIFT) ** 2
        for k in range(FEET):
            state.x[X.points + 3 * k] -= ADVANCE
            state.x[X.points + 3 * k + 2] -= rise
        lift(state, foot)
        put_down(state, foot, np.array([*PLACES[foot], under[foot] - trunk - HIGH]), NOISE)
        state.points[foot, P.new] = 0.0
        stand_on_levels(state, balls(FEET), 0.1, 5.0)
    return state, state.x[X.pos + 2] - HIGH - trunk


def test_a_step_on_a_level_is_a_kalman_update_of_what_has_drifted_since():
    rng, level = np.random.default_rng(0), 0.0
    state = new_state(FEET)
    root = 0.003 * rng.normal(size=state.cov.shape)
    state.cov[...] = root @ root.T
    forget_levels(state.memory)
    state.x[X.pos + 2] = HIGH
    put_down(state, 0, np.array([*PLACES[0], -HIGH + 0.004]), NOISE)
    state.points[0, P.new], state.points[0, P.stood] = 0.0, 1.0
    h = np.zeros(len(state.cov))
    h[E.pos + 2] = h[E.points + 2] = 1.0
    h[E.rot], h[E.rot + 1] = PLACES[0, 1], -PLACES[0, 0]  # xi_R x r
    before, cov = state.x.copy(), state.cov.copy()
    variance = h @ cov @ h
    state.memory[M.levels : M.levels + LEVEL] = level, 0.4 * variance, 1.0, 0.0
    noise = (FIXED.step_sd**2 + state.memory[M.uneven]) ** 2 / FIXED.step_sd**2
    stand_on_levels(state, balls(FEET), 0.0, 5.0)
    drift = 0.6 * variance
    share = drift / (drift + noise)
    r = variance * noise / drift
    gain = cov @ h / (variance + r)
    expected = cov - np.outer(gain, h @ cov)
    expected[E.pos + 2, E.pos + 2] += share * 0.4 * variance
    np.testing.assert_allclose(state.cov, expected, atol=1e-12)
    assert h @ state.cov @ h == pytest.approx(0.4 * variance + drift * noise / (drift + noise))
    moved = state.x[X.pos : X.pos + 3] - before[X.pos : X.pos + 3]
    np.testing.assert_allclose(moved, -0.004 * gain[E.pos : E.pos + 3], atol=1e-9)


@pytest.mark.parametrize("stair", [0.0, 0.12, 0.17])
def test_the_height_does_not_drift_on_floors_and_stairs(stair):
    """Up three stairs of 0.5 m length, each stood on by all feet before the next but one."""
    state, wrong = walk(lambda x: stair * min(max((x - 1.0) // 0.5, 0.0), 3.0))
    assert abs(wrong) < 0.015 < 0.5 * 60 * DRIFT
    assert np.allclose(known(state), [stair * i for i in range(4 if stair else 1)], atol=0.02)
    assert state.cov[E.pos + 2, E.pos + 2] < 0.3 * 60 * (2.0 * DRIFT) ** 2


@pytest.mark.parametrize("seed", range(3))
def test_rough_ground_and_slopes_correct_little(seed):
    """A rough ground is level on average; its 3 cm show little of a drift of 1 mm each step, and a slope nothing."""
    rng = np.random.default_rng(seed)
    _, wrong = walk(lambda x: rng.uniform(-0.03, 0.03))
    assert 0.6 < wrong / (60 * DRIFT) < 1.2
    _, wrong = walk(lambda x: (seed - 0.5) * 0.2 * x)
    assert wrong / (60 * DRIFT) == pytest.approx(1.0, abs=0.15)


@pytest.mark.parametrize("feet", [2, 4, 6])
def test_a_walk_on_a_floor_keeps_its_height(feet):
    kind = KINDS["edges"] if feet == 2 else replace(KINDS["slip"], feet=feet, encoders=False)
    log = synthesize(kind, 1)
    level, plain = (score(log, track("best", log, levels=levels)) for levels in (True, False))
    assert level.height < 0.95 * plain.height
    assert level.tilt_deg < 1.05 * plain.tilt_deg
    assert level.smooth < 1.02 * plain.smooth


def test_ground_that_is_stated_to_be_level_needs_no_levels():
    stated = replace(EstimatorParams(), level_ground=True)
    assert not best_limits(stated, StartPose(), True).levels
    assert best_limits(stated, StartPose(), False).levels
    assert not best_limits(replace(stated, levels=False), StartPose(), False).levels
