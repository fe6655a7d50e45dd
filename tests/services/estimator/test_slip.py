"""Slip of stances: none for rolling and lifting feet, the way for sliding ones, whatever the switches do meanwhile."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from surefoot.geometry.rotations import matrix_from_rotvec
from surefoot.services.estimator.slip import FinishedStance, StanceSlip

RADIUS = np.array([0.008, 0.008])
UP = np.array([0.0, 0.0, 1.0])


def run(
    centres: np.ndarray, turns: np.ndarray, contacts: np.ndarray, normal: np.ndarray | None = None
) -> tuple[StanceSlip, list[FinishedStance]]:
    """Foot 0 as given, foot 1 in swing; (n, 3) m, (n, 3) rotation vectors, (n,) flags."""
    meter, ended = StanceSlip(2, RADIUS), []
    normals = None if normal is None else np.stack((normal, UP))
    for centre, turn, contact in zip(centres, turns, contacts, strict=True):
        both = np.stack((centre, np.zeros(3)))
        rots = np.stack((matrix_from_rotvec(turn), np.eye(3)))
        ended += meter.update(np.array([contact, False]), both, rots, normals)
    return meter, ended


def stance(way: np.ndarray, turn: np.ndarray, n: int = 20) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Two samples to settle, an even movement, three samples in the air."""
    share = np.concatenate((np.zeros(2), np.linspace(0.0, 1.0, n), np.ones(3)))[:, None]
    return share * way, share * turn, np.arange(n + 5) < n + 2


@given(st.floats(-0.5, 0.5), st.floats(-0.5, 0.5), st.floats(-0.5, 0.5))
def test_a_rolling_foot_does_not_slip(a: float, b: float, spin: float) -> None:
    turn = np.array([a, b, 0.0])
    centres, turns, contacts = stance(np.cross(turn, RADIUS[0] * UP), turn)
    _, ended = run(centres, turns, contacts)
    assert [each.leg for each in ended] == [0]
    assert ended[0].slip == pytest.approx(0.0, abs=1e-9)
    spun = run(*stance(np.zeros(3), np.array([0.0, 0.0, spin])))[1]
    assert spun[0].slip == pytest.approx(0.0, abs=1e-9)  # a foot that twists in its place slips nowhere


@given(st.floats(-0.03, 0.03), st.floats(-0.03, 0.03), st.floats(-0.4, 0.4))
def test_a_sliding_foot_slips_by_its_way(x: float, y: float, tilt: float) -> None:
    turn = np.array([0.1, tilt, 0.0])
    way = np.array([x, y, 0.0])
    _, ended = run(*stance(way + np.cross(turn, RADIUS[0] * UP), turn))
    assert ended[0].slip == pytest.approx(math.hypot(x, y), abs=1e-9)
    assert ended[0].samples == 20


def test_the_way_along_the_normal_is_no_slip() -> None:
    normal = np.array([math.sin(0.4), 0.0, math.cos(0.4)])
    _, ended = run(*stance(0.01 * normal, np.zeros(3)), normal=normal)
    assert ended[0].slip == pytest.approx(0.0, abs=1e-12)


def test_a_bounce_does_not_end_a_stance_and_the_landing_does_not_count() -> None:
    centres, turns, contacts = stance(np.array([0.01, 0.0, 0.0]), np.zeros(3))
    contacts[8] = False
    centres[0] = (-0.5, 0.0, 0.0)  # still on its way down
    meter, ended = run(centres, turns, contacts)
    assert [round(each.slip, 9) for each in ended] == [0.01]
    assert not meter.slip.any()


def test_touches_that_are_too_short_and_numbers_that_are_none() -> None:
    centres, turns, contacts = stance(np.array([0.01, 0.0, 0.0]), np.zeros(3))
    assert run(centres, turns, np.arange(len(contacts)) < 2)[1] == []
    centres[10:13] = np.nan
    _, ended = run(centres, turns, contacts)
    assert ended[0].slip == pytest.approx(0.01)
