"""Clocks of the sources of samples."""

import numpy as np
import pytest

from surefoot.services.estimator.inputs.clock import AHEAD_NS, CLOCK, RESYNC_AFTER, WINDOW_NS, check_clock
from surefoot.services.estimator.inputs.results import AHEAD, LATE, OK, RESTART


def clock(newest):
    made = np.zeros(CLOCK, dtype=np.int64)
    assert check_clock(made, newest, newest) == OK
    return made


@pytest.mark.parametrize(("stamp", "result"), [
    (10**9 - WINDOW_NS, OK), (10**9 - WINDOW_NS - 1, LATE), (10**9 + 1, OK), (10**9 + AHEAD_NS + 1, AHEAD),
    (10**12, AHEAD),
])  # fmt: skip
def test_stamps(stamp, result):
    assert check_clock(clock(10**9), stamp, 10**9) == result


def test_one_stamp_far_ahead_does_not_close_the_ears():
    made = clock(10**9)
    assert check_clock(made, 10**18, 10**9) == AHEAD
    assert check_clock(made, 10**9 + 10**7, 10**9) == OK


def test_a_clock_that_began_anew_is_followed():
    made = clock(10**12)
    results = [check_clock(made, k * 10**7, 10**12) for k in range(1, RESYNC_AFTER + 1)]
    assert set(results[:-1]) == {LATE}
    assert results[-1] == RESTART
