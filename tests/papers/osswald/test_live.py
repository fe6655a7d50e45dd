"""Runs of the simulated Nao from a results file."""

import json

import numpy as np
import pytest

from surefoot.errors import SurefootError
from surefoot.papers.osswald import live
from tests.surefoot.expect import expect_error


def written(tmp_path, hand, sarsa, **more):
    runs = [("hand", t) for t in hand] + [("sarsa", t) for t in sarsa]
    lines = [
        {"arm": arm, "world": "hard", "seed": i, "problems": [], "values": {"goal_time_s": t}, **more}
        for i, (arm, t) in enumerate(runs)
    ]
    lines += [{"arm": "planner", "world": "hard"}, {"arm": "hand", "world": "easy"}]
    path = tmp_path / "live.jsonl"
    path.write_text("\n\n".join(map(json.dumps, lines)) + '\n{"arm": "hand", "wor', encoding="utf-8")
    return path


def test_times_stand_beside_those_of_the_paper(tmp_path):
    rng = np.random.default_rng(0)
    hand, sarsa = rng.normal(120, 5, 20).tolist(), rng.normal(108, 5, 20).tolist()
    rows = live.findings(written(tmp_path, hand, sarsa))
    assert [row.ok for row in rows] == [True, True, True]
    assert rows[0].ours == f"{np.mean(hand):.2f} +- {np.std(hand, ddof=1):.2f} (20 of 20)"
    assert rows[1].paper == "86.53 +- 8.60"
    assert rows[2].ours.startswith(f"{100 * (1 - np.mean(sarsa) / np.mean(hand)):.1f} ")


def test_slower_or_unsure_is_no_success(tmp_path):
    near = [100.0, 110.0, 105.0, 108.0]
    assert live.findings(written(tmp_path, near, [t + 20 for t in near]))[2].ok is False
    assert live.findings(written(tmp_path, near, [t - 0.1 for t in near]))[2].ok is False


def test_runs_that_did_not_arrive_or_do_not_count_are_failures(tmp_path):
    rows = live.findings(written(tmp_path, [100.0, None, 102.0], [90.0, 91.0, 90.5]))
    assert (rows[0].ok, rows[1].ok) == (False, True)
    assert "(2 of 3)" in rows[0].ours
    rows = live.findings(written(tmp_path, [100.0, 101.0], [90.0, 91.0], problems=["diverged"]))
    assert [row.ok for row in rows] == [False, False]
    assert rows[0].ours == "- (0 of 2)"


def test_a_file_without_runs_is_refused(tmp_path):
    with expect_error(SurefootError, "not_found", field="live"):
        live.read(tmp_path / "none.jsonl")
    for text in ("", "[1]\n3\nnull", '{"arm": "hand"}'):
        path = tmp_path / "live.jsonl"
        path.write_text(text, encoding="utf-8")
        with expect_error(SurefootError, "invalid", field="live"):
            live.read(path)
    path.write_bytes(b"\xff\xfe\x00")
    with pytest.raises(SurefootError):
        live.read(path)
