"""Scenarios as processes over Zenoh, by the command line."""

import json
import re
import signal
import subprocess
import time

import pytest

from surefoot.lab.runs.local import run_local
from surefoot.services.supervisor.processes.rundir import RunFolder
from surefoot.services.supervisor.scenarios.scenario import find_scenario, load_scenario
from tests.processes import run_process, running

pytestmark = pytest.mark.e2e

END_S = 80.0  # s wall; takes 1 to 2


def processes(place):
    return RunFolder("ragno", place[0] / "state" / "surefoot").processes()


@pytest.fixture(scope="module")
def outcome(surefoot):
    done = surefoot("run", "stand", "--json")
    assert done.returncode == 0, done.stdout + done.stderr
    return json.loads(done.stdout)


def test_passes_and_leaves_nothing(outcome, place):
    assert outcome["ok"]
    assert outcome["values"]["fell"] == 0.0
    assert outcome["comparable"]
    assert processes(place) == {}


def test_writes_a_report_and_a_recording(outcome, place, surefoot):
    page = (place[0] / outcome["report"]).read_text()
    assert "PASS" in page
    assert not re.search("https?:", page)
    info = json.loads(surefoot("bag", "info", outcome["recording"], "--json").stdout)
    assert info["metadata"]["surefoot"]["run_hash"] == outcome["message_hash"]
    assert info["topics"]["sim/truth"] == outcome["values"]["ticks"]


def test_the_recording_gives_the_same_numbers(outcome, surefoot):
    again = json.loads(surefoot("report", outcome["recording"], "--scenario", "stand", "--json").stdout)
    live = {name: value for name, value in outcome["values"].items() if name != "real_time_factor"}
    assert {name: again["values"][name] for name in live} == live


def test_the_hash_is_that_of_one_process(outcome):
    assert run_local(load_scenario(find_scenario("stand"))).run_hash == outcome["message_hash"]


def test_a_limit_that_is_not_met_is_exit_code_1_and_a_full_disk_changes_no_verdict(place, command_line, outcome):
    folder, environment = place
    strict = folder / "strict.toml"
    strict.write_text(
        'description = "stands, and should not"\nmax_duration_s = 1.0\n'
        '[[step]]\nat_tick = 10\ndo = "push"\nforce = [0.1, 0.0, 0.0]\nduration = 0.1\n'
        "[limits]\nmin_distance_m = 1.0\n"
    )
    words = ["run", str(strict), "--seed", "1", "--json"]
    command = ["bash", "-c", 'ulimit -f 40; exec "$@"', "bash", *command_line, *words]
    done = run_process(command, cwd=folder, env=environment, capture_output=True, text=True)
    found = json.loads(done.stdout)
    assert (done.returncode, found["ok"], found["failed"]) == (1, False, ["distance_m"])
    assert found["report"] is None
    assert "the recording could not be written to its end; `surefoot logs recorder` shows why" in found["notes"]
    assert "the report could not be written: File too large" in found["notes"]
    first, other = (run_local(load_scenario(strict), seed).run_hash for seed in (0, 1))
    assert found["message_hash"] == other != first


def test_ends_on_ctrl_c(place, command_line):
    folder, environment = place
    command = [*command_line, "run", "stand", "--no-record", "--rtf", "0.1"]
    with running(command, cwd=folder, env=environment, stderr=subprocess.PIPE, text=True) as process:
        for line in process.stderr:
            if "begins" in line:
                break
        assert processes(place)
        process.send_signal(signal.SIGINT)
        _, complaints = process.communicate(timeout=END_S)
        assert "Traceback" not in complaints
        assert process.returncode == 130
    assert processes(place) == {}


def test_a_bag_is_played_behind_an_own_router(surefoot, place, outcome, command_line):
    folder, environment = place
    bag = outcome["recording"]
    play = [*command_line, "bag", "play", bag, "--loop", "-k", "state/odometry"]
    with running(play, cwd=folder, env=environment, stdout=subprocess.DEVNULL) as player:
        done = None
        deadline = time.monotonic() + END_S
        while time.monotonic() < deadline:
            done = surefoot("topic", "echo", "state/odometry", "-n", "2", "--raw", "--timeout", "5", "--connect",
                            environment["SUREFOOT_LISTEN"])  # fmt: skip
            if done.returncode == 0:
                break
        player.send_signal(signal.SIGINT)
        assert player.wait(END_S) == 0
    assert done is not None
    assert len(done.stdout.splitlines()) == 2
