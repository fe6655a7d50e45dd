"""The paper mode of the service against an oracle that shares no code with it, over 10 000 steps."""

from dataclasses import replace

import numpy as np
import pytest

from surefoot.lab.estimation.track import track
from surefoot.papers.wawrzynski import chain as legs
from surefoot.papers.wawrzynski.synthetic import KINDS, bioloid_chains, synthesize
from surefoot.services.estimator.params import EstimatorParams
from tests.papers.wawrzynski import oracle

STEPS = 10_000
LETTER = {"remove_gyro_bias": False, "refine_gyro_bias": False}


@pytest.fixture(scope="module")
def walk():
    kind = replace(KINDS["turn"], duration_s=0.01 * STEPS + 0.6, rest_s=1.0, gyro_bias=0.0, encoders=False)
    return synthesize(kind, 3)


@pytest.fixture(scope="module")
def ours(walk):
    return track("paper", walk, **LETTER)


def by_oracle(log, start):
    p, sensors = EstimatorParams(), log.sensors
    sigmas = (sensors["sigma_w"], sensors["sigma_q"], p.sigma_v)
    return oracle.run(log, start, p.standstill_samples, *sigmas, p.prior_g, p.prior_v)


def test_paper_mode_is_the_oracle(walk, ours):
    start = int(np.argmax(ours.flags["initialised"]))
    v, g, cov = by_oracle(walk, start)
    assert len(v) >= STEPS
    assert not ours.refused
    np.testing.assert_allclose(ours.v[start:], v, rtol=0.0, atol=1e-9)
    np.testing.assert_allclose(ours.g[start:], g, rtol=0.0, atol=1e-9)
    np.testing.assert_allclose(ours.p[start:, 3:], cov[:, 3:], rtol=0.0, atol=1e-9)
    assert np.abs(v).max() > 0.05  # it moved
    assert np.abs(np.diff(v, axis=0)).max() > 1e-3  # and was corrected


def test_another_rule_for_the_supporting_foot_would_be_seen(walk, ours, monkeypatch):
    start = int(np.argmax(ours.flags["initialised"]))
    monkeypatch.setattr(oracle, "one_foot", lambda before, now, standing: 0 if before[0] and now[0] else -1)
    short = replace(walk, stamp_ns=walk.stamp_ns[:1500], w=walk.w[:1500], q=walk.q[:1500])
    v, _, _ = by_oracle(short, start)
    assert np.abs(ours.v[start:1500] - v).max() > 1e-4


def test_the_sign_of_the_jacobian_is_harmless():
    """(26) as printed: C enters P only as C C^T, whose both rows flip."""
    one = oracle.Oracle([0.3, 0.2, 9.8], 50, 0.005, 0.03, 0.015, 0.02, 0.01)
    other = oracle.Oracle([0.3, 0.2, 9.8], 50, 0.005, 0.03, 0.015, 0.02, 0.01)
    one.v = other.v = np.array([0.1, -0.2, 0.05])
    w, q = np.array([0.3, -0.1, 0.2]), np.array([0.1, 0.4, 9.9])
    one.predict(w, q, 0.01)
    right = oracle.jacobian
    try:
        oracle.jacobian = lambda x: -right(x)
        other.predict(w, q, 0.01)
    finally:
        oracle.jacobian = right
    np.testing.assert_allclose(one.P[:3, :3], other.P[:3, :3], atol=1e-18)
    np.testing.assert_allclose(one.P, other.P, atol=1e-18)


def test_differences_of_feet_are_the_equations_5_to_14():
    """-(p_1 - p_0)/D - w x p of the ankle = (5)-(14) with joint rates, in the limit of small D."""
    chain, rng = bioloid_chains()[0], np.random.default_rng(1)
    for _ in range(20):
        theta, rate, w = 0.3 * rng.normal(size=6), rng.normal(size=6), 0.5 * rng.normal(size=3)
        d = 1e-5
        feet = [legs.foot_pose(legs.descend(chain, theta + s * d / 2 * rate, rate, w))[0] for s in (-1.0, 1.0)]
        by_feet = -(feet[1] - feet[0]) / d - np.cross(w, (feet[0] + feet[1]) / 2)
        state = legs.descend(chain, theta, rate, w)
        np.testing.assert_allclose(by_feet, legs.velocity_kinematics_gyro(state, np.zeros(3)), atol=1e-8)
