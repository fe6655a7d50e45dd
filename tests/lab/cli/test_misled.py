"""Mistakes that once misled users of the command line: which system is meant, late errors, overwritten files."""

import json
import re
import socket
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest

from surefoot import client
from surefoot.bus.zenoh import ZenohBus, ZenohOptions
from surefoot.client import make_request, query_named, topic_named
from surefoot.errors import ConfigError
from surefoot.lab.cli import main as cli
from surefoot.lab.cli.connect import endpoint
from surefoot.lab.cli.stopping import Stopped, report
from surefoot.schemas.system import ServiceStatus
from surefoot.schemas.topics import STATE_VELOCITY
from surefoot.services.supervisor.processes.rundir import Endpoint, RunFolder
from tests.ports import free_address
from tests.processes import run_process
from tests.surefoot.toys import estimate

ROOT = Path(__file__).parents[3]
CALL = re.compile(r"surefoot call (\S+) '([^'\n]*)'")
STRIDE = "SUREFOOT_WALKER_STRIDE_M"
pytestmark = pytest.mark.usefixtures("apart")


def test_a_stop_that_reaches_no_system_says_so_in_json(in_process):
    code, out, _ = in_process("stop", "--json")
    assert code == cli.EXIT_CHECK
    (found,) = json.loads(out)["systems"]
    assert (found["driver"], found["stopped"]) == ("", "")
    assert "no system answers" in found["detail"]


@pytest.fixture
def two_systems():
    """Run folders of two running systems."""
    folders = [RunFolder(name) for name in ("ragno", "nao")]
    for number, folder in enumerate(folders):
        folder.acquire()
        folder.write_endpoint(Endpoint(f"tcp/127.0.0.1:{11 + number}", f"surefoot/{folder.name}"))
    yield {folder.name: folder for folder in folders}
    for folder in folders:
        folder.release()


@pytest.fixture
def no_endpoint(monkeypatch):
    monkeypatch.delenv("SUREFOOT_CONNECT", raising=False)
    monkeypatch.delenv("SUREFOOT_LISTEN", raising=False)


@pytest.mark.parametrize(
    "words", [["call", "sim/features"], ["topic", "echo", "state/gait"], ["sim", "pause"], ["health", "walker"]]
)
def test_a_command_that_could_mean_several_systems_refuses_with_their_names(complaint, two_systems, no_endpoint, words):
    err = complaint(*words)
    assert "2 systems run: nao (surefoot/nao" in err
    assert "ragno (surefoot/ragno" in err


def test_the_system_that_listens_where_this_shell_says_is_meant(two_systems, no_endpoint, monkeypatch):
    with pytest.raises(ConfigError, match="2 systems run"):
        endpoint()
    monkeypatch.setenv("SUREFOOT_LISTEN", "tcp/127.0.0.1:12")
    assert endpoint() == ("tcp/127.0.0.1:12", "surefoot/nao")
    assert endpoint(namespace="surefoot/ragno") == ("tcp/127.0.0.1:11", "surefoot/ragno")


@pytest.mark.parametrize(
    ("words", "part"),
    [(("topic", "echo", "cmd/walk"), "`surefoot call cmd/walk`"), (("call", "hw/imu"), "`surefoot topic echo hw/imu`")],
)
def test_a_key_of_the_other_kind_is_named_with_its_command(complaint, words, part):
    assert part in complaint(*words)


def test_down_of_several_systems_refuses_with_their_names(complaint, two_systems, no_endpoint):
    err = complaint("down")
    assert "2 systems run: nao, ragno" in err or "2 systems run: ragno, nao" in err


def test_down_means_the_system_that_listens_where_this_shell_says(in_process, two_systems, no_endpoint, monkeypatch):
    def end(supervisor, grace_s):
        two_systems["nao"].release()
        return True

    monkeypatch.setattr("surefoot.services.supervisor.processes.identity.end", end)
    monkeypatch.setenv("SUREFOOT_LISTEN", "tcp/127.0.0.1:12")
    assert in_process("down")[:2] == (0, "stopped nao\n")
    assert two_systems["ragno"].held()


def test_the_status_of_a_system_that_does_not_run_names_those_that_do(in_process, two_systems, no_endpoint):
    code, out, _ = in_process("status", "bioloid")
    sentence, _, names = out.strip().partition("; running: ")
    assert (code, sentence, sorted(names.split(", "))) == (cli.EXIT_CHECK, "bioloid does not run", ["nao", "ragno"])
    assert json.loads(in_process("status", "bioloid", "--json")[1]) == {}


@pytest.mark.parametrize("words", [("up", "ragno"), ("run", "stand")], ids=["up", "run"])
def test_a_second_system_of_one_name_is_refused_by_its_name_and_on_the_same_router_by_its_port(
    complaint, two_systems, no_endpoint, monkeypatch, tmp_path, words
):
    assert "system 'ragno' is already run" in complaint(*words, code=cli.EXIT_CHECK)
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "another user"))
    with socket.socket() as router:
        router.bind(("127.0.0.1", 0))
        router.listen()
        monkeypatch.setenv("SUREFOOT_LISTEN", f"tcp/127.0.0.1:{(port := router.getsockname()[1])}")
        refused = complaint(*words, code=cli.EXIT_CHECK)
    assert str(port) in refused
    assert refused.count("\n") == 1


def test_stop_without_a_name_means_every_system_and_reports_each(complaint, in_process, two_systems, no_endpoint):
    code, out, _ = in_process("stop", "--json", "--timeout", "0.2")
    assert code == cli.EXIT_CHECK
    assert {found["system"] for found in json.loads(out)["systems"]} == {"nao", "ragno"}
    assert {found["system"] for found in json.loads(in_process("stop", "nao", "--json")[1])["systems"]} == {"nao"}
    err = complaint("stop", "nosuch")
    assert "running: nao, ragno" in err


@pytest.mark.parametrize(("driver", "resets"), [("simulator", True), ("my-robot", False)])
def test_a_stop_names_the_reset_only_where_the_driver_has_one(capsys, driver, resets):
    assert report([Stopped("ragno", driver, "surefoot stop", 7, 3.0)], json=False) == 0
    assert ("`surefoot sim reset`" in (out := capsys.readouterr().out)) == resets
    assert driver in out


def test_an_unconfirmed_stop_names_the_driver_that_is_being_restarted(in_process, no_endpoint):
    address = free_address()
    folder, bus = RunFolder("ragno"), ZenohBus(ZenohOptions("router", (), (address,), "surefoot/ragno"))
    folder.acquire()
    try:
        folder.write_endpoint(Endpoint(address, "surefoot/ragno"))
        row = {"pid": None, "restarts": 1}
        folder.write_rows(
            [
                ServiceStatus(service="simulator", state="backoff", detail="exit code -9", **row),
                ServiceStatus(service="walker", state="healthy", **row),
            ]
        )
        code, out, _ = in_process("stop", "--timeout", "0.3", "--json")
    finally:
        folder.release()
        bus.close()
    (found,) = json.loads(out)["systems"]
    assert (code, found["driver"]) == (cli.EXIT_CHECK, "")
    assert "services are being restarted (simulator backoff: exit code -9)" in found["detail"]
    assert "cut the power" in found["detail"]


def test_the_first_lines_of_the_client_run(monkeypatch):
    """The example in the docstring of `surefoot.client`, with answers that are at hand."""
    asked = {}

    class Robot:
        def __enter__(self):
            return self

        def __exit__(self, *_):
            pass

        def latest(self, key):
            asked["topic"] = topic_named(key)
            return estimate(0.1)

        def call(self, key, **fields):
            asked["request"] = make_request(query_named(key), fields)
            return SimpleNamespace(inner=())

    monkeypatch.setattr(client, "connect", Robot)
    exec(client.__doc__.split("\n\n", 1)[1], {})
    assert asked["topic"] is STATE_VELOCITY
    assert len(asked["request"].contacts) == 3


def test_what_the_pages_pass_to_call_is_json_of_the_query():
    pages = [ROOT / "README.md", *(ROOT / "docs").rglob("*.md")]
    calls = [found for page in pages for found in CALL.findall(page.read_text(encoding="utf-8"))]
    assert calls
    for key, text in calls:
        make_request(query_named(key), json.loads(text))


def test_stop_imports_neither_numpy_nor_the_schemas():
    program = (
        "import sys; from surefoot.lab.cli.entry import main\n"
        "try: main(['stop', '--connect', 'tcp/127.0.0.1:9', '--timeout', '0.2'])\n"
        "except SystemExit as end: print(end.code)\n"
        "print([name for name in ('numpy', 'pydantic', 'typer', 'surefoot.schemas') if name in sys.modules])"
    )
    done = run_process([sys.executable, "-c", program], capture_output=True, text=True)
    assert done.stdout == "1\n[]\n", done.stderr


@pytest.mark.parametrize(
    ("words", "environment", "hints"),
    [
        (("up", "--terrain", "moon"), {}, ["moon"]),
        (("up", "-d", "--terrain", "nowhere.npz"), {}, ["nowhere.npz"]),
        (("up",), {STRIDE: "-3"}, ["stride_m", "-3"]),
        (("run", "stand"), {STRIDE: "-3"}, ["stride_m", "-3"]),
        (("chaos", "stand", "--zenoh"), {STRIDE: "-3"}, ["stride_m", "-3"]),
    ],
)
def test_an_unknown_terrain_or_a_wrong_setting_is_refused_before_anything_starts(
    complaint, monkeypatch, words, environment, hints
):
    for name, value in environment.items():
        monkeypatch.setenv(name, value)
    err = complaint(*words)
    assert all(hint in err for hint in hints)
    assert "start " not in err


@pytest.mark.parametrize(
    "words", [("run", "stand", "--out"), ("bag", "record", "-o"), ("up", "--record"), ("call", "sim/features", "--out")]
)
def test_nothing_is_overwritten_without_force(complaint, tmp_path, words):
    there = tmp_path / "kept"
    if words[0] == "run":
        there.mkdir()
        (there / "report.html").write_text("mine")
    else:
        there.write_text("mine")
    err = complaint(*words, there)
    assert "exists" in err
    assert "--force" in err
    assert (there / "report.html" if there.is_dir() else there).read_text() == "mine"


def test_chaos_overwrites_no_folder_of_a_seed(complaint, tmp_path):
    (tmp_path / "seed3").mkdir()
    (tmp_path / "seed3" / "report.html").write_text("mine")
    err = complaint("chaos", "stand", "--zenoh", "--seed", 2, "--runs", 2, "--out", tmp_path)
    assert "seed3" in err
    assert "--force" in err
