"""Services on three hosts of a network: the hash of one host, whatever the network does meanwhile."""

import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import AbstractContextManager, ExitStack, contextmanager, nullcontext
from functools import cache
from pathlib import Path
from typing import Any, Self

import pytest

from surefoot.lab.runs.local import run_local
from surefoot.lockstep.local import LocalSystem
from surefoot.schemas.sim import ResetRequest
from surefoot.schemas.topics import SIM_RESET
from surefoot.services.supervisor.scenarios.scenario import Scenario, parse_scenario
from tests.e2e.hosts import Hosts
from tests.e2e.live import SERVICES, SHORT, START_S, Live, wait_until
from tests.processes import running

pytestmark = pytest.mark.e2e

AT_TICK = 100
"""Tick of a run in which something happens to the network, while the robot walks."""
PLACES = {"simulator": 0, "stability": 0, "estimator": 1, "walker": 1}
"""Host of each service; the others run beside the router and the supervisor. The walker asks services of both."""

ROUTER = """
import json, sys, threading, zenoh
config = zenoh.Config.from_json5(json.dumps({
    "mode": "router", "listen": {"endpoints": [sys.argv[1]]}, "connect": {"endpoints": [sys.argv[2]]},
    "scouting": {"multicast": {"enabled": False}},
}))
with zenoh.open(config):
    print("open", flush=True)
    threading.Event().wait()
"""
"""A router that knows nothing of this project, as `zenohd` is: where it listens, and the router that it joins."""


class Spread(Live):
    """A live system whose services run on several hosts."""

    def __init__(self, folder: Path, hosts: Hosts, second: bool = False) -> None:
        super().__init__(folder)
        self.hosts = hosts
        self.address = f"tcp/{hosts.here}:{self.port}"
        self.second = f"tcp/{hosts.address(0)}:{self.port}" if second else ""
        self.stack = ExitStack()

    def __enter__(self) -> Self:
        super().__enter__()
        if self.second:
            command = [*self.hosts.command(0), sys.executable, "-c", ROUTER, self.second, self.address]
            self.router = self.stack.enter_context(running(command, stdout=subprocess.PIPE))
            assert self.router.stdout is not None
            assert self.router.stdout.readline() == b"open\n"
        return self

    def __exit__(self, *end: Any) -> None:
        with self.stack:
            super().__exit__(*end)

    @contextmanager
    def without_second_router(self) -> Iterator[None]:
        """Kill the second router."""
        self.router.kill()
        yield

    def words(self, name: str, words: list[str]) -> list[str]:
        words = [*words, "--connect", self.second] if self.second else words
        if name not in PLACES:
            return [*words, "--listen", f"tcp/{self.hosts.here}:0"]
        number = PLACES[name]
        return [*self.hosts.command(number), *words, "--listen", f"tcp/{self.hosts.address(number)}:0"]


def scenario() -> Scenario:
    return parse_scenario(SHORT, Path("walk.toml"))


@cache
def on_one_host(epoch: int) -> str:
    """Return the hash of the walk in one process, as the run of an epoch: messages carry its number."""

    def reset_before(system: LocalSystem) -> None:
        for _ in range(epoch - 1):
            system.bus.call(SIM_RESET, ResetRequest())

    return run_local(scenario(), meddle=reset_before).run_hash


@pytest.fixture(scope="module")
def spread(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Spread]:
    with Hosts(2) as hosts, Spread(tmp_path_factory.mktemp("hosts"), hosts) as live:
        live.start(SERVICES)
        yield live


def walk_while(live: Spread, trouble: AbstractContextManager[None], seconds: float) -> None:
    """Check the hash of a walk in whose course a trouble lasts for some seconds."""

    def disturb() -> None:
        wait_until(lambda: AT_TICK <= live.supervisor.ticks < 2 * AT_TICK, START_S, f"tick {AT_TICK}")
        with trouble:
            threading.Event().wait(seconds)

    disturbing = threading.Thread(target=disturb, daemon=True)
    disturbing.start()
    outcome = live.conduct(scenario())
    disturbing.join(START_S)
    assert not disturbing.is_alive()
    assert outcome.verdict.ok, outcome.verdict
    assert outcome.run_hash == on_one_host(live.node.epoch)


def test_the_hash_is_that_of_one_host(spread: Spread) -> None:
    walk_while(spread, nullcontext(), 0.0)


@pytest.mark.parametrize(("number", "seconds"), [(1, 3.3), (0, 12.0), (1, 2.0), (1, 0.5), (0, 0.7)])
def test_a_partition_changes_nothing(spread: Spread, number: int, seconds: float) -> None:
    """Of those that walk, or of the driver, from all others; what the walker asks waits as its messages do.

    After one just longer than the lease Zenoh often leaves two processes without a link, and both linked to the router;
    after 10 s it has given up all links.
    """
    walk_while(spread, spread.hosts.cut(number), seconds)


@pytest.mark.parametrize(("number", "seconds"), [(1, 5.0), (0, 2.0)])
def test_connections_that_stand_and_carry_nothing_change_nothing(spread: Spread, number: int, seconds: float) -> None:
    walk_while(spread, spread.hosts.silent(number), seconds)


@pytest.mark.parametrize(
    "words", [("--delay", "0.002", "--loss", "0.01"), ("--jitter", "0.002", "--double", "0.05", "--loss", "0.005")]
)
def test_delay_loss_and_doubled_frames_change_nothing(spread: Spread, words: tuple[str, ...]) -> None:
    with spread.hosts.bad_link(1, *words) as counts:
        walk_while(spread, nullcontext(), 0.0)
    assert counts["passed"] > 1000
    assert counts["lost"] > 0
    assert (counts["doubled"] > 0) == ("--double" in words)


def test_the_end_of_one_of_two_routers_changes_nothing(tmp_path: Path) -> None:
    """The services know both, that of the supervisor and a plain one on another host, which is killed in the walk."""
    with Hosts(2) as hosts, Spread(tmp_path, hosts, second=True) as live:
        live.start(SERVICES)
        walk_while(live, live.without_second_router(), 1.0)
