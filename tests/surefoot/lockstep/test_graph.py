"""The order of services comes from what they declare; a cycle within a tick is found before anything starts."""

from typing import Any

import pytest

from surefoot.lockstep.config import ServiceConfig
from surefoot.lockstep.driver import Driver
from surefoot.lockstep.graph import edges, order
from surefoot.lockstep.join import Delayed
from surefoot.lockstep.service import Service
from surefoot.schemas.topics import CMD_JOINTS, FOOTHOLDS_SELECT, HW_IMU, STATE_GAIT, STATE_STABILITY, STATE_VELOCITY


def made(name: str, base: type[Service[Any]] = Service, **declared: Any) -> type[Service[ServiceConfig]]:
    return type(name.title(), (base,), {"name": name, **declared})


MOTORS = made("motors", Driver, outputs=(HW_IMU,))
ESTIMATOR = made("estimator", inputs=(HW_IMU,), outputs=(STATE_VELOCITY,))
WALKER = made("walker", inputs=(STATE_VELOCITY,), outputs=(CMD_JOINTS, STATE_GAIT), calls=(FOOTHOLDS_SELECT,))
FOOTHOLDS = made("footholds", serves=(FOOTHOLDS_SELECT,))
ALL = [WALKER, FOOTHOLDS, ESTIMATOR, MOTORS]


def test_order_follows_topics_and_queries() -> None:
    names = order(ALL)
    assert names.index("motors") < names.index("estimator") < names.index("walker")
    assert names.index("footholds") < names.index("walker")
    assert order(reversed(ALL)) == names


def test_the_command_closes_the_loop_a_tick_later() -> None:
    (command,) = [edge for edge in edges(ALL) if edge.key == CMD_JOINTS.key]
    assert (command.source, command.target, command.delayed) == ("walker", "motors", True)


def test_a_cycle_of_topics_is_named() -> None:
    stability = made("stability", inputs=(STATE_GAIT,), outputs=(STATE_STABILITY,))
    walker = made("walker", inputs=(STATE_STABILITY,), outputs=(STATE_GAIT,))
    with pytest.raises(ValueError, match=r"stability, walker") as caught:
        order([MOTORS, stability, walker])
    assert "motors" not in str(caught.value)


def test_a_cycle_through_a_query_is_a_cycle() -> None:
    footholds = made("footholds", inputs=(STATE_GAIT,), serves=(FOOTHOLDS_SELECT,))
    with pytest.raises(ValueError, match="footholds, walker"):
        order([MOTORS, ESTIMATOR, WALKER, footholds])


def test_feedback_of_the_tick_before_is_no_cycle() -> None:
    stability = made("stability", inputs=(STATE_GAIT,), outputs=(STATE_STABILITY,))
    walker = made("walker", inputs=(Delayed(STATE_STABILITY),), outputs=(STATE_GAIT,))
    assert order([MOTORS, stability, walker]) == ["motors", "walker", "stability"]


def test_absent_services_bind_nobody() -> None:
    assert order([WALKER]) == ["walker"]
