"""Steps of small margin: the trunk moves first, then fewer legs are lifted, then the step is refused."""

import itertools

import numpy as np
import pytest

from surefoot.services.walker.interface import MotionCommand, StanceVerdict
from surefoot.services.walker.legged.balance import nearest_inside, shift_into
from surefoot.services.walker.legged.standins import HullCheck, hull_margin, ring_of
from tests.services.walker.legged.plant import PARAMS, ROBOT, obeyed, plant

RNG = np.random.default_rng(11)


def random_reply(rng):
    ring = ring_of(rng.uniform(-0.1, 0.1, (3, 2)))
    com = rng.uniform(-0.1, 0.1, 2)
    after = com + rng.uniform(-0.02, 0.02, 2)
    return StanceVerdict(False, min(hull_margin(ring, com), hull_margin(ring, after)), "ok", ring, com, after)


def test_a_shift_never_lessens_the_margin_and_reaches_the_wanted_one_where_there_is_room():
    reached = 0
    for _ in range(300):
        reply = random_reply(RNG)
        shift = shift_into(reply, 0.01)
        if shift is None:
            continue
        then = min(hull_margin(reply.region, reply.com + shift), hull_margin(reply.region, reply.com_after + shift))
        assert then >= min(reply.margin, 0.01) - 1e-4
        reached += then >= 0.01 - 1e-4
    assert reached > 120


def test_the_shift_is_the_shortest():
    edges = np.array([[1.0, 0.0], [0.0, 1.0]])
    shift, found = nearest_inside(edges, np.array([-0.01, 0.05]), 0.02)
    assert found
    assert shift == pytest.approx([-0.03, 0.0], abs=1e-4)
    assert not nearest_inside(np.array([[1.0, 0.0], [-1.0, 0.0]]), np.array([0.01, 0.01]), 0.02)[1]


def test_without_a_region_there_is_no_shift():
    assert shift_into(StanceVerdict(False, None, "segment"), 0.01) is None


class LoadedTrunk(HullCheck):
    """A robot whose centre of mass lies elsewhere than in the description."""

    def __init__(self, offset):
        super().__init__(ROBOT)
        self.offset = np.array(offset)
        self.seen = []

    def __call__(self, request):
        reply = super().__call__(request)
        if reply.region is None:
            return reply
        com, after = reply.com + self.offset, reply.com_after + self.offset
        margin = min(hull_margin(reply.region, com), hull_margin(reply.region, after))
        made = StanceVerdict(margin >= 0.0, margin, "ok", reply.region, com, after)
        self.seen.append((len(request.positions), made))
        return made


def test_the_trunk_moves_over_its_feet_before_a_leg_is_lifted():
    check = LoadedTrunk((-0.075, 0.0))
    p, outs = obeyed(MotionCommand("walk", distance=0.1), check=check)
    assert (outs[-1].state, p.walker.state.body[0]) == ("standing", pytest.approx(0.1, abs=0.02))
    first = next(i for i, out in enumerate(outs) if not out.stance.all())
    assert outs[first].margin >= PARAMS.least_margin_m
    assert any("the trunk moves" in out.reason for out in outs[:first])
    moved = p.walker.state.gait is p.walker.state.usual
    assert moved
    assert all(out.unreachable == 0 for out in outs)


def test_no_leg_is_ever_lifted_from_an_unstable_stance():
    for offset in ((-0.08, 0.0), (0.07, 0.03), (0.0, -0.09)):
        check = LoadedTrunk(offset)
        p = plant(check=check)
        outs = p.obey(MotionCommand("walk", distance=0.05), limit=120.0)
        for before, after in itertools.pairwise(outs):
            if after.steps == before.steps and before.stance.all() and not after.stance.all():
                assert after.margin is not None
                assert after.margin >= 0.0
        assert outs[-1].state in ("standing", "refused")


def test_a_step_that_no_shift_mends_is_taken_with_fewer_legs_and_the_old_gait_returns():
    lifted = []

    def check(request):
        lifted.append(ROBOT.nlegs - len(request.positions))
        safe = len(lifted) > 12 or len(request.positions) >= 4
        return StanceVerdict(safe, 0.05 if safe else -0.01, "ok")

    p, outs = obeyed(MotionCommand("walk", distance=0.2), check=check)
    assert (outs[-1].state, p.walker.state.body[0]) == ("standing", pytest.approx(0.2, abs=0.005))
    assert 2 in lifted
    assert (p.walker.state.gait.name, lifted[-3:]) == ("tripod", [3, 3, 3])


def test_when_nothing_helps_the_walk_is_refused_with_the_margin():
    _, outs = obeyed(MotionCommand("walk", distance=0.05), check=lambda request: StanceVerdict(False, -0.02, "ok"))
    assert (outs[-1].state, outs[-1].steps) == ("refused", 0)
    assert "-20 mm" in outs[-1].reason
    assert outs[-1].stance.all()
