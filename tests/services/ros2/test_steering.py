"""Velocities become orders that are renewed while they come, and a stop when they do not."""

import pytest

from surefoot.services.ros2.steering import HORIZON_S, SILENT_S, Steering


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
