"""Numbers of Walas & Belter (2011), section 4, from the description of Ragno."""

import numpy as np
import pytest

from surefoot.geometry.polygon import area, hull
from surefoot.robot.kinematics import com, foot_positions, legs_ik
from surefoot.robot.reader import load_robot
from surefoot.services.stability.programs.contacts import ContactSet, contact_set, equally_spaced
from surefoot.services.stability.regions.movement import check
from surefoot.services.stability.regions.region import region
from surefoot.services.stability.sensing.posture import PosedRobot

RAGNO = load_robot("ragno")
UP, UPHILL = (0.0, 0.0, 1.0), (-0.5, 0.0, float(np.sqrt(0.75)))
SLOPE_X, TRUNK_Z, R_M = -0.05, 0.12, np.array([0.043, 0.0, 0.0])


def slope(mu: float) -> ContactSet:
    """4.3: fore and middle feet on a 30 degree slope that begins at x = -5 cm, hind feet on the ground before it."""
    feet = foot_positions(RAGNO.model, RAGNO.neutral)
    feet[:, 2] = np.maximum(0.0, (feet[:, 0] - SLOPE_X) * np.tan(np.pi / 6.0))
    return contact_set(feet, [UPHILL if z > 0.0 else UP for z in feet[:, 2]], mu)


@pytest.mark.parametrize(("turn_deg", "expected"), [(30.0, 0.011), (-30.0, -0.009)])
def test_figure_15_com_shift(turn_deg: float, expected: float) -> None:
    """ServoLegs 30 degrees forward +1.1 cm, backward -0.9 cm; within 0.05 cm."""
    q = RAGNO.neutral.copy()
    for leg in RAGNO.legs:
        q[leg.joints[0]] += np.radians(turn_deg) * (-1.0 if leg.name.startswith("l") else 1.0)
    shift = com(RAGNO.model, q) - com(RAGNO.model, RAGNO.neutral)
    assert shift[0] == pytest.approx(expected, abs=5e-4)
    assert shift[1] == pytest.approx(0.0, abs=1e-12)


def test_feet_stand_on_33_by_30_cm() -> None:
    feet = foot_positions(RAGNO.model, RAGNO.neutral)
    np.testing.assert_allclose(np.ptp(feet[:, :2], axis=0), [0.33, 0.30], atol=0.006)
    np.testing.assert_allclose(sorted(set(slope(0.5).position[:, 2].round(3))), [0.0, 0.029, 0.126], atol=1e-9)


@pytest.mark.parametrize(
    ("mu", "ratio", "reach_cm"),
    [(0.25, 0.473, 0.5), (0.35, 0.658, 6.5), (0.45, 0.826, 11.6), (0.55, 0.967, 15.8), (0.578, 1.000, 16.75)],
)
def test_figure_17_region_on_the_slope(mu: float, ratio: float, reach_cm: float) -> None:
    """Area against the hull's within 1e-3; smaller than the hull only for mu < tan 30 deg."""
    contacts = slope(mu)
    found = region(contacts, tolerance=1e-6, limit=720)
    whole = area(hull(contacts.position[:, :2].copy()))
    assert area(found.inner) / whole == pytest.approx(ratio, abs=1e-3)
    assert area(found.outer) / whole == pytest.approx(ratio, abs=1e-3)
    reach = region(contacts, equally_spaced(16)).support.value[0]
    assert 100.0 * reach == pytest.approx(reach_cm, abs=0.06)


@pytest.mark.parametrize(
    ("mu", "without_cm", "with_cm"),
    [(0.25, -3.02, -2.25), (0.35, 2.97, 3.74), (0.45, 8.07, 8.84), (0.55, 12.22, 12.98), (0.578, 13.18, 13.95)],
)
def test_figure_17_movement_of_43_mm(mu: float, without_cm: float, with_cm: float) -> None:
    """Signed GSM without and with kinematic correction, with the CoM 1.2 cm off the leg axis (the shipped robot)."""
    contacts = slope(mu)
    base = np.array([0.0, 0.0, TRUNK_Z])
    q = legs_ik(RAGNO.model, contacts.position - base)[0]
    now = com(RAGNO.model, q)[:2]
    assert 100.0 * now[0] == pytest.approx(-0.73, abs=0.01)
    shift = PosedRobot(RAGNO, q, np.zeros(3), np.eye(3)).moved(R_M, np.ones(6, dtype=bool)).vector
    assert 100.0 * shift[0] == pytest.approx(-0.77, abs=0.01)
    found = region(contacts)
    plain, corrected = (check(found, now, R_M, s).gsm for s in (np.zeros(3), shift))
    assert plain is not None
    assert corrected is not None
    assert plain.value is not None
    assert corrected.value is not None
    assert 100.0 * plain.value == pytest.approx(without_cm, abs=0.01)
    assert 100.0 * corrected.value == pytest.approx(with_cm, abs=0.01)
