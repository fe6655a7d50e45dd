"""Verdicts: each target can be met and missed, and too few walks are said."""

import pytest

from benchmarks.walk_rules import TAUGHT, Lines
from benchmarks.walk_targets import EASY, OVER_RANDOM, SEEDS, over_flat, verdicts


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


def test_all_targets_are_judged_and_met() -> None:
    found = list(verdicts(walks(SEEDS, GOOD)))
    assert len(found) == 2 + len(EASY) + len(OVER_RANDOM) + 3 + 1
    assert all(each.met for each in found)
    assert not any(" seeds of " in str(each) for each in found)
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
    assert "missed" in str(found[0])


def test_a_mean_over_some_of_the_grounds_is_open_and_few_seeds_are_said() -> None:
    some = {key: line for key, line in walks(3, GOOD).items() if key[0] in ("rough", "flat")}
    first = next(verdicts(some))
    assert first.value == pytest.approx(0.5)
    assert first.met is None
    assert "open" in str(first)
    assert "1 of 8 grounds" in first.what
    assert f"3 seeds of {SEEDS}" in str(first)
    assert list(verdicts({})) == []
    assert list(over_flat({})) == []
