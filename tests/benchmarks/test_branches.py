"""Steps from one state: an arm with the walk's own choice is the walk itself, and forking leaves no trace in it."""

import os
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from benchmarks.branches import Arm, PairedState, gap_share, paired_steps, trimmed
from benchmarks.rivals import nominal_rule
from surefoot.lab.footholds.rules import model_rule, random_rule
from surefoot.lab.footholds.walks import JoinedWalk, Rule, Setting
from surefoot.services.footholds.models.score import HandScore
from surefoot.services.footholds.select import Foothold, SelectParams

SHORT = Setting("rough", 0.25, 0.04, 0.5, profile="exact")


def raises(*_: object) -> Sequence[Foothold]:
    raise RuntimeError("a rule that fails")


def candidates() -> dict[str, Rule]:
    return {
        "nominal": nominal_rule(),
        "again": nominal_rule(),
        "hand": model_rule(HandScore(), SelectParams()),
        "random": random_rule(9),
    }


@pytest.fixture(scope="module", params=[True, False], ids=["one", "all"])
def compared(request: pytest.FixtureRequest) -> tuple[bool, JoinedWalk, list[PairedState]]:
    return request.param, *paired_steps(4, SHORT, nominal_rule(), candidates(), every=5, alone=request.param)


def test_the_walk_goes_on_as_if_nothing_had_been_asked(compared: tuple[bool, JoinedWalk, list[PairedState]]) -> None:
    _, joined, _ = compared
    plain = JoinedWalk(4, SHORT, nominal_rule())
    while plain.tick():
        pass
    assert joined.stances.sliding == plain.stances.sliding
    assert joined.world.tick == plain.world.tick


def test_an_arm_with_the_own_choice_is_the_walk_itself(compared: tuple[bool, JoinedWalk, list[PairedState]]) -> None:
    alone, joined, states = compared
    whole = 0
    for state in states:
        assert len(state.legs) == (1 if alone else 3)
        own = {s.leg: s for s in joined.stances.found if s.step == state.step and s.leg in state.legs}
        arms = {arm.name: arm for arm in state.arms}
        assert arms["nominal"].stances == arms["again"].stances
        for stance in arms["nominal"].stances:
            if stance.leg in own:
                assert stance.sliding == own[stance.leg].sliding
                assert stance.planned == own[stance.leg].planned
                whole += 1
        other = [stance.planned for stance in arms["random"].stances]
        assert not set(other) & {stance.planned for stance in arms["nominal"].stances}
    assert whole >= len(states) - 1 > 0


def test_a_rule_that_fails_fails_in_the_parent() -> None:
    with pytest.raises(RuntimeError, match="a rule that fails"):
        paired_steps(4, replace(SHORT, distance=0.1), nominal_rule(), {"bad": raises}, every=1)


def test_an_error_in_a_child_is_one_of_the_comparison(capfd: pytest.CaptureFixture[str]) -> None:
    parent = os.getpid()

    def breaks(*args: object) -> Sequence[Foothold]:
        if os.getpid() != parent:
            raise ValueError("in the child")
        return nominal_rule()(*args)  # type: ignore[arg-type]

    with pytest.raises(RuntimeError, match="step 1 ended without a report"):
        paired_steps(4, replace(SHORT, distance=0.1), breaks, {"nominal": nominal_rule()}, every=1)
    assert "in the child" in capfd.readouterr().err


def test_states_without_an_outcome_are_not_a_number() -> None:
    state = PairedState(3, (1,), (Arm("a", ()),))
    assert np.isnan(state.sliding(state.arms[0]))


def test_share_of_the_gap() -> None:
    random = [np.array([2.0, 4.0]), np.array([1.0, 3.0])]
    best = np.array([1.0, 0.5])
    assert gap_share(random, best, best) == 1.0
    assert gap_share(random, np.array([3.0, 2.0]), best) == 0.0
    assert gap_share(random, np.array([2.0, 1.25]), best) == pytest.approx(0.5)
    values = np.arange(100.0)
    values[0] = 1e6
    assert trimmed(values) == pytest.approx(np.sort(values)[5:95].mean())
    assert trimmed(np.array([1.0, 2.0, 6.0])) == 3.0
