"""Strangers in processes of their own that serve a query of a service: a client gets the service's answer."""

import json
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from typing import Any

import pytest
import zenoh

import surefoot
from surefoot.schemas.topics import STABILITY_CHECK
from tests.e2e.live import START_S, Live, environment, wait_until
from tests.processes import run_process, running

pytestmark = pytest.mark.e2e

CORNERS = ((0.1, 0.1), (0.1, -0.1), (-0.1, 0.0))
REQUEST = {
    "contacts": [{"position": [x, y, 0.0], "normal": [0.0, 0.0, 1.0], "mu": 0.5} for x, y in CORNERS],
    "com": [0.0, 0.0],
}
STRANGER = """
import json, sys, zenoh
config = zenoh.Config.from_json5(json.dumps({"mode": "client", "connect": {"endpoints": [sys.argv[1]]}}))
kept = []

def wrong(asked):
    with asked:
        asked.reply(asked.key_expr, b'{"status": "infeasible", "stable": true, "margin": 9.0}')

with zenoh.open(config) as session:
    answers = {"wrong": wrong, "silent": kept.append}[sys.argv[3]]
    queryable = session.declare_queryable(sys.argv[2], answers, complete=True)
    print(session.zid(), flush=True)
    sys.stdin.read()
"""


@pytest.fixture(scope="module")
def live(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Live]:
    with Live(tmp_path_factory.mktemp("strangers")) as made:
        made.start(("stability",))
        yield made


@contextmanager
def strangers(live: Live, *kinds: str) -> Iterator[list[str]]:
    """Start strangers; yield the names of their sessions once queries reach them."""
    with ExitStack() as stack:
        names: list[str] = []
        for kind in kinds:
            command = [sys.executable, "-c", STRANGER, live.address, f"{live.namespace}/{STABILITY_CHECK.key}", kind]
            process = stack.enter_context(
                running(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, cwd=live.folder)
            )
            assert process.stdout is not None
            names.append(process.stdout.readline().strip())
        wait_until(lambda: asked(live) == (1, *sorted(kinds)), START_S, "queries reach the strangers")
        yield names


def asked(live: Live) -> tuple[int | str, ...]:
    """Return how many answers of the service a plain query of everybody gets, and which strangers it reaches."""
    query = live.bus.session.get(
        STABILITY_CHECK.key, payload=json.dumps(REQUEST), timeout=0.5,
        target=zenoh.QueryTarget.ALL, consolidation=zenoh.ConsolidationMode.NONE,
    )  # fmt: skip
    found: list[str] = []
    for reply in query:
        sample: Any = reply.ok or reply.err
        text = sample.payload.to_string()
        found.append("silent" if text == "Timeout" else "wrong" if '"margin": 9.0' in text else "right")
    return found.count("right"), *sorted(kind for kind in found if kind != "right")


def call(live: Live) -> subprocess.CompletedProcess[str]:
    words = ["call", STABILITY_CHECK.key, json.dumps(REQUEST), "--connect", live.address]
    return run_process(
        [sys.executable, "-m", "surefoot.lab.cli.main", *words, "--namespace", live.namespace],
        cwd=live.folder, env=environment(live.folder), capture_output=True, text=True,
    )  # fmt: skip


def test_a_client_gets_the_answer_of_the_service_beside_a_wrong_and_a_silent_one(live: Live) -> None:
    alone = call(live)
    assert alone.returncode == 0, alone.stderr
    fleet, robot = live.namespace.split("/")
    with strangers(live, "silent", "wrong") as names, surefoot.connect(robot, live.address, fleet) as client:
        for _ in range(10):
            began = time.monotonic()
            assert client.call(STABILITY_CHECK, **REQUEST).model_dump(mode="json") == json.loads(alone.stdout)
            assert time.monotonic() - began < STABILITY_CHECK.timeout_s
        assert set(client.bus.refused) <= {(STABILITY_CHECK.key, names[1])}
        beside = call(live)
        assert (beside.returncode, beside.stdout) == (0, alone.stdout)


def test_strangers_alone_answer_for_nobody_and_the_one_that_answers_is_named(live: Live) -> None:
    with strangers(live, "wrong") as names:
        live.stop(signal.SIGTERM)
        refused = call(live)
        assert refused.returncode == 1
        assert names[0] in refused.stderr
        assert "is not stability" in refused.stderr
