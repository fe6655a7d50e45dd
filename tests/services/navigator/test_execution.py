"""Motions of ordered actions in time: evenly to the landing of the last step, and at an end where the walker stands."""

import numpy as np
import pytest

from surefoot.schemas.cmd import WalkCommand
from surefoot.services.navigator.belief.tracker import Motion
from surefoot.services.navigator.execution import LANDING_S, Execution
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
    assert execution.pieces
    assert walked(execution, LAG + 4.0) == pytest.approx(0.1)
    assert not execution.pieces


@pytest.mark.parametrize("stands_at", [0.05, 1.0, 3.9])
def test_a_walker_that_stands_has_ended_its_action_before_the_stated_time(stands_at: float) -> None:
    orders = under_way()
    before = walked(orders.execution, stands_at)
    for _ in range(2):  # reported in every tick
        orders.take_up(stands_at, GaitView("standing", order=1))
    after = walked(orders.execution, stands_at + LAG)
    assert before + after == pytest.approx(0.4)
    assert not orders.execution.pieces


def test_standing_between_steps_with_a_landing_ahead_ends_nothing() -> None:
    orders = under_way()
    orders.take_up(1.0, GaitView("standing", order=1, ends_in=3.0))
    assert walked(orders.execution, LAG + 1.0) == pytest.approx(0.1)
    assert orders.execution.pieces


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


@pytest.mark.parametrize(("ends_in", "whole"), [(0.0, 0.1), (1.0, 0.2), (3.0, 0.4)])
def test_of_an_action_that_a_stop_ends_only_the_part_until_the_last_landing_is_walked(
    ends_in: float, whole: float
) -> None:
    orders = under_way()
    before = walked(orders.execution, LAG + 0.5)
    orders.give(WalkCommand(action="stop"), None)
    orders.take_up(0.9, GaitView("walking", order=1, ends_in=3.1))  # not taken up yet
    for now in (1.0, 1.1):
        orders.take_up(now, GaitView("walking", order=2, ends_in=ends_in + 1.0 - now))
    assert before + walked(orders.execution, 10.0) == pytest.approx(whole)
    assert not orders.execution.pieces


@pytest.mark.parametrize("walked_s", [0.0, 1.0, 2.0, 3.0])
def test_of_a_stop_without_a_forecast_the_step_under_way_lands_and_how_far_it_led_is_uncertain(walked_s: float) -> None:
    orders = under_way()
    ticks = [0.01 * k for k in range(1, round(100 * walked_s) + 1)]
    moved = [motion for now in ticks for motion in orders.execution.advance(now)]
    orders.give(WalkCommand(action="stop"), None)
    orders.take_up(walked_s, GaitView("stopping", order=2))
    moved += [motion for k in range(1, 1001) for motion in orders.execution.advance(walked_s + 0.01 * k)]
    forward, variance = sum(one.forward for one in moved), sum(one.along for one in moved)
    landings = np.random.default_rng(0).uniform(walked_s, walked_s + LANDING_S, 100_000)
    steps = 0.1 * landings  # m, 0.1 m a second
    assert forward == pytest.approx(float(steps.mean()), rel=0.01)
    assert variance - 0.1 * forward == pytest.approx(float(steps.var()), rel=0.02)
    assert not orders.execution.pieces
