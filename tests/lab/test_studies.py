"""Studies in several sittings: runs that are kept are not repeated, and the lines are those of all jobs."""

import os
import signal
import sys
import time
from pathlib import Path
from subprocess import PIPE
from typing import Any

import pytest

from surefoot.errors import ConfigError
from surefoot.lab import studies
from surefoot.lab.report.judge import Row, RunVerdict
from surefoot.lab.studies import finished, metrics, passed, seeds_of, study, verdict_line
from tests.processes import running
from tests.surefoot.expect import expect_error

NAPS = """
import os, sys, time
from pathlib import Path
from surefoot.lab.studies import study

def nap(number):
    if number == 0:
        return {}
    Path(sys.argv[1], str(number)).touch()
    os.write(1, b"begun\\n")
    time.sleep(120.0)

study(nap, [{"number": number} for number in range(20)], Path(sys.argv[1], "kept"), processes=2,
      show=lambda line: os.write(1, b"begun\\n"))
"""


@pytest.mark.parametrize(("text", "seeds"), [("3", [0, 1, 2]), ("20:22", [20, 21]), ("5:5", [])])
def test_seeds(text: str, seeds: list[int]) -> None:
    assert list(seeds_of(text)) == seeds


def walked(scenario: str, seed: int) -> dict[str, Any]:
    rows = (Row("distance_m", 1.5 if seed != 2 else 0.2, ok=seed != 2), Row("min_margin_m", None))
    return verdict_line(RunVerdict(rows), ("min_margin_m",))


def test_continues_where_it_stopped(tmp_path: Path) -> None:
    ran: list[int] = []
    file = tmp_path / "study.jsonl"

    def run(scenario: str, count: int) -> list[studies.Line]:
        jobs = [{"scenario": scenario, "seed": seed} for seed in range(count)]
        return study(walked, jobs, file, processes=1, show=lambda line: ran.append(line["seed"]))

    run("flat", 3)
    file.write_text(file.read_text() + '{"scenario": "flat", "se')  # a study that was ended while it wrote
    lines = run("flat", 5)
    assert sorted(ran) == [0, 1, 2, 3, 4]  # two that have ended when one looks come in any order
    assert run("flat", 5) == lines
    assert len(ran) == 5
    assert [line["seed"] for line in lines] == [0, 1, 2, 3, 4]
    assert lines[2]["failed"] == ["distance_m"]
    assert lines[2]["values"] == {"distance_m": 0.2, "min_margin_m": None}
    assert passed(lines)[:2] == (4, 5)
    assert metrics(lines, ("distance_m", "min_margin_m")) == [("distance_m", 1.5, 0.2, 2, 1.5, 4)]
    run("stand", 1)
    assert ran[5:] == [0]
    assert [line["scenario"] for line in finished(file, seed=0)] == ["flat", "stand"]
    assert finished(tmp_path / "none") == []


@pytest.mark.parametrize("text", ["5:1", "-1:2", "-3", "a:b", ""])
def test_seeds_that_name_none_are_refused(text: str) -> None:
    with pytest.raises(ConfigError) as refused:
        seeds_of(text)
    assert refused.value.field == "seeds"


def test_a_folder_in_the_place_of_results_is_refused_in_a_sentence(tmp_path: Path) -> None:
    with expect_error(ConfigError, "invalid", "results", text=str(tmp_path)):
        finished(tmp_path)


@pytest.mark.parametrize("stop", [os.killpg, os.kill], ids=["by the terminal", "sent to the study alone"])
def test_an_interrupt_ends_all_processes_at_once_and_states_what_is_kept(tmp_path: Path, stop: Any) -> None:
    with running([sys.executable, "-c", NAPS, tmp_path], stdout=PIPE, stderr=PIPE, start_new_session=True) as process:
        assert process.stdout is not None
        assert [process.stdout.readline() for _ in range(3)] == [b"begun\n"] * 3
        began = time.monotonic()
        stop(process.pid, signal.SIGINT)
        _, complaint = process.communicate(timeout=60.0)  # the pipes end with the last process
        assert time.monotonic() - began < 10.0  # 0.1 s on an idle machine
    assert f"1 of 20 runs are kept in {tmp_path / 'kept'}".encode() in complaint
    assert len(finished(tmp_path / "kept")) == 1
    assert len(list(tmp_path.iterdir())) == 3
