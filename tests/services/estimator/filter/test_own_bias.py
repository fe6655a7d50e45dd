"""Heading before a rest has shown the bias of the gyro."""

import numpy as np
import pytest

from surefoot.services.estimator.filter.heading import gyro_share
from surefoot.services.estimator.filter.layout import MemoryLayout

M = MemoryLayout()


@pytest.mark.parametrize(("own", "shared"), [((0.0, 0.0, 0.0), False), ((0.0, 0.0, 0.03), True)])
def test_the_gyro_has_no_share_in_the_heading_before_the_first_rest(own, shared):
    memory = np.zeros(112)
    memory[M.parting] = 0.1**2  # feet that part fast
    memory[M.own_bias : M.own_bias + 3] = own
    assert (gyro_share(memory) > 0.5) is shared
