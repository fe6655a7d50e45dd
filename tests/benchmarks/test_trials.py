"""Shares of selectors over made-up states."""

import math
from typing import Any

import numpy as np
import pytest

from benchmarks import trials
from benchmarks.trials import BRANCHES, Branching, complete, pairs_of, report, share_interval, shares
from surefoot.lab.footholds.walks import Setting
from surefoot.services.footholds.learning.samples import gather

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
    low, high = share_interval(lines, "hand")
    assert low < shares(lines, "hand")[0] < high
    assert 0.3 < low < high < 0.7


def test_stances_of_all_arms_are_samples_of_their_own(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(trials.GROUNDS, "short", Setting("rough", 0.15, 0.04, 0.5, profile="exact"))
    lines, found = pairs_of("short", 3, Branching("nominal,hand", draws=2, legs="all"))
    assert lines
    whole = [line for line in lines if all(np.isfinite(list(line["arms"].values())))]
    assert len(found) >= 3 * 2 * len(whole) > 0  # three legs of at least two different arms
    gathered = gather(found)
    assert not {"twice", "not_finite"} & set(gathered.refused)
    assert {each.trial for each in found} == {"pairs-all-ragno-short-3"}
    line = whole[0]
    mine = [each.sliding for each in found if each.step == line["step"] * BRANCHES]
    assert line["arms"]["nominal"] == pytest.approx(1e3 * np.mean(mine), abs=1e-4)


def test_the_table(capsys: pytest.CaptureFixture[str]) -> None:
    report([state(seed, 1.0, 0.5, 2.0, 1.0) for seed in range(4)], NAMES)
    text = capsys.readouterr().out
    assert "4 states" in text
    assert "100 %" in text
    assert "50 %" in text
