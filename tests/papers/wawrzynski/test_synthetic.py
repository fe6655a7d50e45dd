"""The synthetic walks are what they claim to be."""

import dataclasses

import numpy as np
import pytest

from surefoot.papers.wawrzynski import synthetic
from surefoot.papers.wawrzynski.synthetic import KINDS, WalkParams, synthesize
from surefoot.services.estimator.paper.inertial import propagate

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
    assert set(KINDS) == {"plain", "twist", "turn", "slip", "edges", "false"}
    log = synthesize(dataclasses.replace(KINDS["turn"], duration_s=6.0), 0)
    assert abs(np.arctan2(log.rot[-1, 1, 0], log.rot[-1, 0, 0])) > 0.2


def test_play_and_edges_shift_the_feet_and_leave_the_trunk():
    slip, edges = (synthesize(dataclasses.replace(KINDS[kind], duration_s=8.0), 4) for kind in ("slip", "edges"))
    np.testing.assert_array_equal(slip.v_world, edges.v_world)
    off = np.linalg.norm(slip.foot_position - edges.foot_position, axis=2)
    assert 1e-3 < off.max() < 0.02
    leaned = np.einsum("mfij,mfij->mf", slip.foot_rot, edges.foot_rot)  # 1 + 2 cos of the angle between them
    angle = np.degrees(np.arccos(np.clip((leaned - 1.0) / 2.0, -1.0, 1.0)))
    assert 0.5 < angle.max() < 8.0


def test_the_edge_that_a_foot_rolls_over_stays_where_it_is():
    walk = dataclasses.replace(
        CLEAN, duration_s=8.0, encoders=False, sigma_foot=0.0, edge_deg=(2.0, 2.0), edge_share=1.0
    )
    log = synthesize(walk, 0)
    rows = np.searchsorted(log.stamp_ns, log.foot_ns[:-1])
    exact = [k for k in range(len(rows)) if log.stamp_ns[rows[k]] == log.foot_ns[k]]
    corners = np.array([[-synthetic.ANKLE, 0.0, x] for x in (synthetic.EDGES[0][0], synthetic.EDGES[1][0])])
    sides = np.array([[-synthetic.ANKLE, y, 0.0] for y in (synthetic.EDGES[2][1], synthetic.EDGES[3][1])])
    lowest = []
    for k in exact:
        for f in range(2):
            if log.contact[k, f]:
                seen = log.foot_position[k, f] + np.vstack([corners, sides]) @ log.foot_rot[k, f].T
                lowest.append((log.position[rows[k]] + seen @ log.rot[rows[k]].T)[:, 2].min())
    assert np.abs(lowest).max() < 1e-9


def test_false_contacts_are_as_long_and_as_many_as_said():
    long = dataclasses.replace(KINDS["false"], duration_s=60.0)
    false, true = (synthesize(walk, 0) for walk in (long, dataclasses.replace(long, false_share=0.0)))
    extra = false.contact & ~true.contact
    assert not (true.contact & ~false.contact).any()
    swings = np.sum(np.diff(true.contact.astype(int), axis=0) < 0)
    bursts = np.sum(np.diff(extra.astype(int), axis=0) > 0)
    assert 0.1 < bursts / swings < 0.35
    assert 0.1 < 0.033 * extra.sum() / bursts < 0.16
