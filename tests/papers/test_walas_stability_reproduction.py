"""Section 4 of Walas & Belter (2011) as `surefoot reproduce walas-stability` computes it."""

import numpy as np
import pytest

from surefoot.lab.report.findings import Reproduction, at_most, near, told
from surefoot.papers.walas import messor as walas_messor
from surefoot.papers.walas import ragno as walas_ragno
from surefoot.papers.walas import stability as walas_stability
from surefoot.papers.walas import stand as walas_stand
from surefoot.robot.reader import load_robot

RAGNO, MESSOR = load_robot("ragno"), load_robot("messor")


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
    rows = (told("", "", "", ""), at_most("", "", 0.5, 1.0))
    assert Reproduction("", rows).ok
    assert not Reproduction("", (*rows, at_most("", "", 2.0, 1.0))).ok
