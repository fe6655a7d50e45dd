"""Estimators of the service and referees through one function."""

import numpy as np
import pytest

from surefoot.errors import SurefootError
from surefoot.lab.estimation.track import PEERS, names, track
from tests.lab.estimation.walks import noisy
from tests.surefoot.expect import expect_error


@pytest.mark.parametrize("name", [*names(), *PEERS])
def test_every_estimator_gives_a_finite_track(name):
    log = noisy()
    found = track(name, log)
    n = len(log.stamp_ns)
    assert found.v.shape == found.g.shape == found.position.shape == (n, 3)
    assert found.p.shape == (n, 6, 6)
    for part in (found.v, found.g, found.p, found.position, found.yaw, found.v_odom):
        assert np.isfinite(part).all()
    assert found.flags["initialised"][300:].all()
    assert np.linalg.norm(found.g[300:], axis=1) == pytest.approx(9.81, abs=0.2)


def test_an_unknown_estimator_is_refused_with_the_known_ones():
    with expect_error(SurefootError, "invalid", text="inekf"):
        track("bets", noisy())


def test_the_same_log_gives_the_same_track():
    a, b = (track("ekf", noisy()) for _ in range(2))
    np.testing.assert_array_equal(a.v, b.v)
    np.testing.assert_array_equal(a.p, b.p)
