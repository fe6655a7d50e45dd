"""The synthetic walks are what they claim to be."""

import dataclasses

import numpy as np
import pytest

from surefoot.lab.papers.wawrzynski import synthetic
from surefoot.lab.papers.wawrzynski.synthetic import KINDS, WalkParams, synthesize
from surefoot.services.estimator.inertial import propagate

CLEAN = WalkParams(duration_s=5.0, sigma_w=0.0, sigma_q=0.0, gyro_bias=0.0, acc_bias=0.0)


def test_same_seed_same_walk():
    a, b, c = (synthesize(WalkParams(duration_s=2.5), seed) for seed in (3, 3, 4))
    np.testing.assert_array_equal(a.w, b.w)
    np.testing.assert_array_equal(a.feet[5].position, b.feet[5].position)
    assert np.abs(a.w - c.w).max() > 0.0


def test_perfect_sensors_integrate_to_the_truth():
    log = synthesize(CLEAN, 0)
    g, v = log.up[0].copy(), log.v[0].copy()
    for k in range(1, len(log.w)):
        g, v = propagate(g, v, log.w[k], log.q[k], 0.01)
    np.testing.assert_allclose(g, log.up[-1], atol=5e-3)
    np.testing.assert_allclose(v, log.v[-1], atol=2e-2)


def test_stance_feet_stand_and_switches_tell():
    log = synthesize(dataclasses.replace(CLEAN, encoders=False, sigma_foot=0.0), 1)
    rows = np.searchsorted(log.stamp_ns, [s.stamp_ns for s in log.feet[:-1]])
    exact = [k for k, s in enumerate(log.feet[:-1]) if log.stamp_ns[rows[k]] == s.stamp_ns]  # every 330 ms
    world = np.array([log.position[rows[k]] + log.feet[k].position @ log.rot[rows[k]].T for k in exact])
    down = np.array([log.feet[k].contact for k in exact])
    assert down.any(axis=1).all()
    for f in range(2):
        both = down[1:, f] & down[:-1, f]
        step = np.linalg.norm(np.diff(world[:, f], axis=0), axis=1)
        assert np.abs(world[down[:, f], f, 2] - synthetic.ANKLE).max() < 1e-9
        assert np.median(step[both]) < 1e-9


def test_encoders_are_rounded_to_their_step():
    log, exact = (synthesize(dataclasses.replace(CLEAN, encoders=e, sigma_foot=0.0), 2) for e in (True, False))
    error = np.array([a.position - b.position for a, b in zip(log.feet, exact.feet, strict=True)])
    assert 1e-5 < np.abs(error).max() < 5e-3


@pytest.mark.parametrize("feet", range(2, 9))
def test_any_number_of_feet(feet):
    log = synthesize(dataclasses.replace(CLEAN, feet=feet, encoders=False, duration_s=3.5), 0)
    assert log.feet[0].position.shape == (feet, 3)
    lifted = ~np.array([s.contact for s in log.feet]).all(axis=0)
    assert lifted.all()


def test_kinds_differ_as_they_should():
    assert set(KINDS) == {"plain", "twist", "turn", "slip"}
    log = synthesize(dataclasses.replace(KINDS["turn"], duration_s=6.0), 0)
    assert abs(np.arctan2(log.rot[-1, 1, 0], log.rot[-1, 0, 0])) > 0.2
