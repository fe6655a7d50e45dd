"""The foothold service in a system on the bus in memory."""

from collections.abc import Iterator

import pytest

from surefoot.lockstep.local import LocalSystem
from surefoot.services.footholds.service import Footholds
from tests.services.footholds.grounds import flat
from tests.services.footholds.test_footholds_service import give, message


@pytest.fixture
def service(request: pytest.FixtureRequest) -> Iterator[Footholds]:
    """The service with the configuration `CONFIG` of the test's file."""
    one = Footholds(request.module.CONFIG)
    system = LocalSystem([one])
    yield one
    system.close()


@pytest.fixture
def mapped(service: Footholds) -> Footholds:
    """The service with a map of flat ground."""
    give(service, message(flat()))
    return service
