"""Rules of every service folder, found by walking the tree."""

import importlib
import pkgutil
from typing import Any

import pytest

import surefoot.services
from surefoot.lockstep.driver import Driver
from surefoot.lockstep.graph import order
from surefoot.lockstep.join import DRIVER, Delayed
from surefoot.lockstep.service import Service
from surefoot.schemas.base import TickRequest
from surefoot.schemas.topics import CMD_ESTOP, QUERIES, SIM_TRUTH, TOPICS, Kind

NAMES = [m.name for m in pkgutil.iter_modules(surefoot.services.__path__) if m.ispkg]
JUDGES = {"recorder", "supervisor", "viewer"}
"""Services that may see the truth: those that record, check or show a run, never those that act in it."""


def service(name: str) -> type[Service[Any]]:
    found = importlib.import_module(f"surefoot.services.{name}.service").SERVICE
    assert issubclass(found, Service)
    return found


ALL = [service(name) for name in NAMES]


@pytest.mark.parametrize("name", NAMES)
def test_folder_service_and_entry_point_agree(name: str) -> None:
    assert service(name).name == name
    assert importlib.util.find_spec(f"services.{name}.__main__") is not None


@pytest.mark.parametrize("found", ALL, ids=NAMES)
def test_declarations_are_rows_of_the_table(found: type[Service[Any]]) -> None:
    topics = [item.topic if isinstance(item, Delayed) else item for item in found.inputs]
    assert all(topic in TOPICS for topic in (*topics, *found.outputs, *found.observes))
    assert all(query in QUERIES for query in (*found.serves, *found.calls))


@pytest.mark.parametrize("found", ALL, ids=NAMES)
def test_one_owner_per_key(found: type[Service[Any]]) -> None:
    mine = DRIVER if issubclass(found, Driver) else found.name
    for row in (*found.outputs, *found.serves):
        assert row.owner in (mine, "*") or row == CMD_ESTOP, f"{found.name} provides {row.key} of {row.owner}"


@pytest.mark.parametrize("found", ALL, ids=NAMES)
def test_no_function_service_reads_the_truth(found: type[Service[Any]]) -> None:
    keys = {(item.topic if isinstance(item, Delayed) else item).key for item in (*found.inputs, *found.observes)}
    assert (SIM_TRUTH.key not in keys) or found.name in JUDGES


@pytest.mark.parametrize("found", [found for found in ALL if found.batched], ids=lambda found: found.name)
def test_nobody_waits_within_a_tick_for_a_service_that_takes_ticks_in_batches(found: type[Service[Any]]) -> None:
    assert not any(topic.framed for topic in found.outputs)
    one = found(found.Config())  # by its configuration it may take single ticks
    assert one.batched
    per_tick = [item for item in one.inputs if isinstance(item, Delayed) or item.kind is not Kind.LATCHED]
    assert not per_tick or not any(issubclass(query.request, TickRequest) for query in found.serves)


def test_every_row_has_a_provider() -> None:
    # hw/external comes from drivers of robots with a camera or motion capture; the simulator has neither
    provided = {row.key for found in ALL for row in (*found.outputs, *found.serves)}
    for row in (*TOPICS, *QUERIES):
        if row.owner not in ("*",) and row.key not in ("hw/tick", "hw/external", "supervisor/status"):
            assert row.key in provided, f"nobody provides {row.key}"


def test_no_cycle_within_a_tick() -> None:
    names = order(ALL)
    assert names.index("simulator") < names.index("estimator") < names.index("walker")
    assert names.index("footholds") < names.index("walker")
