"""A system from up to down, with processes that do nothing: router, run folder, restarts, leftovers, busy port."""

import os
import shutil
import signal
import socket
import threading
import time
from pathlib import Path
from types import SimpleNamespace

import pytest

from surefoot.bus.interface import Life
from surefoot.bus.tokens import MOST_FOREIGN
from surefoot.bus.zenoh import ZenohBus, ZenohOptions
from surefoot.errors import BusError
from surefoot.lab.cli.status_of import status_of
from surefoot.lab.cli.system import _show_status as show_status
from surefoot.robot.reader import ROBOTS
from surefoot.schemas.sim import World
from surefoot.schemas.status import SimStatus
from surefoot.services.supervisor.processes.compose import parse_compose
from surefoot.services.supervisor.processes.keep import StartOrder, keep
from surefoot.services.supervisor.processes.rundir import RunFolder, RunFolderError
from surefoot.services.supervisor.processes.session import Session

WAIT_S = 80.0  # s wall; takes less than 1
IDLE = """
name: idle
services:
  a: {command: [python, -c, "import time; time.sleep(60)"], restart: on-failure, healthcheck: {disable: true}}
  b: {command: [python, -c, "import time; time.sleep(60)"], depends_on: [a], healthcheck: {disable: true}}
"""
BROKEN = """
name: idle
services:
  a: {command: [python, -c, "import sys; sys.exit('no such sensor')"], healthcheck: {disable: true}}
"""


def pids(session):
    return {row.service: row.pid for row in session.system.rows() if row.pid is not None}


def lives(session, instance, alive, *names):
    """Report tokens of one instance of services as the bus does."""
    for name in names:
        session._on_life(Life(name, instance, alive=alive))


def gone(pid):
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return True
    return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] == "Z"


def test_leaves_nothing_behind(listen):
    with Session(parse_compose(IDLE), listen=listen) as session:
        assert session.wait_for(session.system.settled, WAIT_S)
        found = pids(session)
        assert set(found) == {"a", "b"}
        endpoint = RunFolder("idle").endpoint()
        assert endpoint.connect == listen
        assert set(RunFolder("idle").processes()) == {"a", "b"}
    assert all(gone(pid) for pid in found.values())
    assert not RunFolder("idle").held()
    assert [path.name for path in RunFolder("idle").path.iterdir() if path.is_file()] == ["lock"]


def test_strange_tokens_are_shown_by_status_and_processes_know_the_names_of_their_system(listen, capsys):
    with Session(parse_compose(IDLE), listen=listen) as session:
        assert session.wait_for(session.system.settled, WAIT_S)
        environments = [Path(f"/proc/{pid}/environ").read_bytes().split(b"\0") for pid in pids(session).values()]
        assert all(b"SUREFOOT_SERVICES=a,b,supervisor" in one for one in environments)
        stranger = ZenohBus(ZenohOptions("client", (listen,), (), session.namespace))
        try:
            for number in range(3 * MOST_FOREIGN):
                stranger.announce(f"zz{number}", "x")
            counted = {"foreign_token": 3 * MOST_FOREIGN}
            assert session.wait_for(lambda: status_of(session.folder)["supervisor"]["refused"] == counted, WAIT_S)
            found = status_of(session.folder)
            assert len(session.alive) <= MOST_FOREIGN + 1
            assert list(session.health()) == ["supervisor"]
        finally:
            stranger.close()
    show_status("idle", found)
    assert f"supervisor: {3 * MOST_FOREIGN}x foreign_token\n" in capsys.readouterr().out


def test_a_system_without_a_driver_is_reported(listen, monkeypatch):
    monkeypatch.setattr("surefoot.services.supervisor.processes.keep.DRIVER_S", 0.1)
    monkeypatch.setattr(Session, "alive", ("a", "b"))
    with pytest.raises(BusError, match=r"no service of compose\.yaml drives") as caught:
        keep(parse_compose(IDLE), StartOrder(World()), threading.Event(), listen=listen)
    assert caught.value.code == "not_ready"


def test_a_driver_that_comes_back_each_time_is_not_missed(listen, monkeypatch):
    """Between the token of a service started anew and that of the driver a moment may pass, after each restart."""
    stop, looks = threading.Event(), []

    def driving(session, service):
        looks.append(service)
        if len(looks) == 40:
            stop.set()
        return "" if len(looks) % 2 else "1"

    clock = SimpleNamespace(monotonic=lambda: float(len(looks)))  # a second passes between two looks
    monkeypatch.setattr("surefoot.services.supervisor.processes.keep.time", clock)
    monkeypatch.setattr(Session, "alive", ("a", "b"))
    monkeypatch.setattr(Session, "instance_of", driving)
    monkeypatch.setattr(Session, "answers", lambda session, query: False)
    keep(parse_compose(IDLE), StartOrder(World()), stop, listen=listen)
    assert len(looks) >= 40


def test_tokens_of_strangers_do_not_take_the_driver_away(listen):
    with Session(parse_compose(IDLE), listen=listen) as session:
        for name, instance in (("a", "1"), ("driver", "1"), ("driver", "x"), ("b", "2"), ("b", "y")):
            session._on_life(Life(name, instance, alive=True))
        assert session.wait_for(lambda: "supervisor" in session.alive, WAIT_S)
        assert (session.driver, session.instance_of("a"), session.instance_of("driver")) == ("a", "1", "1")
        session.supervisor.status = SimStatus(state="running", rtf=0.0, ticks=7, comparable=True, stopped="test")
        for name, instance in (("driver", "x"), ("b", "y")):
            session._on_life(Life(name, instance, alive=False))
        assert (session.driver, session.alive) == ("a", ("a", "b", "supervisor"))
        assert session._stop == ""  # the driver that obeyed the stop is still there


def test_a_token_of_a_driver_alone_makes_no_driver(listen):
    with Session(parse_compose(IDLE), listen=listen) as session:
        lives(session, "1", True, "a")
        lives(session, "x", True, "driver")  # no service of ours shows this instance
        assert (session.driver, session.instance_of("driver")) == ("", "")
        lives(session, "1", True, "driver")
        assert (session.driver, session.instance_of("driver")) == ("a", "1")


@pytest.mark.parametrize("order", [("a", "driver"), ("driver", "a")])
def test_a_stop_outlives_its_driver(listen, order):
    stopped = SimStatus(state="running", rtf=0.0, ticks=7, tick=6, comparable=True, stopped="test")
    with Session(parse_compose(IDLE), listen=listen) as session:
        lives(session, "1", True, "a", "driver")
        lives(session, "1", False, *order)  # the network reports the tokens of a process that is gone in any order
        session.supervisor.status = stopped  # read after its driver went
        lives(session, "2", True, "a", "driver")
        session.step()
        assert session._stop == "test"
        assert not session.calm()
        session.supervisor.status = stopped.model_copy()  # of the new driver
        session.step()
        assert session._stop == ""


def test_status_reports_why_a_run_has_ended(listen):
    with Session(parse_compose(IDLE), listen=listen) as session:
        session.supervisor.status = SimStatus(state="ended", rtf=0.0, ticks=7, comparable=True, failed="it diverged")
        lives(session, "1", True, "a", "driver")
        assert {row.service: row.detail for row in session.rows()} == {"a": "it diverged", "b": ""}
        session._on_life(Life("driver", "1", alive=False))  # the next one reports its own state
        assert {row.detail for row in session.rows()} == {""}


def test_stops_everything_when_the_caller_fails(listen):
    found = {}

    def fail():
        with Session(parse_compose(IDLE), listen=listen) as session:
            session.wait_for(session.system.settled, WAIT_S)
            found.update(pids(session))
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        fail()
    assert len(found) == 2
    assert all(gone(pid) for pid in found.values())


def test_a_killed_process_is_started_again(listen):
    with Session(parse_compose(IDLE), listen=listen) as session:
        session.wait_for(session.system.settled, WAIT_S)
        before = pids(session)
        os.kill(before["a"], signal.SIGKILL)
        assert session.wait_for(lambda: pids(session).get("a", before["a"]) != before["a"], WAIT_S)
        assert pids(session)["b"] == before["b"]
        assert next(row.restarts for row in session.system.rows() if row.service == "a") == 1


def test_a_service_that_does_not_run_is_reported_with_its_last_words(listen):
    with Session(parse_compose(BROKEN), listen=listen) as session, pytest.raises(BusError) as caught:
        session.wait_for(lambda: False, WAIT_S)
    assert caught.value.code == "service_failed"
    assert "no such sensor" in caught.value.message
    assert "a.log" in caught.value.message


def test_a_busy_port_names_owner_and_flag(listen):
    with socket.socket() as other:
        other.bind(("127.0.0.1", int(listen.rpartition(":")[2])))
        other.listen()
        with pytest.raises(BusError) as caught, Session(parse_compose(IDLE), listen=listen):
            pytest.fail("it must not start")
    assert caught.value.code == "busy"
    assert f"process {os.getpid()}" in caught.value.message
    assert "--listen" in caught.value.message
    assert not RunFolder("idle").held()


def test_the_same_system_runs_once(listen):
    with Session(parse_compose(IDLE), listen=listen):
        with pytest.raises(RunFolderError, match="surefoot down idle"), Session(parse_compose(IDLE), listen=listen):
            pytest.fail("it must not start twice")
        assert RunFolder("idle").held()


def test_is_kept_until_the_end_is_asked_for(listen):
    stop, lines = threading.Event(), []
    thread = threading.Thread(
        target=keep,
        args=(parse_compose(IDLE), StartOrder(World()), stop),
        kwargs={"listen": listen, "notify": lines.append},
    )
    thread.start()
    folder = RunFolder("idle")
    deadline = time.monotonic() + WAIT_S
    try:
        while {row["state"] for row in folder.read_rows()} != {"healthy"} and time.monotonic() < deadline:
            stop.wait(0.02)
        rows = folder.read_rows()
    finally:
        stop.set()
        thread.join(WAIT_S)
    assert not thread.is_alive()
    assert [row["service"] for row in rows] == ["a", "b"]
    assert lines[0].startswith("start a")
    assert all(gone(row["pid"]) for row in rows)


def test_a_robot_given_as_a_folder_gives_its_name_to_the_namespace(listen, monkeypatch, tmp_path):
    monkeypatch.delenv("SUREFOOT_NAMESPACE", raising=False)
    monkeypatch.setenv("SUREFOOT_ROBOT", str(tmp_path / "mybot"))
    shutil.copytree(ROBOTS / "ragno", tmp_path / "mybot")
    with Session(parse_compose(IDLE), listen=listen) as session:
        assert (session.namespace, session.robot) == ("surefoot/mybot", str(tmp_path / "mybot"))
