"""Slip measured in a walk beside the truth."""

import numpy as np
import pytest

from surefoot.lab.footholds.slip import SlipFollower, auc, rms
from surefoot.lab.footholds.walks import JoinedWalk, Setting


def test_the_area_is_the_share_of_pairs_in_order() -> None:
    rng = np.random.default_rng(0)
    score, positive = np.round(rng.normal(size=40), 1), rng.random(40) < 0.3
    pairs = [(a > b) + 0.5 * (a == b) for a in score[positive] for b in score[~positive]]
    assert auc(score, positive) == pytest.approx(float(np.mean(pairs)))
    assert np.isnan(auc(score, np.zeros(40, dtype=np.bool_)))
    assert rms([3.0, 4.0]) == pytest.approx(3.5355339)


def test_a_walk_on_flat_ground_slips_little_and_the_robot_knows() -> None:
    joined = JoinedWalk(3, Setting("flat", 0.12, profile="exact"), None)
    follower = SlipFollower(joined)
    while joined.tick():
        follower.look()
    assert len(follower.found) >= 12
    assert {each.leg for each in follower.found} == set(range(6))
    assert max(each.own for each in follower.found) < 0.003
    assert rms([each.own - each.inside for each in follower.found]) < 0.001
    assert all(0.0 <= each.inside <= each.whole for each in follower.found)
    total = sum(each.whole for each in follower.found)
    assert total == pytest.approx(sum(joined.stances.sliding), rel=0.5)
