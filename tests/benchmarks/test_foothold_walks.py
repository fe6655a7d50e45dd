"""Comparison of rules: pairs by seed, failed walks; each target can be met and missed."""

import numpy as np
import pytest

from benchmarks.foothold_walks import (
    EASY,
    GROUNDS,
    OVER_RANDOM,
    SEEDS,
    TAUGHT,
    Lines,
    comparison,
    over_flat,
    paired,
    verdicts,
)
from surefoot.lab.studies import Line


def line(ground: str, rule: str, seed: int, sliding: float) -> Line:
    return {"ground": ground, "rule": rule, "seed": seed, "sliding_mm": sliding, "reached": True, "fallen": False}


def lines(*found: Line) -> Lines:
    return {(each["ground"], each["rule"], each["seed"]): each for each in found}


def test_grounds_of_the_target_have_both_maps() -> None:
    assert len(TAUGHT) == 8
    assert {GROUNDS[name].profile for name in TAUGHT} == {"exact", "noise"}
    assert {GROUNDS[name].friction for name in TAUGHT} == {0.4, 0.5}


def test_pairs_are_of_equal_seeds_and_failed_walks_have_none() -> None:
    failed = {"ground": "rough", "rule": "hand", "seed": 2, "error": "x"}
    found = lines(
        line("rough", "learned", 2, 1.0), line("rough", "learned", 1, 0.5), line("rough", "hand", 1, 1.5),
        line("rough", "hand", 3, 9.0), line("mixed", "hand", 2, 9.0), failed,
    )  # fmt: skip
    a, b = paired(found, "rough", "learned", "hand")
    np.testing.assert_array_equal(a, [0.5])
    np.testing.assert_array_equal(b, [1.5])
    assert not paired(found, "flat", "learned", "hand")[0].size


def test_the_table_counts_falls_and_compares() -> None:
    fallen = line("rough", "hand", 2, 3.0) | {"fallen": True, "reached": False}
    found = lines(
        line("rough", "learned", 1, 0.5), line("rough", "learned", 2, 1.0), line("rough", "hand", 1, 1.0), fallen
    )
    mine, hand, mean = comparison(found, ["rough"], ["learned", "hand", "random"])
    assert mine[1:] == ("learned", 0.75, "2/2", 0)
    assert hand[1:6] == ("hand", 2.0, "1/2", 1, pytest.approx(0.375))
    assert mean[:2] == ("mean of 1 grounds", "hand")
    assert mean[5] == pytest.approx(0.375)


def walks(seeds: int, sliding: dict[str, float], falls: str = "") -> Lines:
    found: Lines = {}
    for ground in (*TAUGHT, *EASY):
        for rule, value in sliding.items():
            for seed in range(seeds):
                found[ground, rule, seed] = {
                    "ground": ground, "rule": rule, "seed": seed, "sliding_mm": value * (1.0 + 0.01 * seed),
                    "reached": True, "fallen": rule == falls and seed == 0,
                }  # fmt: skip
    return found


GOOD = {"learned": 0.3, "hand": 0.6, "random": 3.0, "nominal": 1.5, "min-k2:8": 0.9, "grid-map:4": 0.8}


def test_all_targets_are_checked_and_met() -> None:
    found = list(verdicts(walks(SEEDS, GOOD)))
    assert len(found) == 2 + len(EASY) + len(OVER_RANDOM) + 3 + 1
    assert all(each.met for each in found)
    assert not any(each.row()[4] for each in found)
    assert len(list(over_flat(walks(2, GOOD)))) == len(TAUGHT)


@pytest.mark.parametrize(
    ("changes", "falls", "what"),
    [
        ({"hand": 0.4}, "", "hand, mean of 8"),
        ({"hand": 0.29}, "", "worst interval"),
        ({"hand": 0.28}, "", "on flat"),
        ({"random": 1.9}, "", "random on rough"),
        ({"random": 0.8}, "", "random on elevation"),
        ({"nominal": 0.3}, "", "nominal, mean"),
        ({"grid-map:4": 0.2}, "", "grid-map:4"),
        ({}, "learned", "falls"),
    ],
)
def test_each_target_can_be_missed(changes: dict[str, float], falls: str, what: str) -> None:
    found = [each for each in verdicts(walks(SEEDS, GOOD | changes, falls)) if what in each.what]
    assert [each.met for each in found] == [False]
    assert found[0].row()[3] == "missed"


def test_a_mean_over_some_of_the_grounds_is_open_and_few_seeds_are_named() -> None:
    some = {key: line for key, line in walks(3, GOOD).items() if key[0] in ("rough", "flat")}
    first = next(verdicts(some))
    assert first.value == pytest.approx(0.5)
    assert first.met is None
    assert first.row()[3] == "open"
    assert "1 of 8 grounds" in first.what
    assert first.row()[4] == f"3 seeds of {SEEDS}"
    assert list(verdicts({})) == []
    assert over_flat({}) == []
