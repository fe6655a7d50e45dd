"""The comparison of rules: pairs by seed, intervals, what a results file keeps, failed walks."""

import json
from pathlib import Path

import numpy as np
import pytest

from benchmarks import walk_rules
from benchmarks.walk_rules import GROUNDS, TAUGHT, Line, Lines, kept, mean_ratio, paired, ratio, table, walk_missing


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


def test_intervals_hold_the_ratio_and_narrow_with_pairing() -> None:
    rng = np.random.default_rng(1)
    b = rng.uniform(0.5, 3.0, 20)
    value, low, high = ratio(0.5 * b, b, np.random.default_rng(0))
    assert value == pytest.approx(0.5)
    assert high - low < 1e-9  # each pair says the same, however much the seeds differ
    a = b * rng.uniform(0.2, 0.8, 20)
    value, low, high = ratio(a, b, np.random.default_rng(0))
    assert low < value < high < 0.8
    whole, low_whole, high_whole = mean_ratio([(a, b), (0.5 * b, b)], np.random.default_rng(0))
    assert whole == pytest.approx(0.5 * (value + 0.5))
    assert high_whole - low_whole < high - low


def test_walks_in_the_file_are_not_walked_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    results = tmp_path / "walks.jsonl"
    results.write_text(json.dumps(line("rough", "hand", 1, 2.0)) + '\n{"torn": ')
    results.write_text(results.read_text() + "\n")
    known = kept(results)
    assert list(known) == [("rough", "hand", 1)]
    asked: list[tuple[str, str, int]] = []

    class InPlace:
        def __init__(self, jobs: int) -> None: ...
        def __enter__(self) -> "InPlace":
            return self

        def __exit__(self, *_: object) -> None: ...
        def map(self, _, jobs):  # type: ignore[no-untyped-def]
            for job in jobs:
                asked.append((job[0], job[1], job[2]))
                yield line(job[0], job[1], job[2], 1.0)

    monkeypatch.setattr(walk_rules, "ProcessPoolExecutor", InPlace)
    walk_missing(known, ["rough"], ["learned", "hand"], range(1, 3), "shipped", "ragno", 1, results)
    assert asked == [("rough", "learned", 1), ("rough", "learned", 2), ("rough", "hand", 2)]
    assert kept(results) == known
    assert len(known) == 4


def test_the_table_counts_falls_and_compares() -> None:
    fallen = line("rough", "hand", 2, 3.0) | {"fallen": True, "reached": False}
    found = lines(
        line("rough", "learned", 1, 0.5), line("rough", "learned", 2, 1.0), line("rough", "hand", 1, 1.0), fallen
    )
    text = "\n".join(table(found, ["rough"], ["learned", "hand", "random"]))
    assert "1/2 reached, 1 fell" in text
    assert "learned / it 0.375" in text
    assert "random" not in text
    assert "learned / hand, mean of 1 grounds: 0.375" in text
