"""Differences of estimates that are known."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from surefoot.errors import SurefootError
from surefoot.lab.estimation.differences import Estimated, departures
from tests.surefoot.expect import expect_error

N = 400


def walk() -> Estimated:
    t = 0.01 * np.arange(N)
    up, v = np.tile([0.0, 0.0, 9.81], (N, 1)), np.tile([0.2, 0.0, 0.0], (N, 1))
    position = np.stack([0.2 * t, 0.0 * t, 0.0 * t], axis=1)
    return Estimated(Path("a"), 10_000_000 * np.arange(N), t >= 0.5, v, up, position, 0.0 * t, {})


def test_other_rows_and_another_odom_are_no_difference():
    a = walk()
    c, s = np.cos(0.7), np.sin(0.7)
    moved = a.position @ np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]]) + [1.0, 2.0, 3.0]
    b = replace(a, position=moved, yaw=a.yaw + 0.7)
    every = slice(60, None, 3)
    parts = {name: getattr(b, name)[every] for name in ("stamp_ns", "started", "v", "g", "position", "yaw")}
    found = departures(a, replace(b, **parts))
    assert all(part.largest < 1e-9 for part in found.values())


def test_differences_have_their_size_and_place():
    a = walk()
    v, yaw, g = a.v.copy(), a.yaw.copy(), a.g.copy()
    v[250] += [0.0, 0.3, 0.4]
    yaw[300:] += np.radians(2.0)
    g[:, 0] = 9.81 * np.tan(np.radians(3.0))
    position = a.position * 1.1
    found = departures(a, replace(a, v=v, yaw=yaw, g=g, position=position))
    assert found["velocity"].largest == pytest.approx(0.5)
    assert found["velocity"].at_s == pytest.approx(2.0)  # of the first common row, at 0.5 s
    assert found["velocity"].rms == pytest.approx(0.5 / np.sqrt(N - 50))
    assert found["heading"].largest == pytest.approx(2.0)
    assert found["tilt"].rms == pytest.approx(3.0)
    assert found["position"].largest == pytest.approx(0.1 * 0.2 * 3.49)


def test_no_common_time_is_refused():
    a = walk()
    with expect_error(SurefootError, "invalid", text="no common time"):
        departures(a, replace(a, stamp_ns=a.stamp_ns + 10**12))
    with expect_error(SurefootError, "invalid"):
        departures(a, replace(a, started=np.zeros(N, dtype=bool)))
