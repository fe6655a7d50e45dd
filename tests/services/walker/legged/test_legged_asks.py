"""Requests of the hexapod to footholds and stability before a step, and its use of the answers."""

import numpy as np
import pytest

from surefoot.services.walker.interface import BodyPose, FootholdReply, MotionCommand, StanceVerdict
from surefoot.services.walker.legged import planning
from surefoot.services.walker.legged.standins import nominal_footholds
from tests.services.walker.legged.plant import PARAMS, ROBOT, obeyed, plant


def test_footholds_of_the_selector_are_stepped_on():
    asked = []

    def select(request):
        asked.append(request)
        return [FootholdReply("ok", (leg.nominal[0] + 0.01, leg.nominal[1], leg.nominal[2])) for leg in request.legs]

    p, outs = obeyed(MotionCommand("walk", distance=0.15), select=select)
    assert outs[-1].state == "standing"
    assert all(len(request.legs) == 3 for request in asked)  # one question for a whole tripod
    assert len(asked) == outs[-1].steps
    walking = [request.legs[0].stroke for request in asked[1:-3]]
    assert all(stroke[0] == pytest.approx(-0.025, abs=1e-3) for stroke in walking)
    assert (np.abs(p.walker.state.footholds[:, 2] - ROBOT.foot_radius) < 0.01).all()


def test_infeasible_footholds_shorten_the_step_and_end_in_a_refusal_with_the_reason():
    strokes = []

    def select(request):
        strokes.append(abs(request.legs[0].stroke[0]))
        return [FootholdReply("infeasible", None, 0.0, "water") for _ in request.legs]

    p, outs = obeyed(MotionCommand("walk", distance=0.3), select=select)
    assert outs[-1].state == "refused"
    assert "water" in outs[-1].reason
    assert len(strokes) == PARAMS.max_attempts
    assert strokes[-1] < 0.2 * strokes[0]
    assert outs[-1].stance.all()
    assert p.walker.command(MotionCommand("stand")).accepted
    p.step()
    assert p.out.state == "standing"


def test_raise_trunk_moves_the_trunk_and_then_the_step_is_taken():
    shifts = [0.02]

    def select(request):
        if shifts:
            dz = shifts.pop()
            return [FootholdReply("raise_trunk", None, dz) for _ in request.legs]
        return nominal_footholds(request)

    p, outs = obeyed(MotionCommand("walk", distance=0.1), select=select)
    assert max(o.trunk_height for o in outs) == pytest.approx(PARAMS.hip_height_m + 0.02, abs=0.003)
    assert p.walker.state.body[0] == pytest.approx(0.1, abs=0.005)


def test_a_trunk_too_high_for_a_foot_moves_down_before_the_step():
    """A foot in a hollow, the trunk raised for earlier steps: no shorter step had helped, the walk had ended."""
    p = plant()
    p.run(1.0)
    state = p.walker.state
    state.footholds[1, 2] -= 0.12
    state.feet[1, 2] -= 0.12
    state.body[2] += 0.03
    begin = BodyPose(*state.body, state.yaw)
    assert not planning.reaches(p.walker.frame, begin, begin, state.footholds, 1.0)
    outs = p.obey(MotionCommand("walk", distance=0.1))
    assert any("does not reach where it stands, trunk moves by -" in o.reason for o in outs)
    assert (outs[-1].state, state.body[0]) == ("standing", pytest.approx(0.1, abs=0.005))


def test_unstable_steps_are_shortened_then_refused():
    moves = []

    def check(request):
        moves.append(request.movement[0])
        return StanceVerdict(stable=abs(request.movement[0]) < 0.008, margin=-0.01)

    p, outs = obeyed(MotionCommand("walk", distance=0.05), check=check)
    assert (outs[-1].state, p.walker.state.body[0]) == ("standing", pytest.approx(0.05, abs=0.005))
    assert any(abs(move) > 0.008 for move in moves)
    p, outs = obeyed(
        MotionCommand("walk", distance=0.05), check=lambda request: StanceVerdict(False, -0.02, "infeasible")
    )
    assert (outs[-1].state, outs[-1].steps) == ("refused", 0)
    assert "infeasible" in outs[-1].reason


def test_the_check_sees_the_standing_feet_and_the_movement():
    seen = []

    def check(request):
        seen.append(request)
        return StanceVerdict(True, 0.05)

    obeyed(MotionCommand("walk", distance=0.1), check=check)
    request = seen[1]
    assert request.positions.shape == (3, 3)
    assert request.positions[:, 2] == pytest.approx(np.zeros(3), abs=2e-3)
    assert request.movement[0] == pytest.approx(0.025, abs=1e-3)
    assert request.joints.shape == (ROBOT.nj,)
