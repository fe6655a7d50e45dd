"""`surefoot reproduce wawrzynski`: rows, figures, errata, and one walk for real."""

from dataclasses import replace

import numpy as np
import pytest

from surefoot.lab.estimation.scores import score
from surefoot.lab.estimation.track import track
from surefoot.papers.wawrzynski import study
from surefoot.papers.wawrzynski.figures import draw
from surefoot.papers.wawrzynski.study import Experiment, errata, experiment, roughness
from surefoot.papers.wawrzynski.velocity import errors_38, findings
from tests.lab.estimation.walks import noisy


@pytest.fixture(scope="module")
def made_up() -> list[Experiment]:
    """Experiments over synthetic walks, which are quick."""
    out = []
    for seed in range(2):
        log = noisy("twist", seed)
        tracks = {name: track(name, log) for name in study.estimators()}
        walking = log.seconds > 2.5
        noise = {name: roughness((one.v - log.v)[walking, 0], log) for name, one in tracks.items()}
        true = float(log.v[walking, 0].mean())
        average = {name: (float(one.v[walking, 0].mean()), true) for name, one in tracks.items()}
        out.append(
            Experiment(
                seed, True, log, walking, tracks, {name: score(log, one) for name, one in tracks.items()},
                average | {study.BRIEF: average["paper"]},
                noise | {"kinematics, exact": 0.01, "kinematics_gyro, exact": 0.01}, 4.0, 0.03,
            )
        )  # fmt: skip
    return out


def test_every_conclusion_of_section_vi_has_a_row(made_up):
    rows = findings(made_up)
    where = {row.where for row in rows}
    assert where == {"VI", "(38)", "VI, Fig. 3", "beside", "(8)", "(12)"}
    held = {row.what: row.ok for row in rows if row.ok is not None}
    assert held["EKF / kinematics with gyro: noise"]
    assert held["IMU alone: error at the end, cm/s"]
    assert not held["way, m"]  # a synthetic walk is not as long


def test_the_error_of_38_is_relative_and_signed(made_up):
    one = replace(made_up[0], average={"paper": (0.0328, 0.0357)})
    assert errors_38([one], "paper")[0] == pytest.approx(-8.1, abs=0.05)


def test_a_filter_that_does_not_filter_fails(made_up):
    loud = [replace(one, noise={**one.noise, "paper": one.noise["kinematics_gyro"]}) for one in made_up]
    assert any(row.what.startswith("EKF / kinematics") and row.ok is False for row in findings(loud))


def test_figures_are_written(made_up, tmp_path):
    paths = draw(made_up, tmp_path / "figures")
    assert [path.name for path in paths] == ["fig3-velocity.svg", "errors.svg"]
    assert all(path.read_text().startswith("<?xml") for path in paths)


def test_roughness_is_the_noise_and_not_the_walk():
    log = noisy("twist", 0)
    slow = np.sin(2 * np.pi * 0.3 * log.seconds)
    noise = np.random.default_rng(0).normal(size=len(slow))
    assert roughness(slow, log) < 0.02
    assert roughness(slow + noise, log) == pytest.approx(1.0, abs=0.06)


def test_printed_equations_are_wrong_and_the_corrected_right():
    found = errata(50)
    assert found.velocity < 1e-6 < 0.05 < found.velocity_printed
    assert found.rate < 1e-6 < 0.5 < found.rate_printed


@pytest.mark.slow
def test_one_walk_for_real():
    one = experiment(0)
    assert one.ok
    assert one.way == pytest.approx(1.0, abs=0.1)
    assert 24.0 < one.duration < 32.0
    assert one.noise["kinematics_gyro, exact"] < 0.7 * one.noise["kinematics_gyro"]
    assert one.noise["paper"] < 0.4 * one.noise["kinematics_gyro"]
    assert one.lost_after < 15.0
