"""Recordings that were cut off, or made by another version: used as far as they are sound, with a sentence on both."""

import json
import re

import numpy as np
import pytest

from surefoot.record.recording import open_readable
from tests.lab.cli.test_foreign_recordings import rewritten, same

LOST = "cut off or damaged: "


@pytest.fixture(scope="module")
def cut(recorded, tmp_path_factory):
    """A recording without its last two fifths."""
    path, data = tmp_path_factory.mktemp("cut") / "run.mcap", recorded.read_bytes()
    path.write_bytes(data[: len(data) * 3 // 5])
    return path


@pytest.fixture(autouse=True)
def _apart(apart, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


def test_a_margin_is_audited_up_to_the_cut(in_process, recorded, cut):
    code, out, _ = in_process("audit", cut, "--json")
    part, whole = json.loads(out), json.loads(in_process("audit", recorded, "--json")[1])
    assert code == 0
    assert 0 < part["claims"] < whole["claims"]
    assert not part["contradicted"]
    assert LOST in part["notes"][0]
    assert whole["notes"] == []


def test_estimates_and_exports_end_at_the_cut(in_process, recorded, cut, tmp_path):
    code, out, _ = in_process("estimate", cut, "-o", "e")
    assert code == 0
    assert LOST in out
    end_s = 1e-9 * open_readable(cut).end_ns
    for kind, name in (("tum", "t.tum"), ("csv", "c.csv"), ("rosbag2", "b")):
        code, _, err = in_process("bag", "export", cut, "--to", kind, "-o", name)
        assert code == 0
        assert LOST in err
    track = np.loadtxt(tmp_path / "t.tum")
    assert end_s - 0.1 < track[-1, 0] <= end_s
    assert in_process("bag", "export", recorded, "--to", "tum", "-o", "whole.tum")[2].count(LOST) == 0
    np.testing.assert_array_equal(track, np.loadtxt(tmp_path / "whole.tum")[: len(track)])
    code, out, _ = in_process("compare", cut, recorded)
    assert code == 0
    assert LOST in out


def test_a_cut_is_no_difference_but_what_stands_before_it_is(in_process, recorded, cut, tmp_path):
    code, out, _ = in_process("bisect", cut, recorded)
    assert code == 1
    assert "no difference in any deterministic message" in out
    assert LOST in out

    def other(key, row):
        return {**row, "trunk_height": 0.5} if key == "state/gait" and row["tick"] == 100 else row

    changed = rewritten(recorded, tmp_path / "other.mcap", other)
    code, out, _ = in_process("bisect", cut, changed)
    assert code == 1
    assert "no difference" not in out


def test_a_run_is_repeated_up_to_the_cut(in_process, cut):
    code, out, _ = in_process("verify", cut)
    assert code == 1
    assert LOST in out
    assert "the part that can be compared repeats to the bit" in out
    code, out, err = in_process("whatif", cut, "--at", "0.5")
    assert code == 0
    assert LOST in err
    rows = re.findall(r"  (-?[\d.]+) (m|mm|deg) +(-?[\d.]+) \2", out)
    assert len(rows) == 6
    assert all(before == after for before, _, after in rows)


def test_the_report_of_a_part_is_no_success(in_process, recorded, cut):
    for file, expected in ((recorded, 0), (cut, 1)):
        assert in_process("report", file, "-o", "part.html")[0] == expected


def test_another_version_is_remarked(in_process, recorded, tmp_path):
    other = rewritten(recorded, tmp_path / "other.mcap", same, version="99.0.0")
    assert "recorded by surefoot 99.0.0, this is" in in_process("why", other)[1]
    in_process("report", other, "-o", "r.html")
    assert "recorded by surefoot 99.0.0" in (tmp_path / "r.html").read_text()
    assert "surefoot 99.0.0 recorded," in in_process("verify", other)[1]
    assert "99.0.0" not in in_process("why", recorded)[1]
