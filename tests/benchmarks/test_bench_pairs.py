"""Shares of selectors over made-up states."""

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from benchmarks.bench_pairs import complete, interval, kept, report, shares

NAMES = ("hand", "learned")


def state(seed: int, hand: float, learned: float, *random: float) -> dict[str, Any]:
    arms = {"hand": hand, "learned": learned} | {f"random-{k}": value for k, value in enumerate(random)}
    return {"ground": "rough", "seed": seed, "legs": "one", "step": 3, "arms": arms}


def test_only_states_with_all_outcomes_count() -> None:
    good = state(1, 1.0, 0.5, 2.0, 3.0)
    lacking = [state(1, math.nan, 0.5, 2.0, 3.0), state(1, 1.0, 0.5, 2.0, math.nan), {"ground": "rough", "end": 3}]
    without = state(1, 1.0, 0.5, 2.0, 3.0)
    del without["arms"]["learned"]
    assert complete([good, *lacking, without], NAMES) == [good]


def test_shares_and_intervals() -> None:
    rng = np.random.default_rng(2)
    lines = []
    for seed in range(12):
        for _ in range(5):
            best = rng.uniform(0.1, 0.5)
            lines.append(state(seed, best + 1.0, best, best + 1.0, best + 3.0))
    assert shares(lines, "learned") == (pytest.approx(1.0), pytest.approx(1.0))
    assert shares(lines, "hand") == (pytest.approx(0.5), pytest.approx(0.5))
    for line in lines:
        line["arms"]["hand"] += rng.uniform(-0.3, 0.3)
    low, high = interval(lines, "hand")
    assert low < shares(lines, "hand")[0] < high
    assert 0.3 < low < high < 0.7


def test_a_torn_file_and_the_table(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "pairs.jsonl"
    lines = [state(seed, 1.0, 0.5, 2.0, 1.0) for seed in range(4)]
    path.write_text("".join(f"{json.dumps(line)}\n" for line in lines) + '{"ground": "rou')
    assert kept(path) == lines
    assert kept(tmp_path / "none") == []
    report(kept(path), NAMES)
    text = capsys.readouterr().out
    assert "4 states" in text
    assert "100 %" in text
    assert "50 %" in text
