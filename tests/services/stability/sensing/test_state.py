"""Stability of the present stance."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from surefoot.geometry.polygon import hull, signed_distance
from surefoot.geometry.rotations import matrix_from_rpy
from surefoot.robot.kinematics import com, foot_jacobians, foot_positions, gravity_torques
from surefoot.robot.reader import load_robot
from surefoot.services.stability.sensing.state import StandingFeet, WatchParams, level_from_base, watch

RAGNO = load_robot("ragno")
UP = np.array([0.0, 0.0, 9.81])
TRIPOD = np.array([True, False, True, False, True, False])
ALL = np.ones(6, dtype=bool)


def test_level_frame() -> None:
    rng = np.random.default_rng(0)
    for _ in range(20):
        roll, pitch, yaw = rng.uniform(-1.0, 1.0, 3)
        up = matrix_from_rpy(roll, pitch, yaw).T @ UP
        rot = level_from_base(up)
        np.testing.assert_allclose(rot, matrix_from_rpy(roll, pitch, 0.0), atol=1e-12)
    assert np.linalg.det(level_from_base(np.array([9.81, 0.0, 0.0]))) == pytest.approx(1.0)


def test_neutral_stance_on_flat_ground() -> None:
    now = watch(RAGNO, RAGNO.neutral, ALL, UP, None, WatchParams())
    feet = foot_positions(RAGNO.model, RAGNO.neutral)[:, :2].copy()
    assert now.region.status == "ok"
    np.testing.assert_allclose(now.com_planned, com(RAGNO.model, RAGNO.neutral)[:2])
    assert now.margin_planned.value == pytest.approx(signed_distance(hull(feet), *now.com_planned), abs=1e-9)
    assert now.com_measured is None
    assert now.margin_measured is None


def test_tripod_has_less_margin() -> None:
    six = watch(RAGNO, RAGNO.neutral, ALL, UP, None, WatchParams()).margin_planned.value
    three = watch(RAGNO, RAGNO.neutral, TRIPOD, UP, None, WatchParams()).margin_planned.value
    assert six is not None
    assert three is not None
    assert 0.0 < three < six


def test_tilt_moves_the_com_towards_the_lower_feet() -> None:
    up = np.array([0.0, 9.81 * np.sin(0.2), 9.81 * np.cos(0.2)])  # left side high
    level, tilted = (watch(RAGNO, RAGNO.neutral, ALL, g, None, WatchParams()) for g in (UP, up))
    feet = foot_positions(RAGNO.model, RAGNO.neutral)
    shift = tilted.com_planned[1] - level.com_planned[1]
    assert shift == pytest.approx(np.cos(0.2) * 0.0 - np.sin(0.2) * com(RAGNO.model, RAGNO.neutral)[2], abs=1e-9)
    assert tilted.region.inner[:, 1].mean() - level.region.inner[:, 1].mean() == pytest.approx(
        -np.sin(0.2) * feet[0, 2], abs=5e-3
    )


@pytest.mark.parametrize(
    "touch", [np.zeros(6, dtype=bool), np.eye(6, dtype=bool)[0], np.eye(6, dtype=bool)[:2].any(axis=0)]
)
def test_few_feet(touch: np.ndarray) -> None:
    now = watch(RAGNO, RAGNO.neutral, touch, UP, np.zeros(18), WatchParams())
    assert now.region.status == ("infeasible", "point", "segment")[int(touch.sum())]
    value = now.margin_planned.value
    assert value is None if not touch.any() else value is not None and value < 0.0


def test_measured_com_from_torques() -> None:
    """The torques of a stance that carries a load show where the load has put the CoM."""
    q, feet = RAGNO.neutral, foot_positions(RAGNO.model, RAGNO.neutral)
    c = np.array([0.01, -0.02])
    # vertical forces f_i = weight (1/n + p_i'u) with sum f = weight and sum p f = weight c
    xy = feet[:, :2]
    lean = np.linalg.solve((xy - xy.mean(0)).T @ (xy - xy.mean(0)), c - xy.mean(0))
    weight = 1.2 * RAGNO.mass * 9.81
    vertical = weight * (1.0 / 6.0 + (xy - xy.mean(0)) @ lean)
    torque, jacobian = gravity_torques(RAGNO.model, q, UP), foot_jacobians(RAGNO.model, q)
    for i, leg in enumerate(RAGNO.legs):
        torque[list(leg.joints)] -= jacobian[i].T @ [0.0, 0.0, vertical[i]]
    now = watch(RAGNO, q, ALL, UP, torque, WatchParams())
    assert now.com_measured is not None
    np.testing.assert_allclose(now.com_measured.com, c, atol=1e-9)
    assert now.com_measured.weight == pytest.approx(weight)
    assert now.margin_measured is not None
    light = watch(RAGNO, q, ALL, UP, gravity_torques(RAGNO.model, q, UP), WatchParams())
    assert light.com_measured is None  # the feet carry nothing: no CoM is better than a wild one


def flags(*legs: int) -> np.ndarray:
    made = np.zeros(6, dtype=bool)
    made[list(legs)] = True
    return made


def test_a_chattering_switch_of_a_planned_stance_is_bridged_for_the_hold_time_only() -> None:
    feet, planned = StandingFeet(6, 0.15), flags(0, 2, 4)
    assert feet.update(0.0, flags(0, 2, 4), planned).tolist() == planned.tolist()
    for tick in range(1, 16):
        assert feet.update(0.01 * tick, flags(0, 2), planned).tolist() == planned.tolist()
    assert feet.update(0.16, flags(0, 2), planned).tolist() == flags(0, 2).tolist()
    assert feet.update(0.17, planned, planned).tolist() == planned.tolist()


def test_a_planned_swing_counts_while_its_switch_is_closed_and_is_not_held() -> None:
    feet = StandingFeet(6, 0.15)
    feet.update(0.0, ALL, ALL)
    assert feet.update(0.01, ALL, flags(0, 2, 4)).all()  # not lifted yet
    assert feet.update(0.02, flags(0, 2, 4), flags(0, 2, 4)).tolist() == flags(0, 2, 4).tolist()
    # planned to stand again, but it has not touched since: an open switch of the stance before is no contact
    assert feet.update(0.03, flags(0, 2, 4), ALL).tolist() == flags(0, 2, 4).tolist()
    assert feet.update(0.04, ALL, ALL).all()


def test_without_a_plan_the_switches_alone_count() -> None:
    feet = StandingFeet(6, 0.15)
    feet.update(0.0, ALL, None)
    assert feet.update(0.01, flags(1), None).tolist() == flags(1).tolist()


@settings(max_examples=200, deadline=None)
@given(st.lists(st.tuples(st.integers(0, 63), st.integers(0, 63), st.floats(0.001, 0.1)), max_size=30))
def test_properties_of_the_standing_feet(history: list[tuple[int, int, float]]) -> None:
    """Every closed switch counts; every foot that counts has touched within the hold time, in a planned stance."""
    feet, now, last = StandingFeet(6, 0.15), 0.0, np.full(6, -np.inf)
    for closed, wanted, step in history:
        touch, planned = (np.array([bool(bits >> k & 1) for k in range(6)]) for bits in (closed, wanted))
        now += step
        last[touch] = now
        standing = feet.update(now, touch, planned)
        assert (standing >= touch).all()
        held = standing & ~touch
        assert (planned >= held).all()
        assert (now - last[held] <= 0.15 + 1e-6).all()
