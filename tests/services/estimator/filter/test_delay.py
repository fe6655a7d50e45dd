"""Feet whose stamps are late or early all the time, or from some time on without a step, are put in their place."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from surefoot.lab.estimation.log import Log
from surefoot.lab.estimation.track import Track, track
from tests.lab.estimation.walks import noisy


def late(log: Log, ms: int) -> Log:
    """The log with the stamps of its feet moved; those that would come after its end are lost."""
    stamps = log.foot_ns + ms * 1_000_000
    return replace(log, foot_ns=stamps, order=None).with_feet(np.flatnonzero(stamps <= log.stamp_ns[-1]))


def error(log: Log, found: Track) -> float:
    """Rms of the velocity from the fifth second on, m/s."""
    assert log.truth is not None
    rows = log.seconds > 5.0
    return float(np.sqrt(np.mean(np.sum((found.v - log.truth.v)[rows] ** 2, axis=1))))


def shown_ms(found: Track) -> float:
    assert found.named is not None
    return 1e-6 * float(found.named["late_ns"][-1])


@cache
def in_time(kind: str) -> Track:
    return track("best", noisy(kind, 7))


@pytest.mark.parametrize("kind", ["twist", "slip", "turn"])
@pytest.mark.parametrize("ms", [-40, -20, 20, 40])
def test_late_feet_are_found_and_cost_little(kind, ms):
    log = noisy(kind, 7)
    clean, found = in_time(kind), track("best", late(log, ms))
    assert shown_ms(clean) == 0.0
    assert shown_ms(found) == pytest.approx(ms, abs=6.0)
    assert error(log, found) < 1.75 * error(log, clean)  # the newest feet are lacking: 1.5; not put right: 4


@pytest.mark.parametrize("seed", range(4))
def test_feet_in_time_are_left_alone(seed):
    for kind in ("twist", "edges", "false"):
        assert shown_ms(track("best", noisy(kind, 20 + seed))) == 0.0


def test_the_side_is_reported():
    log = noisy("twist", 3)
    found = track("best", late(log, -30))
    assert not found.flags["sensors_ok"][-1]
    assert shown_ms(found) < -20.0
