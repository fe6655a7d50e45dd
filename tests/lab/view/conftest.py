"""A served view of a quiet system."""

from types import SimpleNamespace

import pytest

from surefoot.lab.view.live import LiveFrames
from surefoot.lab.view.page import live_page
from surefoot.lab.view.server import ViewServer
from surefoot.robot.reader import load_robot
from tests.lab.view.quiet import QuietClient

DONE = SimpleNamespace(accepted=True, reason="")


@pytest.fixture
def client():
    features = SimpleNamespace(queries=("sim/pause", "sim/push"), faults=("imu_drop",))
    return QuietClient({"sim/pause": DONE, "sim/push": DONE, "sim/features": features})


@pytest.fixture
def stops():
    return []


@pytest.fixture
def live(client, stops):
    frames = LiveFrames(client, load_robot("ragno"), lambda reason: (bool(not stops.append(reason)), "held"))
    yield frames
    frames.close()


@pytest.fixture
def warnings():
    return []


@pytest.fixture
def server(live, warnings):
    serving_now = ViewServer(live_page("surefoot/<ragno>"), live, 0, warnings.append)
    yield serving_now
    serving_now.close()
