"""`surefoot reproduce`: the table, the JSON, the exit code, a wrong name."""

import json
from pathlib import Path

import pytest

from surefoot.lab.cli import warming
from surefoot.lab.cli.output import state
from surefoot.lab.report.findings import Finding, Reproduction
from surefoot.papers.walas import stability as walas_stability

GOOD = Finding("4.2", "CoM shift, cm", "1.10", "1.06", True, "within 0.05")
BAD = Finding("4.7", "gain", "0.752", "0.8", False, "within 1 %")


@pytest.fixture(autouse=True)
def plain(monkeypatch):
    """No colours, no JSON of a test before, no kernels."""
    monkeypatch.setenv("NO_COLOR", "1")
    monkeypatch.setattr(state, "json", False)
    monkeypatch.setattr(warming, "warm_if_cold", lambda system, listen, notify: None)


@pytest.mark.parametrize(("rows", "code"), [((GOOD,), 0), ((GOOD, BAD), 1)])
def test_table_json_and_exit_code(in_process, monkeypatch, tmp_path, rows, code):
    asked: list[Path | None] = []

    def reproduce(folder, notify):
        asked.append(folder)
        return Reproduction("A paper", rows, (tmp_path / "fig15.svg",), ("a note",))

    monkeypatch.setattr(walas_stability, "reproduce", reproduce)
    found, out, _ = in_process("reproduce", "walas-stability", "--out", tmp_path)
    assert found == code
    for word in ("CoM shift", "1.10", "1.06", "fig15.svg", "a note", "FAIL" if code else "PASS"):
        assert word in out
    found, out, _ = in_process("reproduce", "walas-stability", "--no-figures", "--json")
    assert found == code
    assert json.loads(out)["ok"] is (code == 0)
    assert len(json.loads(out)["findings"]) == len(rows)
    assert asked == [tmp_path, None]


def test_unknown_paper(complaint):
    assert "walas-stability" in complaint("reproduce", "walas-stabilty")
