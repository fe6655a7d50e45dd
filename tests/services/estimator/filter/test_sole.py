"""Soles that give way, and that rock about the edge or the corner on which they stand, against closed forms."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from surefoot.services.estimator.feet.contact import SeenPoints, at_switches, points_of, sole_feet, touch_rows
from surefoot.services.estimator.feet.mount import FootMount
from surefoot.services.estimator.filter.layout import E, P, X
from surefoot.services.estimator.filter.setting import best_noise
from surefoot.services.estimator.filter.sole import rock_soles, turn_soles
from surefoot.services.estimator.filter.state import Felt, new_state, predict
from surefoot.services.estimator.filter.update import take_points
from surefoot.services.estimator.inputs.results import InputResult
from surefoot.services.estimator.params import EstimatorParams
from surefoot.services.estimator.stream import Estimator
from tests.services.estimator.mounts import mounted

UP = np.array([[0.0, 0.0, 1.0]] * 2)
CORNERS = np.array([[0.05, 0.03, 0.0], [0.05, -0.03, 0.0], [-0.05, 0.03, 0.0], [-0.05, -0.03, 0.0]])
HEEL, ALL = 0b1100, 0b1111  # the last two corners, all four
FEET = mounted(sole_feet(UP, 0.1, np.stack([CORNERS, CORNERS])))
NOISE = best_noise(EstimatorParams(), True)
G = np.array([0.0, 0.0, 9.81])


@pytest.mark.parametrize("seed", range(3))
def test_a_sole_that_gives_way_moves_its_points_about_its_middle(seed):
    """About its long and its short axis and its normal, each by its own rate; one point alone turns about itself."""
    rng, dt = np.random.default_rng(seed), 0.03
    state, _ = standing(ALL, seed)
    state.x[X.points :] = rng.normal(size=18)
    state.points[4:, P.down] = 0.0
    before = state.cov.copy()
    turn_soles(state, FEET, NOISE, dt)
    r, expected = state.x[X.points :].reshape(6, 3), np.zeros_like(before)
    for axis, rate in enumerate((NOISE.roll, NOISE.pitch, NOISE.twist)):
        along, way = state.turn[0] @ FEET.axes[0][:, axis], np.zeros(len(before))
        for k in range(3):
            way[E.points + 3 * k : E.points + 3 * k + 3] = np.cross(along, r[k] - r[:3].mean(axis=0))
        expected += rate**2 * dt * np.outer(way, way)
    np.testing.assert_allclose(state.cov - before, expected, atol=1e-14)


def test_the_long_axis_of_a_sole_is_that_of_its_switches():
    assert abs(FEET.axes[0][0, 0]) == pytest.approx(1.0)
    np.testing.assert_allclose(FEET.axes[0].T @ FEET.axes[0], np.eye(3), atol=1e-12)
    across = sole_feet(UP, 0.1, np.stack([CORNERS[:, [1, 0, 2]]] * 2)).axes[0]
    assert abs(across[1, 0]) == pytest.approx(1.0)


def standing(before, seed=0):
    """Two standing soles, turned at random, of which those switches were closed; and their turns."""
    state, turns = new_state(6), Rotation.from_rotvec(0.3 * np.random.default_rng(seed).normal(size=(2, 3))).as_matrix()
    state.points[:, P.down], state.points[:, P.closed] = 1.0, before
    state.turn[:] = np.repeat(turns, 3, axis=0)
    return state, turns


def turned_about(turns, f, pivot, axis):
    """Return how the 6 points move, (33,), if sole f turns about an axis (3,), odom, through a place of the foot."""
    way = np.zeros(33)
    for k in range(3 * f, 3 * f + 3):
        way[E.points + 3 * k : E.points + 3 * k + 3] = np.cross(axis, turns[f] @ (FEET.place[k] - pivot))
    return way


@pytest.mark.parametrize(
    ("before", "now", "held"),
    [
        (ALL, ALL, None), (ALL, 0b0111, None), (0b0111, ALL, None), (HEEL, ALL, HEEL), (ALL, HEEL, HEEL),
        (0b0101, 0b1101, 0b0101), (HEEL, 0b0110, 0b0100), (0b0001, 0b0001, 0b0001), (HEEL, 0b0011, 0), (0, HEEL, 0),
    ],
)  # fmt: skip
@pytest.mark.parametrize("f", [0, 1])
def test_a_sole_rocks_about_what_stays_on_the_ground(before, now, held, f):
    state, turns = standing(before)
    state.points[np.flatnonzero(FEET.foot != f), P.closed] = ALL  # the other one stands firmly
    closed, old = np.array([ALL, ALL]), state.cov.copy()
    closed[f] = now
    assert rock_soles(state, closed, FEET, 0.01) == (0 if held is None else 1 << f)
    stays = [s for s in range(4) if ((held or now) >> s) & 1]
    pivot, axes = CORNERS[stays].mean(axis=0), list(np.eye(3))
    if held and len(stays) == 2:
        edge = turns[f] @ (CORNERS[stays[1]] - CORNERS[stays[0]])
        axes = [edge / np.linalg.norm(edge), np.array([0.0, 0.0, 1.0])]
    ways = [turned_about(turns, f, pivot, axis) for axis in axes] if held is not None else []
    expected = sum((0.01 * np.outer(way, way) for way in ways), np.zeros_like(old))
    np.testing.assert_allclose(state.cov - old, expected, atol=1e-15)
    assert (state.points[FEET.foot == f, P.closed] == now).all()


def test_feet_in_the_air_and_feet_with_one_switch_do_not_rock():
    state, _ = standing(HEEL)
    state.points[:3, P.down] = 0.0
    old = state.cov.copy()
    assert rock_soles(state, np.array([HEEL, ALL]), FEET, 0.01) == 0b10
    assert (state.cov - old)[E.points : E.points + 9].any() == np.False_
    state, _ = standing(1)
    assert rock_soles(state, np.array([1, 1]), mounted(sole_feet(UP, 0.1)), 0.01) == 0


def test_a_foot_that_comes_down_flat_from_its_heel_does_not_lift_the_robot():
    """The sole tips by 3 deg within 0.2 s, its middle sinks by 2.6 mm, and the robot stands still all the time."""
    risen = {}
    for name, shown in (("switches", True), ("one flag", False)):
        places = mounted(sole_feet(UP[:1], 0.1, CORNERS[None]))
        state = new_state(3)
        state.cov[...] = 1e-6 * np.eye(len(state.cov))
        for k in range(30):
            tilt = Rotation.from_rotvec([0.0, -np.radians(3.0 * max(0.0, 1.0 - k / 6.0)), 0.0]).as_matrix()
            heel = np.array([-0.05, 0.0, -0.3])
            centre = heel - tilt @ np.array([-0.05, 0.0, 0.0])
            y, turn = points_of(places.foot, places.place, centre[None], tilt[None])
            closed = np.array([HEEL if shown and k < 6 else ALL])
            take_points(state, SeenPoints(y, turn, np.ones(3), closed), places, NOISE, False, 0, 1.0)
            for _ in range(3):
                predict(state, np.zeros(3), G, 0.011, NOISE, Felt(0.0, 0.0, 0.0))
        risen[name] = abs(float(state.x[X.pos + 2]))
        assert abs(state.x[X.vel + 2]) < 0.02
    assert max(risen.values()) < 3e-4


def test_switches_of_each_foot_or_one_flag():
    np.testing.assert_array_equal(touch_rows([[True, False], [True]]), [[True, False], [True, False]])
    assert touch_rows([[], []]).tolist() == [[False], [False]]
    assert touch_rows([]).shape == (0, 1)
    contact = np.array([[0.2, np.nan, 0.9], [np.nan] * 3])
    np.testing.assert_array_equal(at_switches(contact, 3), contact)
    np.testing.assert_array_equal(at_switches(contact, 2), [[0.9, 0.9], [np.nan, np.nan]])
    soles = sole_feet(UP, 0.1, np.stack([CORNERS, CORNERS]))
    position, rot = np.array([[0.0, 0.1, -0.3], [0.0, -0.1, -0.3]]), np.tile(np.eye(3), (2, 1, 1))
    found = []
    for contact in (np.ones(2), np.ones((2, 4), dtype=bool), [[0.3, 1.0], [1.0, 0.0]], [[True] * 7] * 2):
        estimator = Estimator(FootMount(None, np.eye(3), np.zeros(3), np.zeros(2)), EstimatorParams(), points=soles)
        for k in range(1, 200):
            estimator.imu(k * 10_000_000, [0.0, 0.0, 0.01 * np.sin(k)], [0.1 * np.sin(0.1 * k), 0.0, 9.81])
            if k % 3 == 0:
                assert estimator.feet(k * 10_000_000, position, rot, contact) is InputResult.OK
        found.append(estimator.estimate().velocity)
    for other in found[1:]:
        np.testing.assert_array_equal(other, found[0])
    for wrong in (np.ones((3, 4)), np.ones((2, 0)), np.ones((2, 4, 1)), np.ones((1, 2)), [[1.0], [1.0, 0.0]]):
        assert estimator.feet(2_010_000_000, position, rot, wrong) is InputResult.SHAPE
