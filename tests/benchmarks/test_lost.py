"""The study of displacements: a few robots notice, recover and raise no false alarm, each time the same."""

import pytest

from benchmarks.lost import EASY, ROUGH, alarms, displacement


@pytest.mark.parametrize("noise", [EASY, ROUGH])
def test_displaced_robots_notice_and_recover_rightly(noise):
    rows = [displacement(seed, 40.0, noise, 0.5) for seed in range(6)]
    assert all(row["early"] < 0.5 for row in rows)
    assert sum(row["noticed"] is not None and row["noticed"] <= 3.0 for row in rows) >= 5
    assert sum(row["recovered"] is not None and row["recovered"] <= 10.0 for row in rows) >= 5
    assert not any(row["wrong"] for row in rows)
    assert displacement(0, 40.0, noise, 0.5) == rows[0]


def test_an_undisturbed_robot_raises_no_alarm():
    count, off, nees = alarms(1, 3.0, 40.0, EASY, 0.5)
    assert (count, off) == (0, 0)
    assert 0.5 < sum(nees) / len(nees) < 2.0
