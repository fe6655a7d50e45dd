"""Velocities become orders that are renewed while they come, and a stop when they do not."""

import math

import pytest

from surefoot.services.ros2.steering import AGAIN_S, FASTEST_MPS, FASTEST_RADPS, HORIZON_S, SILENT_S, Steering


def test_walks_while_velocities_come_and_stops_after_them() -> None:
    steering, orders = Steering(), []
    for k in range(500):
        now = 0.01 * k
        if now < 3.0 and k % 10 == 0:
            steering.take(now, 0.05, 0.0)
        if (order := steering.order(now)) is not None:
            orders.append((now, order))
    assert [order.action for _, order in orders] == ["walk"] * 4 + ["stop"]
    assert orders[1][0] == pytest.approx(0.5 * HORIZON_S)
    assert orders[-1][0] == pytest.approx(2.9 + SILENT_S, abs=0.02)
    assert orders[0][1].velocity == 0.05
    assert orders[0][1].angle is None


def test_a_robot_without_arcs_turns_first() -> None:
    steering = Steering()
    steering.take(0.0, 0.05, 0.5)
    arc = steering.order(0.0)
    assert arc is not None
    assert (arc.action, arc.angle) == ("walk", 1.0)
    steering.refused("unsupported")
    turn = steering.order(0.01)
    assert turn is not None
    assert (turn.action, turn.angle) == ("turn", 1.0)


def test_standing_still_orders_nothing() -> None:
    steering = Steering()
    assert steering.order(0.0) is None
    steering.take(0.0, 0.001, 0.0)
    assert steering.order(0.0) is None


@pytest.mark.parametrize(("forward", "turn"), [(math.nan, 0.0), (0.05, math.nan), (math.inf, 0.0), (0.0, -math.inf)])
def test_velocities_that_are_no_numbers_stop_the_robot(forward: float, turn: float) -> None:
    steering = Steering()
    steering.take(0.0, 0.05, 0.0)
    assert steering.order(0.0) is not None
    steering.take(0.1, forward, turn)
    stop = steering.order(0.1)
    assert stop is not None
    assert stop.action == "stop"
    assert steering.order(0.11) is None


def test_huge_velocities_are_cut() -> None:
    steering = Steering()
    steering.take(0.0, -1e300, 1e300)
    order = steering.order(0.0)
    assert order is not None
    assert (order.velocity, order.angle) == (-FASTEST_MPS, HORIZON_S * FASTEST_RADPS)


def test_a_stop_that_was_not_answered_is_given_again_while_the_robot_may_walk() -> None:
    steering, stops = Steering(), []
    steering.take(0.0, 0.05, 0.0)
    assert steering.order(0.0) is not None
    steering.take(0.1, 0.0, 0.0)
    for k in range(10, 1000):
        if (order := steering.order(0.01 * k)) is not None:
            stops.append((0.01 * k, order.action))
            steering.unanswered(0.01 * k)
    assert {action for _, action in stops} == {"stop"}
    assert stops[1][0] == pytest.approx(stops[0][0] + AGAIN_S, abs=0.011)
    assert HORIZON_S < stops[-1][0] <= 0.1 + SILENT_S + HORIZON_S + 0.011
