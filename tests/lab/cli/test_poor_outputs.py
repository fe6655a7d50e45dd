"""Commands on poor outputs: a terminal of 40 columns, one without UTF-8, a pipe whose reader has gone."""

import io
import os
import sys
from contextlib import contextmanager, suppress
from types import SimpleNamespace

import pytest

from surefoot.bus.memory import MemoryBus
from surefoot.lab.cli import entry, status_of
from surefoot.lab.cli import topic as topics
from surefoot.lab.cli.output import EXIT_CHECK
from surefoot.schemas.hw import Imu
from surefoot.schemas.system import ServiceStatus
from surefoot.schemas.topics import HW_IMU, STATE_STABILITY
from surefoot.services.supervisor.processes.rundir import Endpoint, RunFolder
from tests.lab.cli.test_top import status

pytestmark = pytest.mark.usefixtures("apart")
TABLES = ("list", "robot list")
WORDS = "estimator m\u00fcde \u2192 silent for 2 s"
ODD = "B\u00f6ck\u2192"
COMMANDS = [
    "status",
    "topic top --once --window 0.1",
    "report {bag} -o {odd}.html",
    "why {bag}",
    "robot show ragno -o {odd}.png",
]
"""Outputs have characters that are not in ASCII: a remark of a service, the path of a file."""


@pytest.fixture
def around(monkeypatch, tmp_path):
    """A system that does not answer, with a remark on a service, and messages for `top`."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(status_of, "ROUTER_MS", 1)
    folder, bus = RunFolder("ragno"), MemoryBus()
    folder.acquire()
    folder.write_endpoint(Endpoint("tcp/127.0.0.1:11", "surefoot/ragno"))
    folder.write_rows([ServiceStatus(service="walker", state="down", pid=None, restarts=12, detail=WORDS)])

    @contextmanager
    def client(*_):
        yield SimpleNamespace(bus=bus)

    def send(_):
        bus.publisher(HW_IMU).put(Imu(acc=(0.0, 0.0, 9.81), gyro=(0.0, 0.0, 0.0)).stamped(0, 0, 1, 0, "driver"))
        bus.publisher(STATE_STABILITY).put(status().stamped(0, 0, 1, 0, "stability"))

    monkeypatch.setattr(topics, "client", client)
    monkeypatch.setattr(topics.time, "sleep", send)
    yield
    folder.release()


def written(monkeypatch, words, bag, encoding):
    """Return exit code and what a command writes, by the encoding of its output, to standard output and error."""
    streams = [io.TextIOWrapper(io.BytesIO(), encoding=encoding, write_through=True) for _ in range(2)]
    monkeypatch.setattr(sys, "stdout", streams[0])
    monkeypatch.setattr(sys, "stderr", streams[1])
    with pytest.raises(SystemExit) as ended:
        entry.main(words.format(bag=bag, odd=ODD).split())
    return ended.value.code, *(stream.buffer.getvalue().decode(encoding) for stream in streams)


@pytest.mark.parametrize("words", COMMANDS)
def test_an_output_without_a_character_gets_a_question_mark(around, monkeypatch, recorded, words):
    code, out, err = written(monkeypatch, words, recorded, "ascii")
    assert code in (0, EXIT_CHECK)
    assert ("?" in out) == any(each in words for each in ("status", "{odd}"))
    assert "Traceback" not in err
    assert "internal error" not in err


@pytest.mark.parametrize("words", [*COMMANDS, *TABLES, "--help", "run --help", "bag import --help", "param --help"])
def test_tables_and_help_fit_a_terminal_of_40_columns(around, monkeypatch, recorded, words):
    """Before, help texts were as wide as for 52 columns. A terminal breaks sentences, which have no columns, itself."""
    monkeypatch.setenv("COLUMNS", "40")
    code, out, _ = written(monkeypatch, words, recorded, "utf-8")
    assert code in (0, EXIT_CHECK)
    assert out
    assert [line for line in out.splitlines() if len(line) > 40 and ("  " in line or line.startswith("Usage"))] == []


@pytest.mark.parametrize("words", COMMANDS)
def test_a_reader_that_has_gone_ends_a_command_without_a_word(around, monkeypatch, capfd, recorded, words):
    reader, writer = os.pipe()
    os.close(reader)
    with suppress(BrokenPipeError), os.fdopen(writer, "w", encoding="utf-8") as out:  # what waits in it, at the end
        monkeypatch.setattr(sys, "stdout", out)
        monkeypatch.setattr(sys, "stderr", sys.stderr)  # both are wrapped by click, once the pipe is closed
        with pytest.raises(SystemExit) as ended:
            entry.main(words.format(bag=recorded, odd=ODD).split())
        assert ended.value.code == EXIT_CHECK
    err = capfd.readouterr().err
    assert "Traceback" not in err
    assert "error" not in err
