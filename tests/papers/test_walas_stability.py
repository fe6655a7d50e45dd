"""Section 4 of Walas & Belter (2011): its numbers from descriptions of the robots, `surefoot reproduce`, a scenario."""

import re

import numpy as np
import pytest

from surefoot.geometry.polygon import area, hull
from surefoot.lab.report.findings import Reproduction, at_most, fact, near
from surefoot.lab.runs.local import run_local
from surefoot.papers.walas import messor as walas_messor
from surefoot.papers.walas import ragno as walas_ragno
from surefoot.papers.walas import stability as walas_stability
from surefoot.papers.walas import stand as walas_stand
from surefoot.robot.kinematics import com, foot_positions, legs_ik
from surefoot.robot.reader import load_robot
from surefoot.services.stability.programs.contacts import ContactSet, contact_set, equally_spaced
from surefoot.services.stability.regions.movement import check
from surefoot.services.stability.regions.region import region
from surefoot.services.stability.sensing.posture import PosedRobot
from surefoot.services.supervisor.scenarios.scenario import find_scenario, load_scenario

RAGNO, MESSOR = load_robot("ragno"), load_robot("messor")
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


def test_sections_4_1_to_4_3_within_their_limits() -> None:
    slopes = tuple(walas_ragno.slope(RAGNO, mu) for mu in walas_ragno.SLOPE_TABLE)
    rows = walas_ragno.figure_15(RAGNO, walas_ragno.postures(RAGNO)) + walas_ragno.figure_17(slopes)
    assert [row for row in rows if row.ok is False] == []
    assert sum(row.ok is True for row in rows) >= 20
    assert walas_ragno.consistency(slopes, RAGNO.mass * 9.81).ok


def test_the_printed_gsm_hides_a_fall() -> None:
    s = walas_ragno.slope(RAGNO, 0.25)
    assert not s.corrected.stable
    assert s.printed == pytest.approx(0.0225, abs=5e-4)
    assert walas_ragno.gsm(s.corrected) == pytest.approx(-2.25, abs=0.05)


def test_a_measured_com_shifts_the_margin() -> None:
    s = walas_ragno.slope(RAGNO, 0.45)
    _, by_kinematics = walas_ragno.extended_check(s, s.com)
    _, moved = walas_ragno.extended_check(s, s.com + np.array([0.01, 0.0]))
    assert walas_ragno.gsm(by_kinematics) - walas_ragno.gsm(moved) == pytest.approx(1.0, abs=1e-6)


def test_calibration_on_the_simulated_messor() -> None:
    """The trunk moves 10 cm to either side; the data sheet's 0.845 Nm/A becomes 0.6356 within 1 %."""
    found = walas_messor.sweep(MESSOR, stops=2)
    assert found.calibration.common == pytest.approx(walas_stability.TRUE_FACTOR, rel=0.01)
    np.testing.assert_allclose(found.gain_free, found.true, atol=3e-3)
    assert found.ways(found.true)[0] == pytest.approx(0.0593, abs=0.002)  # the legs stay behind


@pytest.mark.parametrize("gain", [0.7, 1.3])
def test_com_from_forces_with_torques_30_percent_off(gain: float) -> None:
    bare = walas_messor._without_noise(MESSOR)
    stand = walas_stand.Stand(bare, ideal=True, gain=gain)
    stand.move(tilt=(0.1, -0.1))
    reading = stand.read()
    assert np.linalg.norm(walas_messor.measured_com(bare, reading, None) - reading.com) < 1e-3


@pytest.mark.slow
def test_all_of_section_4(tmp_path) -> None:
    found = walas_stability.reproduce(tmp_path / "figures")
    assert [row for row in found.findings if row.ok is False] == []
    assert len(found.figures) == 8
    for path in found.figures:
        assert path.read_text(encoding="utf-8").lstrip().startswith("<?xml")


def test_verdicts() -> None:
    assert near("", "", 1.0, 1.04, 0.05).ok
    assert not near("", "", 1.0, 1.06, 0.05).ok
    assert not at_most("", "", float("nan"), 1.0).ok
    rows = (fact("", "", "", ""), at_most("", "", 0.5, 1.0))
    assert Reproduction("", rows).ok
    assert not Reproduction("", (*rows, at_most("", "", 2.0, 1.0))).ok


@pytest.mark.slow
def test_the_scenario_returns_the_gain_within_1_percent() -> None:
    """4.7: the scenario moves the trunk, every service runs, and the factor of the motors is returned."""
    scenario = load_scenario(find_scenario("calibrate"))
    assert scenario.world.torque_per_ampere is not None
    run = run_local(scenario, without=("recorder",))
    assert run.verdict.ok, (run.verdict.problems, run.verdict.rows)
    note = next(note for note in run.verdict.notes if note.startswith("calibration:"))
    found = re.search(r"x ([0-9.]+) .* ([0-9.]+) Nm/A, ([0-9]+) poses", note)
    assert found is not None, note
    assert float(found[2]) == pytest.approx(scenario.world.torque_per_ampere, rel=0.01)
    assert int(found[3]) >= 9
