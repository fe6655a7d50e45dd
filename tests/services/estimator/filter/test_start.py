"""Starts of `best` that turn out to be wrong."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from surefoot.lab.estimation.faults import STARTS, turned
from surefoot.lab.estimation.planted import PLANTED
from surefoot.lab.estimation.scores import tilt
from surefoot.lab.estimation.track import track
from surefoot.papers.wawrzynski.synthetic import KINDS, WalkParams, synthesize
from surefoot.services.estimator.stream import BEST


@pytest.mark.parametrize("degrees", [12.0, 30.0])
def test_a_tilt_that_the_feet_contradict_is_found_in_the_walk(degrees):
    log = synthesize(WalkParams(duration_s=7.0, twist_deg=(3.0, 10.0)), 3)
    wrong = log.q.copy()
    rows = slice(0, log.rest[1])
    wrong[rows] = wrong[rows] @ Rotation.from_euler("y", degrees, degrees=True).as_matrix().T
    good, found = (track(BEST, replace(log, q=q)) for q in (log.q, wrong))
    late = log.seconds > 5.0
    a, b = (np.sqrt(np.mean(np.sum((one.v - log.v)[late] ** 2, axis=1))) for one in (good, found))
    assert b < 1.5 * a
    tilts = np.degrees(tilt(replace(log, q=wrong), found))
    assert tilts[log.rest[1] - 5] > 0.9 * degrees
    assert tilts[late].max() < 1.5
    assert found.flags["initialised"][log.seconds > 5.0].all()
    np.testing.assert_allclose(found.yaw[-1], good.yaw[-1], atol=0.03)


def test_feet_are_not_blamed_for_a_small_tilt():
    """8 deg: the velocity is lost once, then the feet are left out one after the other."""
    log = synthesize(KINDS["twist"], 40)
    good, found = track(BEST, log), track(BEST, STARTS["30 deg wrong"](log, 0))
    late = log.seconds > log.seconds[log.rest[1]] + 1.6
    assert np.abs(found.v - good.v)[late].max() < 0.05
    assert found.flags["sensors_ok"][late].all()


@pytest.mark.parametrize("kind", ["twist", "slip", "turn"])
@pytest.mark.parametrize("mounted", [0, 3])
def test_a_small_tilt_is_found_in_the_first_step(kind, mounted):
    """8 deg, however the inertial unit is mounted: before, 0.9 s of more than 5 cm/s in silence, or no end of it."""
    log = synthesize(KINDS[kind], 60)
    wrong = STARTS["30 deg wrong"](log, 0)
    if mounted:
        log, wrong = turned(log, mounted), turned(wrong, mounted)
    good, found = track(BEST, log), track(BEST, wrong)
    error, step = np.linalg.norm(found.v - good.v, axis=1), float(np.median(np.diff(log.seconds)))
    walking = log.seconds > log.seconds[log.rest[1]]
    silent = walking & (error > 0.05) & found.flags["initialised"] & found.flags["filter_ok"]
    assert 0.05 < silent.sum() * step < 0.4
    assert error[log.seconds > log.seconds[log.rest[1]] + 0.5].max() < 0.05
    assert good.flags["initialised"][walking].all()
    assert good.flags["filter_ok"][walking].all()


@pytest.mark.parametrize("sensor", ["sigma_w", "sigma_q"])
@pytest.mark.parametrize("factor", [0.2, 5.0])
def test_a_rest_bounds_a_noise_that_is_stated_wrongly(sensor, factor):
    """Slipping feet: before, the errors of noises stated five times too large were 1.7 to 1.9 times as large."""
    log = synthesize(KINDS["slip"], 70)
    right, wrong = track(BEST, log), track(BEST, log, **{sensor: factor * log.sensors[sensor]})
    late = log.seconds > 3.0
    a, b = (np.sqrt(np.mean(np.sum((one.v - log.v)[late] ** 2, axis=1))) for one in (right, wrong))
    assert b < 1.4 * a


def test_a_sensor_that_shows_nothing_at_rest_keeps_its_stated_noise():
    """A sensor of coarse steps, or one without noise, repeats itself at rest."""
    log = synthesize(KINDS["twist"], 70)
    w, rows = log.w.copy(), slice(0, log.rest[1])
    w[rows] = w[rows].mean(axis=0)
    right, found = track(BEST, log), track(BEST, replace(log, w=w))
    assert found.flags["initialised"][-1]
    assert np.abs(found.v - right.v).max() < 0.01


def test_a_foot_behind_a_switch_that_hangs_turns_no_tilt():
    """A rest, a switch that hangs from its end on, and a walk: the excess rises as it does by a wrong tilt."""
    log = synthesize(KINDS["twist"], 60)
    bad = PLANTED["switch stuck on"](log, float(log.seconds[log.rest[1]]), 0)
    found = track(BEST, bad)
    walking = log.seconds > log.seconds[log.rest[1]]
    assert found.flags["initialised"][walking].all()
    assert np.degrees(tilt(bad, found))[walking].max() < 1.5
