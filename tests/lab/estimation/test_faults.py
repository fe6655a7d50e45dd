"""Faults change what they name and leave the rest."""

import numpy as np
import pytest

from surefoot.lab.estimation import faults
from surefoot.lab.estimation.scores import score
from surefoot.lab.estimation.track import track
from tests.lab.estimation.walks import noisy


def test_late_feet_keep_their_stamps():
    log = noisy()
    late = faults.delayed(log, 0.05)
    n, newest, waits = len(log.stamp_ns), 0, []
    for at in late.arrival():
        if at < n:
            newest = late.stamp_ns[at]
        else:
            waits.append(newest - late.foot_ns[at - n])
    assert min(waits[1:-3]) > 39_000_000
    assert max(waits) <= 50_000_000


def test_shuffled_logs_hold_every_input_once_and_end_in_order():
    log = noisy()
    order = faults.shuffled(log, 0.1, 3).arrival()
    np.testing.assert_array_equal(np.sort(order), np.arange(len(log.stamp_ns) + len(log.foot_ns)))
    stamps = np.concatenate([log.stamp_ns, log.foot_ns])[order]
    back = np.maximum.accumulate(stamps) - stamps
    assert 50e6 < back.max() <= 100e6
    assert (np.diff(stamps[-100:]) >= 0).all()


def test_losses_leave_a_hole_in_the_feet():
    log = noisy()
    some = faults.with_losses(log, 0.2, 0)
    assert 0.7 < len(some.stamp_ns) / len(log.stamp_ns) < 0.9
    assert np.diff(some.foot_ns).max() > 1_000_000_000
    assert len(some.truth.v) == len(some.stamp_ns)


def test_outliers_are_as_many_and_as_large_as_said():
    log = noisy()
    off = np.linalg.norm(faults.with_outliers(log, 0.02, 0.02, 0).foot_position - log.foot_position, axis=2)
    assert off[off > 0] == pytest.approx(0.02)
    assert 0.005 < (off > 0).mean() < 0.04


def test_false_contacts_lie_in_swings():
    log = noisy()
    false = faults.with_false_contacts(log, 0.5, 0.13, 0)
    assert (false.contact >= log.contact).all()
    assert 0.02 < (false.contact & ~log.contact).mean() < 0.3


def test_a_turned_imu_sees_the_same_walk():
    log = noisy()
    turned = faults.turned(log, 1)
    np.testing.assert_allclose(turned.v_world, log.v_world)
    np.testing.assert_allclose(np.einsum("nij,nj->ni", turned.rot, turned.q), np.einsum("nij,nj->ni", log.rot, log.q))
    a, b = (score(one, track("inekf", one)) for one in (log, turned))
    assert b.rmse == pytest.approx(a.rmse, rel=1e-6)


def test_a_log_from_the_middle_has_no_rest():
    log = noisy()
    cut = faults.from_the_middle(log, 5.0)
    assert cut.rest == (0, 0)
    assert cut.seconds[-1] == pytest.approx(log.seconds[-1] - 5.0, abs=0.011)
    assert cut.foot_ns[0] >= cut.stamp_ns[0]
