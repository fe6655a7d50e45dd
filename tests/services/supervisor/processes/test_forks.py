"""Services as forks of one process that has imported them: what each has of its own, and what happens without it."""

import os
import signal
import sys
from pathlib import Path

import pytest

from surefoot.lockstep import forking
from surefoot.services.supervisor.processes import forks as forks_module
from surefoot.services.supervisor.processes.compose import parse_compose
from surefoot.services.supervisor.processes.forks import ForkServer, fork_server
from surefoot.services.supervisor.processes.identity import await_end, identify
from surefoot.services.supervisor.processes.process import Child
from tests.processes import GRACE_S

PRINT = ("surefoot-service", "recorder", "--print-config")
WAITS = ("surefoot-service", "recorder", "--connect", "tcp/127.0.0.1:1")


@pytest.fixture(scope="module")
def forks():
    with ForkServer(["recorder"]) as server:
        assert server.ready(GRACE_S)
        yield server


def parent(pid):
    return int(Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[1])


def words_of(pid):
    return [word for word in Path(f"/proc/{pid}/cmdline").read_bytes().decode().split("\0") if word]


def test_a_fork_has_its_own_variables_log_and_exit_code(forks, tmp_path):
    child = Child("recorder", PRINT, {"SUREFOOT_RECORDER_PATH": "other.mcap"}, tmp_path / "one.log", forks)
    assert child.wait(GRACE_S) == 0
    assert '"path": "other.mcap"' in child.log.read_text()
    wrong = Child("recorder", (*PRINT[:2], "--nonsense"), {}, tmp_path / "two.log", forks)
    assert wrong.wait(GRACE_S) == 2
    assert "--nonsense" in wrong.last_words()
    assert "SUREFOOT_RECORDER_PATH" not in os.environ


def test_a_fork_is_a_child_of_the_supervisor_with_a_group_and_a_command_line_of_its_own(forks, tmp_path):
    child = Child("recorder", WAITS, {}, tmp_path / "one.log", forks)
    try:
        assert parent(child.pid) == os.getpid()
        assert os.getpgid(child.pid) == child.pid
        assert words_of(child.pid)[-3:] == ["recorder", *WAITS[2:]] or child.poll() is None
        assert child.identity.alive()
    finally:
        child.kill()
        assert child.wait(GRACE_S) == -signal.SIGKILL
    assert not child.identity.alive()


def test_a_fork_that_is_ended_while_it_starts_ends_with_zero(forks, tmp_path):
    child = Child("recorder", WAITS, {}, tmp_path / "one.log", forks)
    child.terminate()
    assert child.wait(GRACE_S) == 0


def test_forks_go_on_without_their_server(tmp_path):
    with ForkServer(["recorder"]) as server:
        assert server.ready(GRACE_S)
        child = Child("recorder", WAITS, {}, tmp_path / "one.log", server)
    try:
        assert child.poll() is None
    finally:
        child.kill()
        child.wait(GRACE_S)


def test_without_a_server_a_service_begins_by_itself(tmp_path):
    with ForkServer(["recorder"]) as server:
        assert server.ready(GRACE_S)
        os.kill(server.pid, signal.SIGKILL)
        child = Child("recorder", PRINT, {}, tmp_path / "one.log", server)
        assert child.wait(GRACE_S) == 0
        assert '"path"' in child.log.read_text()


def test_of_a_server_that_does_not_answer_in_time_no_fork_is_left(tmp_path, monkeypatch):
    monkeypatch.setattr(forks_module, "ANSWER_S", 0.05)
    with ForkServer(["recorder"]) as server:
        assert server.ready(GRACE_S)
        os.kill(server.pid, signal.SIGSTOP)
        child = Child("recorder", PRINT, {}, tmp_path / "one.log", server)
        assert child.wait(GRACE_S) == 0
        assert not Path(f"/proc/{server.pid}").exists()
        assert child.log.read_text().count('"path"') == 1


class Cut:
    """A connection whose other end is gone."""

    pid = 0

    def send(self, pid):
        self.pid = pid
        raise BrokenPipeError

    def close(self):
        return


def test_a_fork_whose_id_reaches_no_supervisor_ends(tmp_path):
    cut, log = Cut(), tmp_path / "one.log"
    with pytest.raises(BrokenPipeError):
        forking._fork(forking.Fork((), PRINT[1:], dict(os.environ), str(log)), cut)
    await_end([cut.pid], GRACE_S)
    assert identify(cut.pid) is None
    assert not log.exists()


def test_a_variable_that_an_import_reads_takes_a_process_of_its_own(forks):
    words = PRINT[1:]
    assert forks.serves(words, {"SUREFOOT_ROBOT": "nao"})
    assert not forks.serves(words, {"SUREFOOT_KERNELS": "plain"})
    assert not forks.serves(words, {"OPENBLAS_NUM_THREADS": "1"})
    assert not forks.serves(("walker",), {})
    with ForkServer(["recorder"], {"OPENBLAS_NUM_THREADS": "1", "SUREFOOT_ROBOT": "nao"}) as other:
        assert other.serves(words, {"OPENBLAS_NUM_THREADS": "1"})
        assert not other.serves(words, {})


def test_a_system_of_two_of_our_services_has_a_server():
    def services(*names):
        text = "services:\n" + "".join(f"  {name}: {{ command: {command} }}\n" for name, command in names)
        return parse_compose(text).services.values()

    own = f"{sys.executable} -c pass"
    assert fork_server(services(("a", own), ("recorder", "surefoot-service recorder"))) is None
    assert fork_server(services(("a", "surefoot-service own"), ("recorder", "surefoot-service recorder"))) is None
    server = fork_server(
        services(("a", own), ("ros2", "surefoot-service ros2"), ("recorder", "surefoot-service recorder"))
    )
    assert server is not None
    with server:
        assert server.services == {"ros2", "recorder"}
