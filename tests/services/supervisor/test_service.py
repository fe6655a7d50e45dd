"""Heartbeats as the supervisor reads them."""

from types import SimpleNamespace
from typing import Any, cast

import pytest

from surefoot.lockstep.config import ServiceConfig
from surefoot.schemas.system import Health
from surefoot.schemas.topics import HEALTH
from surefoot.services.supervisor.service import Supervisor


@pytest.mark.parametrize(
    ("state", "heard"),
    [
        ("stopping", []),
        ("starting", [("walker", 17, False)]),
        ("compiling", [("walker", 17, False)]),
        ("running", [("walker", 17, True)]),
    ],
)
def test_a_heartbeat_of_stopping_says_nothing(state: str, heard: list[Any]) -> None:
    """A stranger can publish one; an end shows by itself, for the process is the supervisor's child."""
    found: list[Any] = []
    watched = SimpleNamespace(heard=lambda service, pid, well: found.append((service, pid, well)))
    supervisor = Supervisor(ServiceConfig(), watched=cast(Any, watched))
    supervisor.on_message(HEALTH, Health(service="walker", instance="x", state=cast(Any, state), pid=17))
    assert found == heard
