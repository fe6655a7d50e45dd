"""The command line: exit codes, JSON everywhere, one sentence for an error, quick help."""

import json
import os
import shlex
import subprocess
import sys
import time
from contextlib import contextmanager, nullcontext
from types import SimpleNamespace

import pytest

from surefoot.bus.codec import encode
from surefoot.bus.interface import Raw
from surefoot.client import query_named
from surefoot.errors import CallError
from surefoot.lab.cli import main as cli
from surefoot.lab.cli.connect import endpoint
from surefoot.record.recording import RecordingWriter
from surefoot.schemas.cmd import WalkReply
from surefoot.schemas.hw import Imu
from surefoot.schemas.system import ConfigReply, ServiceParameter
from surefoot.schemas.topics import HW_IMU, QUERIES
from surefoot.services.supervisor.processes.rundir import Endpoint, RunFolder
from tests.processes import run_process, running_child

pytestmark = pytest.mark.usefixtures("apart")

PLAIN = (
    "list", "topic list", "topic info state/velocity", "service list", "service info stability/check", "schema list",
    "schema show Imu", "robot list", "robot check ragno", "graph",
)  # fmt: skip


@pytest.mark.parametrize("words", PLAIN)
def test_answers_as_table_and_as_json(answer, words):
    assert answer(*words.split()).strip()
    assert json.loads(answer(*words.split(), "--json"))


def commands(app, prefix=()):
    for command in app.registered_commands:
        yield (*prefix, command.name or command.callback.__name__.replace("_", "-"))
    for group in app.registered_groups:
        name = group.name or group.typer_instance.info.name  # without a name the commands are those of the group above
        yield from commands(group.typer_instance, (*prefix, name) if isinstance(name, str) else prefix)


@pytest.mark.parametrize("words", sorted(commands(cli.app)), ids=" ".join)
def test_every_command_has_help_and_json(answer, words):
    out = answer(*words, "--help")
    assert "Usage:" in out
    assert "--json" in out or words in (("supervise",), ("bridge", "ros2"))


@pytest.mark.parametrize(
    ("words", "hint"),
    [
        (["topik"], "topic"),
        (["run", "rough-terain"], "rough-terrain"),
        (["up", "ragmo"], "ragno"),
        (["topic", "info", "state/velocty"], "state/velocity"),
        (["topic", "echo", "state/velocity", "--field", "speed"], "velocity"),
        (["schema", "show", "Imo"], "Imu"),
        (["call", "stability/chek", "{}"], "stability/check"),
        (["call", "cmd/walk", '{"acton": "walk"}'], "did you mean 'action'"),
        (["call", "cmd/walk", "not json"], "not JSON"),
        (["call", "cmd/walk", "[1]"], "JSON object"),
        (["robot", "check", "ragmo"], "ragno"),
        (["down", "ragmo"], "(did you mean 'ragno'?); known are"),
        (["down", "nosuch"], "running: none"),
        (["up", "--listen", "garbage"], "--listen: got 'garbage', expected tcp/<host>:<port 1-65535>"),
        (["up", "-d", "--listen", "tcp/127.0.0.1:70000"], "expected tcp/<host>:<port 1-65535>"),
        (["call", "health/walker", "--connect", "tcp/:1"], "--connect: got"),
        (["run"], "scenario"),
        (["run", "stand", "--seed", "-1"], "seed"),
        (["status", "ragmo"], "(did you mean 'ragno'?); known are"),
        (["logs", "--system", "ragmo"], "(did you mean 'ragno'?); known are"),
    ],
    ids=lambda value: " ".join(value) if isinstance(value, list) else "",
)
def test_usage_errors_name_what_was_meant(in_process, words, hint):
    code, out, err = in_process(*words)
    assert code == cli.EXIT_USAGE
    assert hint in err
    assert "Traceback" not in err
    assert not out


@pytest.mark.parametrize(
    "words", [["status"], ["topic", "hz", "state/gait"], ["health", "walker"], ["call", "cmd/walk"]]
)
def test_nothing_running_is_told_at_once(in_process, words):
    began = time.monotonic()
    code, out, err = in_process(*words, "--json")
    assert code in (cli.EXIT_CHECK, cli.EXIT_USAGE)
    assert json.loads(out) == {} or "error" in json.loads(out)
    assert not err
    assert time.monotonic() - began < 6.0  # without waiting for a router; takes 0.1


@pytest.mark.parametrize("words", [["up"], ["up", "-d"], ["run", "stand"]], ids=" ".join)
def test_a_listen_variable_that_is_no_endpoint_is_told(complaint, monkeypatch, words):
    monkeypatch.setenv("SUREFOOT_LISTEN", "garbage")
    err = complaint(*words)
    assert "surefoot: SUREFOOT_LISTEN: got 'garbage', expected tcp/<host>:<port 1-65535>\n" in err


def test_services_without_their_supervisor_are_told(answer, in_process):
    folder = RunFolder("ragno")
    folder.acquire()
    sleep = [sys.executable, "-c", "import time; time.sleep(60)"]
    with running_child("walker", sleep, {}, folder.log("walker")) as child:
        folder.write_processes({"walker": child.identity})
        folder._lock.close()  # as when the supervisor is killed
        what = "services of ragno run without their supervisor; `surefoot down ragno` ends them"
        code, out, _ = in_process("status")
        assert code == cli.EXIT_CHECK
        assert out.splitlines()[-1] == what
        assert "orphaned" in out
        assert what in in_process("stop")[2]
        answer("logs", "walker")
        assert in_process("down")[1] == "stopped ragno\n"


def test_a_client_looks_for_the_system_in_this_order(monkeypatch):
    monkeypatch.delenv("SUREFOOT_CONNECT")
    monkeypatch.setenv("SUREFOOT_LISTEN", "tcp/127.0.0.1:11")
    assert endpoint() == ("tcp/127.0.0.1:11", "surefoot/ragno")
    folder = RunFolder("system")
    folder.acquire()
    folder.write_endpoint(Endpoint("tcp/127.0.0.1:12", "fleet/robot"))
    try:
        assert endpoint() == ("tcp/127.0.0.1:12", "fleet/robot")
        monkeypatch.setenv("SUREFOOT_CONNECT", "tcp/127.0.0.1:13")
        assert endpoint()[0] == "tcp/127.0.0.1:13"
        assert endpoint("tcp/127.0.0.1:14")[0] == "tcp/127.0.0.1:14"
    finally:
        folder.release()
    monkeypatch.delenv("SUREFOOT_CONNECT")
    monkeypatch.delenv("SUREFOOT_LISTEN")
    assert endpoint()[0] == "tcp/127.0.0.1:7447"


@pytest.mark.parametrize("words", [["topik"], ["topic", "echo"], ["call", "cmd/walk", "not json"], ["run", "--sed"]])
def test_wrong_words_are_json_too_where_it_is_asked_for(in_process, words):
    code, out, err = in_process(*words, "--json")
    assert code == cli.EXIT_USAGE
    error = json.loads(out)["error"]
    assert set(error) == {"code", "message", "field"}
    assert error["code"] == "usage"
    assert not err


def test_a_failure_of_the_operating_system_is_named(in_process, tmp_path):
    words = ("schema", "export", tmp_path / "file" / "schemas")
    (tmp_path / "file").write_text("")
    code, out, _ = in_process(*words, "--json")
    assert code == cli.EXIT_USAGE
    assert json.loads(out)["error"]["code"] == "ENOTDIR"
    assert in_process(*words)[2] == f"surefoot: {words[-1]}: Not a directory\n"


def test_a_full_disk_behind_the_output_is_one_sentence():
    with open("/dev/full", "w") as full:
        for words in (["list"], ["list", "--json"]):
            command = [sys.executable, "-m", "surefoot.lab.cli.main", *words]
            done = run_process(command, stdout=full, stderr=subprocess.PIPE, text=True)
            assert done.returncode == cli.EXIT_CHECK
            assert done.stderr == "surefoot: No space left on device\n"


def test_a_run_that_cannot_be_written_is_not_started(complaint, tmp_path):
    (tmp_path / "file").write_text("")
    out = tmp_path / "file" / "out"
    err = complaint("run", "stand", "--out", out)
    assert err.endswith(f"surefoot: {out}: Not a directory\n")
    assert "start" not in err


def test_a_namespace_that_is_none_is_told(complaint, monkeypatch):
    monkeypatch.setattr("surefoot.lab.cli.connect._knock", lambda _: None)
    err = complaint("call", "cmd/walk", '{"action": "stop"}', "--namespace", "a/**")
    assert err == "surefoot: namespace: got 'a/**', expected <fleet>/<robot> without *, $, # and ?\n"


@pytest.mark.parametrize(("accepted", "expected"), [(True, 0), (False, 1)])
def test_a_call_that_is_not_accepted_fails(in_process, monkeypatch, accepted, expected):
    @contextmanager
    def client(*_):
        reply = WalkReply(accepted=accepted, id=int(accepted))
        yield SimpleNamespace(call=lambda *_, **__: reply, bus=SimpleNamespace(refused={}))

    monkeypatch.setattr("surefoot.lab.cli.service.client", client)
    for words in ([], ["--json"]):
        code, out, _ = in_process("call", "cmd/walk", '{"action": "stop"}', *words)
        assert code == expected
        assert json.loads(out)["accepted"] is accepted


def test_parameters_are_listed_of_all_services_that_run_and_of_one(answer, monkeypatch):
    mu = ServiceParameter(name="mu", value="0.6", default="0.6", live=True, meaning="friction")

    def call(query, request):
        if query.owner not in ("stability", "walker"):
            raise CallError("absent", f"no service answers {query.key!r}")
        return ConfigReply(parameters=(mu,), config_hash="")

    monkeypatch.setattr(
        "surefoot.lab.cli.param.client", lambda *_: nullcontext(SimpleNamespace(bus=SimpleNamespace(call=call)))
    )
    assert [line for line in answer("param", "list").splitlines() if line.isalpha()] == ["stability", "walker"]
    assert set(json.loads(answer("param", "list", "--json"))) == {"stability", "walker"}
    assert answer("param", "get", "stability") == answer("param", "list", "stability")
    assert answer("param", "get", "stability", "mu") == "0.6\n"


@pytest.mark.parametrize("query", QUERIES, ids=lambda query: query.key)
def test_every_query_has_a_call_to_paste(answer, query):
    out = answer("service", "info", query.key.replace("*", query.owner))
    words = shlex.split(out.splitlines()[-1].removeprefix("Example: "))
    assert words[:2] == ["surefoot", "call"]
    assert query_named(words[2]).request is query.request
    query.request.model_validate_json(words[3])


def test_a_field_is_told_with_type_default_and_limits(in_process):
    _, out, _ = in_process("service", "info", "stability/region", "--json")
    rows = {row["field"]: row for row in json.loads(out)["request"]["RegionRequest"]}
    assert (rows["tolerance_m"]["type"], rows["tolerance_m"]["default"]) == ("number", "0.0001")
    assert rows["tolerance_m"]["limits"] == "> 0, <= 1.0"
    assert (rows["contacts"]["type"], rows["contacts"]["default"]) == ("list of Contact", "required")
    _, out, _ = in_process("service", "info", "cmd/walk")
    assert '"walk"' in out


def test_down_with_nothing_running_is_fine(answer):
    answer("down")


def test_down_of_another_system_than_the_one_that_runs_names_that(in_process):
    folder = RunFolder("go2")  # of `surefoot up unitree --robot ./go2`
    folder.acquire()
    assert in_process("down", "unitree")[:2] == (0, "unitree does not run; running: go2\n")
    folder.release()


def test_a_broken_compose_file_is_one_sentence(complaint, tmp_path):
    path = tmp_path / "bad.yaml"
    path.write_text("services: {a: {prots: [1]}}")
    err = complaint("up", path)
    assert err.count("\n") == 1
    assert "services.a.prots" in err
    assert str(path) in err


def test_a_recording_that_is_none_is_one_sentence(in_process, tmp_path):
    path = tmp_path / "none.mcap"
    for content in (None, b"", b"not a recording"):
        if content is not None:
            path.write_bytes(content)
        code, _, err = in_process("bag", "info", path)
        assert code != 0
        assert err.count("\n") == 1
        assert "Traceback" not in err


def test_schemas_are_exported(answer, tmp_path):
    answer("schema", "export", tmp_path / "schemas")
    keys = json.loads((tmp_path / "schemas" / "keys.json").read_text())
    assert (tmp_path / "schemas" / f"{keys['topics']['hw/imu']['schema']}.json").is_file()


@pytest.mark.parametrize("form", ["mermaid", "dot"])
def test_the_graph_is_drawn(answer, form):
    out = answer("graph", "--format", form)
    assert "simulator" in out
    assert "walker" in out


def test_an_internal_error_is_a_sentence_unless_debugging(complaint, monkeypatch):
    def broken(*_):
        raise ZeroDivisionError("oops")

    monkeypatch.setattr("surefoot.robot.reader.load_robot", broken)
    err = complaint("robot", "list", code=cli.EXIT_CHECK)
    assert "ZeroDivisionError" in err
    assert "--debug" in err
    with pytest.raises(ZeroDivisionError):
        cli.main(["--debug", "robot", "list"])


def test_help_is_quick_and_imports_nothing_heavy():
    code = (
        "import sys, time; began = time.process_time()\n"
        "import typer; library = time.process_time() - began\n"
        "from surefoot.lab.cli import main as cli\n"
        "try: cli.main(['--help'])\n"
        "except SystemExit: pass\n"
        "heavy = {'numpy', 'zenoh', 'pydantic', 'mujoco', 'matplotlib', 'scipy', 'numba', 'mcap'} & set(sys.modules)\n"
        "sys.stderr.write(f'{heavy or None} {(time.process_time() - began) / library:.3f}')"
    )
    environment = {**os.environ, "COLUMNS": "100"}
    ratios = list[float]()
    for _ in range(3):
        done = run_process([sys.executable, "-c", code], env=environment, capture_output=True, text=True, check=True)
        heavy, ratio = done.stderr.split()
        assert heavy == "None"
        assert "Usage:" in done.stdout
        ratios.append(float(ratio))
    assert min(ratios) < 1.5  # of `import typer`, which takes 0.11 s of processor time; goal 0.15 s with Python itself


def test_tables_hold_no_truth_values(in_process):
    _, out, _ = in_process("topic", "list")
    assert "True" not in out
    assert "False" not in out
    _, out, _ = in_process("topic", "list", "--json")
    assert {row["deterministic"] for row in json.loads(out)} == {True, False}


def test_a_folder_that_is_no_robot_is_told_what_was_expected(complaint, tmp_path):
    err = complaint("robot", "check", tmp_path)
    assert err == f"surefoot: {str(tmp_path)!r} holds no robot.toml: a robot is a folder with that file\n"


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (("topic", "echo", "state/velocty"), "no topic 'state/velocty' (did you mean 'state/velocity'?)"),
        (("call", "cmd/wlak"), "no query 'cmd/wlak' (did you mean 'cmd/walk'?)"),
        (
            ("call", "cmd/walk", '{"action": "walk", "distance": true}'),
            "cmd/walk.distance: Input should be a valid number",
        ),
        (("call", "cmd/walk", '{"action": "stop", "distance": 1}'), "cmd/walk.distance: goes with action 'walk' only"),
        (("robot", "check", "nobody"), "no robot 'nobody'; known are bioloid"),
    ],
)
def test_what_is_wrong_is_told_before_anybody_is_asked(complaint, words, told):
    err = complaint(*words)
    assert err.startswith(f"surefoot: {told}")
    assert len(err.splitlines()) == 1


def test_a_damaged_recording_is_told_without_a_traceback(in_process, tmp_path):
    bag = tmp_path / "run.mcap"
    writer = RecordingWriter(bag, {})
    for tick in range(9000):
        message = Imu(acc=(0.1 * tick, 0.0, 9.81), gyro=(0.0, 0.0, 0.0)).stamped(tick, tick, 1, tick, "driver")
        writer.write(HW_IMU, message, Raw(*encode(message), ""))
    writer.close({})
    code, out, _ = in_process("bag", "info", bag, "--verify")
    assert (code, out.splitlines()[0]) == (0, f"{bag}: whole, 9000 messages can be read, none lost")
    bag.write_bytes(bag.read_bytes()[: bag.stat().st_size // 2])
    code, out, _ = in_process("bag", "info", bag, "--verify", "--json")
    found = json.loads(out)
    assert code == 1
    assert not found["ok"]
    assert 0 < found["readable"] < 9000
    for words in (("bag", "info", bag), ("bag", "play", bag)):
        code, _, err = in_process(*words)
        assert (code, len(err.splitlines())) == (2, 1)
        assert "no summary at its end" in err
        assert "bag info --verify" in err
