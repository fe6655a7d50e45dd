"""Forms of samples: anything that holds their numbers, and nothing else."""

import numpy as np
import pytest

from surefoot.services.estimator.filter.intake import take_feet, take_imu
from surefoot.services.estimator.inputs.results import InputResult
from surefoot.services.estimator.stream import BEST
from tests.services.estimator.test_stream import TICK, make, walk


def strided(x):
    """The same values with a stride between them."""
    return np.repeat(np.asarray(x)[..., None], 2, axis=-1)[..., 0]


def read_only(x):
    """The same values, not to be written."""
    out = np.array(x)
    out.flags.writeable = False
    return out


@pytest.mark.parametrize("form", [lambda x: np.asarray(x).tolist(), strided, read_only, np.asfortranarray])
def test_samples_may_come_as_anything_that_holds_their_numbers(form):
    """Of another type each would be compiled for anew, for many seconds."""
    log = walk()
    plain, other = make(names=(BEST,)), make(names=(BEST,))
    compiled = list[int]()
    for k in range(240):
        plain.imu(int(log.stamp_ns[k]), log.w[k], log.q[k])
        other.imu(int(log.stamp_ns[k]), form(log.w[k]), form(log.q[k]))
        f = k // 4
        if k % 4 == 0:
            plain.feet(int(log.foot_ns[f]), log.foot_position[f], log.foot_rot[f], log.contact[f])
            compiled = compiled or [len(each.signatures) for each in (take_imu, take_feet)]
            other.feet(int(log.foot_ns[f]), form(log.foot_position[f]), form(log.foot_rot[f]), form(log.contact[f]))
    np.testing.assert_array_equal(plain.estimate().velocity, other.estimate().velocity)
    assert other.check.counts == plain.check.counts
    assert [len(each.signatures) for each in (take_imu, take_feet)] == compiled


@pytest.mark.parametrize("wrong", ["text", None, [1.0, [2.0]], [10**400, 0, 0], [0.0] * 4, []])
def test_what_holds_no_such_numbers_is_refused_by_its_shape(wrong):
    log, estimator = walk(), make(names=(BEST,))
    position, rot, contact = log.foot_position[0], log.foot_rot[0], log.contact[0]
    assert estimator.imu(TICK, wrong, np.zeros(3)) is InputResult.SHAPE
    assert estimator.imu(TICK, np.zeros(3), wrong) is InputResult.SHAPE
    assert estimator.feet(TICK, wrong, rot, contact) is InputResult.SHAPE
    assert estimator.feet(TICK, position, wrong, contact) is InputResult.SHAPE
    if wrong is not None:  # no sensor
        assert estimator.feet(TICK, position, rot, wrong) is InputResult.SHAPE
    assert estimator.feet(TICK, position, rot, np.ones(len(contact) + 1)) is InputResult.SHAPE
