"""Motions of ordered actions in time: evenly to the landing of the last step, and at an end where the walker stands."""

import pytest

from surefoot.schemas.cmd import WalkCommand
from surefoot.services.navigator.belief.tracker import Motion
from surefoot.services.navigator.execution import Execution
from surefoot.services.navigator.goals import Act, GaitView
from surefoot.services.navigator.orders import Orders

LAG = 0.1
STEP = Act("walk", "walk", Motion(forward=0.4, along=0.04), 4.0)


def under_way() -> Orders:
    """An order of 4 s that the walker took up at 0 s."""
    orders = Orders(LAG)
    orders.give(WalkCommand(action="walk", distance=0.4), STEP)
    orders.take_up(0.0, GaitView("walking", order=1, ends_in=4.0))
    return orders


def walked(execution: Execution, now: float) -> float:
    return sum(motion.forward for motion in execution.advance(now))


def test_the_way_is_walked_evenly_and_wholly_a_lag_behind_the_feet() -> None:
    execution = under_way().execution
    assert walked(execution, LAG) == 0.0
    assert walked(execution, LAG + 1.0) == pytest.approx(0.1)
    assert walked(execution, LAG + 3.0) == pytest.approx(0.2)
    assert not execution.empty
    assert walked(execution, LAG + 4.0) == pytest.approx(0.1)
    assert execution.empty


@pytest.mark.parametrize("stands_at", [0.05, 1.0, 3.9])
def test_a_walker_that_stands_has_ended_its_action_before_the_stated_time(stands_at: float) -> None:
    orders = under_way()
    before = walked(orders.execution, stands_at)
    for _ in range(2):  # reported in every tick
        orders.take_up(stands_at, GaitView("standing", order=1))
    after = walked(orders.execution, stands_at + LAG)
    assert before + after == pytest.approx(0.4)
    assert orders.execution.empty


def test_standing_between_steps_with_a_landing_ahead_ends_nothing() -> None:
    orders = under_way()
    orders.take_up(1.0, GaitView("standing", order=1, ends_in=3.0))
    assert walked(orders.execution, LAG + 1.0) == pytest.approx(0.1)
    assert not orders.execution.empty


def test_an_action_taken_up_while_standing_is_not_ended_with_the_one_before() -> None:
    orders = under_way()
    orders.give(WalkCommand(action="walk", distance=0.4), STEP)
    orders.take_up(2.0, GaitView("standing", order=2))
    assert walked(orders.execution, 2.0 + LAG) == pytest.approx(0.4)
    assert walked(orders.execution, 4.0 + LAG) == pytest.approx(0.2)


def test_a_forecast_moves_the_end() -> None:
    orders = under_way()
    orders.take_up(2.0, GaitView("walking", order=1, ends_in=6.0))
    assert walked(orders.execution, LAG + 4.0) == pytest.approx(0.2)
