"""Compiling announces that it takes long, but only once, and counts by service; what fails is named."""

import json
import os
import re
import socket
from contextlib import nullcontext
from pathlib import Path

import pytest

import surefoot
from surefoot.errors import BusError, ConfigError, SurefootError
from surefoot.lab.cli import warming
from surefoot.lab.cli.output import state
from surefoot.lab.cli.warming import Job
from surefoot.lab.runs.local import run_local
from surefoot.services.supervisor.scenarios.scenario import load_scenario
from tests.surefoot.expect import expect_error


@pytest.fixture(autouse=True)
def apart(monkeypatch, tmp_path):
    """Stamps of its own; the kernels' caches stay where they are."""
    monkeypatch.setattr(warming, "_stamps", lambda: tmp_path / "warm")
    monkeypatch.setattr(state, "json", False)


def test_a_system_has_the_services_that_have_kernels():
    (ragno,) = warming.systems_of(["ragno"])
    jobs = warming.jobs_of([ragno, ragno])
    assert [job.service for job in jobs] == list(warming.ORDER)
    assert {job.robot for job in jobs} == {"ragno"}
    robots = {job.robot for job in warming.jobs_of(warming.all_systems(), rare=True)}
    assert robots == {path.parent.name for path in (Path(surefoot.__file__).parent / "robots").glob("*/robot.toml")}


def test_says_first_that_it_takes_long_and_then_how_far_it_is(monkeypatch):
    (ragno,) = warming.systems_of(["ragno"])
    jobs = (Job("simulator", "ragno"), Job("footholds", "ragno"))
    monkeypatch.setattr(warming, "jobs_of", lambda systems: jobs)
    lines = []
    assert warming.is_cold(jobs)
    warming.warm_if_cold(ragno, "tcp/127.0.0.1:1", lines.append)
    assert lines[0] == "compiling numeric kernels: 2 services, takes half a minute or more, only this once"
    assert [line.split(" after ")[0] for line in lines if " after " in line] == [f"  {n} of 2" for n in (1, 2)]
    assert not warming.is_cold(jobs)
    assert warming.is_cold((Job("simulator", "nao"),))
    assert warming.is_cold((Job("simulator", "ragno", rare=True),))
    monkeypatch.setattr(warming, "jobs_of", lambda systems: pytest.fail("imports the services of a warm system"))
    count = len(lines)
    warming.warm_if_cold(ragno, "tcp/127.0.0.1:1", lines.append)
    assert len(lines) == count


def test_share_and_time_left_follow_the_processor_time_of_the_workers(monkeypatch):
    monkeypatch.setattr(warming, "busy_s", lambda pids: busy)
    for name in ("FIRST_S", "SECOND_S", "EACH_S"):
        monkeypatch.setattr(f"surefoot.lab.cli.progress.{name}", 0.0)
    lines, busy = [], 1.0
    jobs = (Job("walker", "ragno"), Job("walker", "nao"))
    progress = warming._WarmProgress(jobs, lines.append)
    progress.begins(7, jobs[0])
    busy += 0.5 * warming.COSTS_S["walker"]
    progress._write_due()
    assert re.fullmatch(r"compiling numeric kernels: 25 %, about \d+ s left \(0 of 2 services\)", lines[-1])
    busy += 0.6 * warming.COSTS_S["walker"]
    progress._write_due()
    assert re.fullmatch(r"compiling numeric kernels: at work for 0 s \(0 of 2 services, longer than usual\)", lines[-1])
    progress.another(7, jobs[0])
    progress._write_due()
    assert "50 %" in lines[-1]


def test_a_stamp_holds_only_while_its_kernels_are_there(tmp_path, monkeypatch):
    job, (first, second) = Job("footholds", "ragno"), (tmp_path / "first.nbi", tmp_path / "second.nbi")
    files = {str(first): "a" * 64, str(second): "b" * 64}
    warmed = warming.Warmed("footholds", "ragno", 2, 2, 1.0, files)
    monkeypatch.setattr(warming, "_worker", lambda: nullcontext(warming._Worker(0, lambda job: warmed)))
    for path, fingerprint in files.items():
        Path(path).write_bytes(b"index " + fingerprint.encode())
    warming.warm((job,))
    assert not warming.is_cold((job,))
    second.write_bytes(b"index of other sources " + b"c" * 64)
    assert warming.is_cold((job,)), "the kernels were compiled again from other sources"
    second.unlink()
    assert warming.is_cold((job,)), "the kernels were removed with their folder"
    second.write_bytes(b"index " + b"b" * 64)
    assert not warming.is_cold((job,))


@pytest.mark.parametrize("content", [b"\xff\xfe|", b"no line of a stamp", b"a\0b|" + b"a" * 64, None])
def test_a_stamp_that_is_none_is_no_stamp(content):
    job = Job("footholds", "ragno")
    job.stamp.parent.mkdir(parents=True)
    if content is None:
        job.stamp.mkdir()
    else:
        job.stamp.write_bytes(content)
    assert warming.is_cold((job,))


def test_a_real_stamp_names_the_files_of_its_kernels():
    job = Job("footholds", "ragno")
    (found,) = warming.warm((job,))
    assert found.kernels >= 8
    assert found.row().keys() == {"service", "robot", "kernels", "compiled", "seconds"}
    lines = [line.rpartition("|") for line in job.stamp.read_text().splitlines()]
    assert {Path(path).suffix for path, _, _ in lines} == {".nbi"}
    assert len({path for path, _, _ in lines}) >= found.kernels
    assert not warming.is_cold((job,))


def test_kernels_that_draw_the_robot_are_compiled_with_those_of_services():
    files = warming._rehearse(Job("simulator", "ragno")).files
    assert any("kinematics.forward-" in file and ".link." not in file for file in files), files


def test_what_cannot_be_compiled_is_told_by_name():
    jobs = (Job("nothing", "ragno"),)
    with expect_error(SurefootError, text="nothing", without="\n"):
        warming.warm(jobs)
    assert warming.is_cold(jobs)


def test_the_command_shows_the_kernels_of_each_service(monkeypatch, in_process):
    monkeypatch.setattr(warming, "ORDER", ())
    monkeypatch.setattr(warming, "jobs_of", lambda systems, rare: (Job("footholds", "ragno", rare),))
    (row,) = json.loads(in_process("warm", "--json")[1])["services"]
    assert (row["service"], row["robot"]) == ("footholds", "ragno")
    assert row["kernels"] >= 8
    assert "warm" in in_process("warm")[1]


def test_a_taken_port_is_reported_before_anything_is_compiled(monkeypatch):
    (ragno,) = warming.systems_of(["ragno"])
    monkeypatch.setattr(warming, "jobs_of", lambda systems: (Job("simulator", "ragno"),))
    monkeypatch.setattr(warming, "warm", lambda jobs, notify: pytest.fail("compiles for a system that cannot start"))
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        with expect_error(BusError, "busy", text=str(os.getpid())):
            warming.warm_if_cold(ragno, f"tcp/127.0.0.1:{taken.getsockname()[1]}", print)


def test_a_wrong_secret_is_reported_before_anything_is_compiled(monkeypatch):
    (ragno,) = warming.systems_of(["ragno"])
    monkeypatch.setenv("SUREFOOT_SECRET", "abc")
    monkeypatch.setattr(warming, "is_cold", lambda jobs: True)
    monkeypatch.setattr(warming, "jobs_of", lambda systems: (Job("simulator", "ragno"),))
    monkeypatch.setattr(warming, "warm", lambda jobs, notify: pytest.fail("compiles for a system that cannot start"))
    with expect_error(ConfigError, "invalid", text="3 characters"):
        warming.warm_if_cold(ragno, "tcp/127.0.0.1:1", print)


@pytest.mark.parametrize("words", ["verify {bag}", "whatif {bag} --at 0.1", "verify --scenario stand"])
def test_a_repetition_compiles_cold_kernels_first_with_share_and_time_left(monkeypatch, in_process, tmp_path, words):
    bag, asked = tmp_path / "run.mcap", list[str]()
    run_local(load_scenario("stand"), recording=bag)
    monkeypatch.setattr(warming, "is_cold", lambda jobs: True)
    monkeypatch.setattr(warming, "warm", lambda jobs, notify: asked.extend({job.robot for job in jobs}))
    monkeypatch.setattr(warming, "_mark", lambda done, notify: None)
    in_process(*words.format(bag=bag).split())
    assert asked == ["ragno"]
