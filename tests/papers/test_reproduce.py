"""`surefoot reproduce`: the table, the JSON, the exit code, a wrong name."""

import json
from dataclasses import replace
from pathlib import Path

import pytest

from surefoot.lab.cli import warming
from surefoot.lab.cli.output import state
from surefoot.lab.report.findings import CONFIRMED, DEVIATION, NOT_CONFIRMED, Finding, Reproduction, with_known
from surefoot.papers.walas import stability as walas_stability

GOOD = Finding("4.2", "CoM shift, cm", "1.10", "1.06", True, "within 0.05")
BAD = Finding("4.7", "gain", "0.752", "0.8", False, "within 1 %")
KNOWN = Finding("4.7", "way", "10", "6", False, "within 1", "the feet stay behind")
OWN = Finding("4.4", "error, mm", "", "4", False, "<= 3")


@pytest.fixture(autouse=True)
def plain(monkeypatch):
    """No colours, no JSON of a test before, no kernels."""
    monkeypatch.setenv("NO_COLOR", "1")
    monkeypatch.setattr(state, "json", False)
    monkeypatch.setattr(warming, "warm_if_cold", lambda system, listen, notify: None)


@pytest.mark.parametrize(
    ("rows", "options", "code"),
    [
        ((GOOD,), (), 0), ((GOOD, BAD), (), 1), ((GOOD, OWN), (), 1),
        ((GOOD, KNOWN), (), 0), ((GOOD, KNOWN), ("--strict",), 1), ((GOOD,), ("--strict",), 0),
    ],
)  # fmt: skip
def test_table_json_and_exit_code(in_process, monkeypatch, tmp_path, rows, options, code):
    asked: list[Path | None] = []

    def reproduce(folder, notify):
        asked.append(folder)
        return Reproduction("A paper", rows, (tmp_path / "fig15.svg",), ("a note",))

    monkeypatch.setattr(walas_stability, "reproduce", reproduce)
    found, out, _ = in_process("reproduce", "walas-stability", "--out", tmp_path, *options)
    assert found == code
    for word in ("CoM shift", "1.10", "1.06", "fig15.svg", "a note", "FAIL" if code else "PASS"):
        assert word in out
    assert ("the feet stay behind" in out) is (KNOWN in rows)
    found, out, _ = in_process("reproduce", "walas-stability", "--no-figures", "--json", *options)
    assert found == code
    assert json.loads(out)["ok"] is (code == 0)
    assert [row["verdict"] for row in json.loads(out)["findings"]] == [row.verdict for row in rows]
    assert asked == [tmp_path, None]


def test_only_what_the_paper_states_is_confirmed_or_not():
    verdicts = [replace(row, ok=ok).verdict for row in (GOOD, KNOWN, OWN) for ok in (True, False, None)]
    assert verdicts == [
        CONFIRMED, NOT_CONFIRMED, "", CONFIRMED, DEVIATION, "", "ok", "FAILED", "",
    ]  # fmt: skip


def test_a_known_deviation_names_its_row_and_no_other():
    rows = with_known([GOOD, BAD, OWN], {"4.7: gain": "why"})
    assert [row.known for row in rows] == ["", "why", ""]
    assert Reproduction("A paper", rows[:2]).as_recorded
    assert not Reproduction("A paper", rows).as_recorded


def test_a_missed_limit_of_this_project_is_no_known_deviation():
    row = replace(OWN, ok=False, known="why")
    assert (row.verdict, Reproduction("A paper", (row,)).as_recorded) == ("FAILED", False)


def test_unknown_paper(complaint):
    assert "walas-stability" in complaint("reproduce", "walas-stabilty")
