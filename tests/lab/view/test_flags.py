"""`--view` of `up` and `run`: a view of the right system in a process of its own, which ends with the command."""

from contextlib import contextmanager
from signal import SIGTERM
from types import SimpleNamespace

import pytest

from surefoot.lab.cli import system, view, viewing, warming
from surefoot.lab.cli.main import main
from surefoot.services.supervisor.processes import keep, rundir
from tests.ports import free_address

pytestmark = pytest.mark.usefixtures("apart")


class Process:
    """A process that is not started: its command, and the signal that it gets."""

    made: "list[Process]"

    def __init__(self, command, stdout):
        self.command, self.signal = command, None
        self.made.append(self)

    def __enter__(self):
        return self

    def __exit__(self, *_):
        assert self.signal == SIGTERM

    def send_signal(self, number):
        self.signal = number


@pytest.fixture
def address(monkeypatch):
    """An endpoint of a system that is started without its work; processes are only noted."""
    address = free_address()
    monkeypatch.setenv("SUREFOOT_LISTEN", address)
    monkeypatch.setattr(Process, "made", [], raising=False)
    monkeypatch.setattr(viewing.subprocess, "Popen", Process)
    monkeypatch.setattr(warming, "warm_if_cold", lambda *_: None)
    monkeypatch.setattr("surefoot.lab.cli.before.check_system", lambda *_: None)
    return address


def end(*_, **__):
    raise KeyboardInterrupt


@pytest.mark.parametrize("flag", [("--view",), ()], ids=["view", "none"])
@pytest.mark.parametrize("words", [("up", "ragno"), ("run", "stand")], ids=["up", "run"])
def test_a_view_of_the_started_system_waits_for_it_and_ends_with_it(monkeypatch, address, words, flag):
    monkeypatch.setattr(keep, "keep", end)
    monkeypatch.setattr("surefoot.lab.runs.live.conduct", end)
    with pytest.raises(SystemExit):
        main([*words, *flag])
    assert len(Process.made) == len(flag)
    for process in Process.made:
        asked = {}

        @contextmanager
        def seen(connect, namespace, robot, wait_s, asked=asked):
            asked.update(connect=connect, namespace=namespace, robot=robot, wait_s=wait_s)
            yield SimpleNamespace()

        monkeypatch.setattr(view, "seen", seen)
        monkeypatch.setattr(view, "view_system", lambda *_: None)
        with pytest.raises(SystemExit) as ended:  # the words of the process are a command that there is
            main(process.command[3:])
        assert ended.value.code == 0
        assert asked == {"connect": address, "namespace": "surefoot/ragno", "robot": "ragno", "wait_s": viewing.START_S}


def test_a_view_beside_a_detached_system_is_of_that_system_and_the_system_stays(monkeypatch, address):
    shown = []

    @contextmanager
    def seen(*place):
        yield place

    report = {"supervisor": 1, "endpoint": address, "services": []}
    monkeypatch.setattr(keep, "start_detached", lambda *_: report)
    monkeypatch.setattr(system, "_show_up", lambda *content, **_: shown.append(content))
    monkeypatch.setattr(system, "seen", seen)
    monkeypatch.setattr(system, "view_system", shown.append)
    with pytest.raises(SystemExit) as ended:
        main(["up", "ragno", "-d", "--view"])
    assert ended.value.code == 0
    assert shown == [("ragno", report), (address, "surefoot/ragno", "ragno")]
    assert not rundir.RunFolder("ragno").held()
