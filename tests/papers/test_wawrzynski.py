"""Wawrzynski et al.: the order of the four estimators, the size of the errors, and two logs of other robots."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from surefoot.lab.estimation.log import Log
from surefoot.lab.estimation.logs import DATA, humanoid
from surefoot.lab.estimation.scores import score
from surefoot.lab.estimation.track import track
from surefoot.lab.estimation.walks import walk as simulated
from surefoot.papers.wawrzynski.study import with_exact_encoders
from surefoot.papers.wawrzynski.synthetic import KINDS, synthesize

SEEDS = range(2)
NAMES = ("imu", "kinematics", "kinematics_gyro", "paper")


@cache
def walk(kind: str, seed: int) -> Log:
    return synthesize(KINDS[kind], seed)


@cache
def scores(kind: str, seed: int):
    return {name: score(walk(kind, seed), track(name, walk(kind, seed))) for name in NAMES}


@pytest.mark.parametrize("kind", ["twist", "turn", "slip"])
def test_order_of_the_four_estimators(kind):
    seeds = SEEDS if kind == "twist" else SEEDS[:1]
    imu, kinematics, gyro, ekf = np.mean([[scores(kind, s)[name].rmse for name in NAMES] for s in seeds], axis=0)
    assert imu > 5.0 * kinematics  # "useless in several seconds"
    assert kinematics > gyro > ekf
    assert ekf / gyro <= (0.55 if kind == "slip" else 0.40)


def test_size_of_the_errors_on_twisting_feet():
    """Figures of a study before this one: 51, 4.4, 3.3, 1.0 cm/s; 0.4..0.5 deg of tilt from the accelerometer bias."""
    rmse = {n: 100 * np.mean([scores("twist", s)[n].rmse for s in SEEDS]) for n in NAMES}
    assert 25.0 < rmse["imu"] < 120.0
    assert 3.0 < rmse["kinematics"] < 5.5
    assert 2.0 < rmse["kinematics_gyro"] < 4.0
    assert rmse["paper"] < 1.1
    assert np.mean([scores("twist", s)["paper"].tilt_deg for s in SEEDS]) < 0.6


def test_average_velocity_as_in_equation_38():
    """The paper: 3.28 cm/s for 3.57 cm/s, 8 % off."""
    assert np.mean([abs(scores("twist", s)["paper"].average) for s in SEEDS]) < 0.15


def test_twisting_feet_are_what_the_gyro_is_for():
    """The gyro takes a larger share off the kinematic error when the feet twist."""
    plain, twist = (scores(kind, 0) for kind in ("plain", "twist"))
    share = [one["kinematics"].rmse / one["kinematics_gyro"].rmse for one in (plain, twist)]
    assert share[1] > share[0] > 1.0


@cache
def other(name: str) -> Log:
    if not (DATA / f"{name}.npz").exists():
        pytest.skip(f"{name} is not there")
    return humanoid(name)


def test_gazebo_walk():
    """Errors on the walking part, estimate and truth both over the window of the truth."""
    log = other("icub3_gazebo_walk")
    ekf, kinematics = (score(log, track(name, log)) for name in ("ekf", "kinematics"))
    assert 100 * ekf.rmse == pytest.approx(5.9, abs=0.15)
    assert 100 * ekf.smooth == pytest.approx(4.8, abs=0.15)
    assert ekf.average == pytest.approx(-0.29, abs=0.03)  # a bias while walking that no standstill shows
    assert 100 * kinematics.rmse == pytest.approx(5.4, abs=0.15)
    assert 100 * kinematics.smooth == pytest.approx(1.9, abs=0.15)
    assert score(log, track("imu", log)).rmse > 1.0


def test_gazebo_walk_by_a_tuned_invariant_filter():
    """Points of the soles, tight feet and noise as felt in motion: a third of the velocity error of one loose point."""
    log = other("icub3_gazebo_walk")
    noise = {"sigma_c": 1.5e-5, "sigma_q": 0.45, "sigma_w": 0.2, "sigma_p": 2.7e-4}
    one, several = (score(log, track("inekf", log, points=points, **noise)) for points in (False, True))
    assert several.rmse < 0.027
    assert several.smooth < 0.016
    assert several.rmse < 0.7 * one.rmse


def test_real_sway():
    """Over the window of the truth, 0.4 s, standing feet alone err by less than the filter of the paper."""
    log = other("icub_real_com")
    ekf, kinematics, both = (score(log, track(name, log)) for name in ("ekf", "kinematics", "kinematics_gyro"))
    assert 100 * ekf.rmse == pytest.approx(0.58, abs=0.05)
    assert 100 * ekf.drift == pytest.approx(0.23, abs=0.03)
    assert kinematics.rmse < both.rmse < ekf.rmse


def test_exact_encoders_of_a_walk_are_its_feet():
    """Joints of the log in place of the true ones give the feet of the log back."""
    log = simulated("nao", 0).log
    joints, none = log.joints, np.full(log.foot_position.shape, np.nan)
    assert joints is not None
    exact = with_exact_encoders(replace(log, foot_position=none), {"base_stamp_ns": log.foot_ns, "base_joints": joints})
    np.testing.assert_allclose(exact.foot_position, log.foot_position, atol=1e-9)
