"""Status of a system whose services or whose router do not answer: soon, and with what is the matter."""

import os
import socket
import threading

import pytest

from surefoot.errors import CallError
from surefoot.lab.cli import status_of as module
from surefoot.lab.cli.status_of import status_of
from surefoot.schemas.system import Health, HealthReply, ServiceStatus
from surefoot.services.supervisor.processes.rundir import Endpoint, RunFolder

NAMES = ("simulator", "estimator", "walker", "recorder")


@pytest.fixture
def silent(apart):
    """A run folder of a live supervisor, this process, at whose port connections are accepted and nothing answers."""
    folder = RunFolder("ragno")
    folder.acquire()
    with socket.create_server(("127.0.0.1", 0)) as server:
        folder.write_endpoint(Endpoint(f"tcp/127.0.0.1:{server.getsockname()[1]}", "surefoot/ragno"))
        folder.write_rows([ServiceStatus(service=name, state="healthy", pid=None, restarts=0) for name in NAMES])
        yield folder
    folder.release()


@pytest.mark.parametrize(
    ("state", "words"), [("T", "is stopped (`kill -CONT {pid}` lets it go on)"), ("R", "is busy or flooded by clients")]
)
def test_a_router_that_does_not_answer_is_named_with_its_process(silent, monkeypatch, state, words):
    monkeypatch.setattr(module, "ROUTER_MS", 200)
    monkeypatch.setattr(module, "_state", lambda pid: state)
    found = status_of(silent)
    assert [row["service"] for row in found["services"]] == list(NAMES)
    assert "does not answer within 0.2 s" in found["detail"]
    assert words.format(pid=os.getpid()) in found["detail"]
    assert "surefoot up" not in found["detail"], "it runs"


def test_all_services_are_asked_at_once(silent, monkeypatch):
    everyone = threading.Barrier(len(NAMES) + 2, timeout=20.0)  # with the supervisor and the state of time

    class Bus:
        def call(self, query, request, timeout_s):
            everyone.wait()
            service = query.key.rpartition("/")[2]
            if service in ("walker", "status"):
                raise CallError("timeout", f"{query.key!r} did not answer")
            health = Health(service=service, instance="x", state="running", pid=1, refused={"unbound": 2})
            return HealthReply(health=health)

    class Robot:
        bus = Bus()

        def __enter__(self):
            return self

        def __exit__(self, *_):
            pass

    monkeypatch.setattr(module, "joined", lambda *_: Robot())
    found = status_of(silent)
    rows = {row["service"]: row for row in found["services"]}
    assert rows["walker"]["detail"] == "'health/walker' did not answer"
    assert [rows[name]["doing"] for name in NAMES if name != "walker"] == ["running"] * 3
    assert found["supervisor"]["refused"] == {"unbound": 2}
    assert "time" not in found
