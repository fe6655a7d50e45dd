"""Samples: what is refused, what a torn file still holds."""

import math

import numpy as np
import pytest

from surefoot.services.footholds.learning.samples import end_of, line_of, read_lines, trial_lines
from tests.services.footholds.learning.made import CELL, gather, samples, spoiled


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ({"k1": math.nan}, "not_finite"),
        ({"sliding": math.inf}, "not_finite"),
        ({"sliding": -1e-3}, "negative"),
        ({"sliding": 10.0}, "huge"),
        ({"stroke": (0.0, 0.0, 0.0)}, "no_stroke"),
    ],
)
def test_bad_samples_are_counted_by_reason(changes: dict[str, object], reason: str) -> None:
    good = samples(5)
    found = gather([spoiled(good[0], **changes), *good[1:]])
    assert found.refused == {reason: 1}
    assert len(found) == 4


def test_a_stance_counts_once_and_order_does_not_matter() -> None:
    made = samples(40)
    a, b = gather(made), gather([*reversed(made), made[3]])
    assert b.refused == {"twice": 1}
    assert np.array_equal(a.x, b.x)
    assert np.array_equal(a.r, b.r)
    assert np.array_equal(a.trial, b.trial)
    assert a.r[0] == pytest.approx(a.kept[0].sliding / 0.025)
    assert a.x[0, 1] == pytest.approx(a.kept[0].k2 / (8 * CELL))


def test_lines_come_back() -> None:
    made = samples(6, trials=1)
    read, trials, bad = read_lines(trial_lines("t00", made))
    assert read == made
    assert (trials, bad) == ({"t00": 6}, 0)


def test_unfinished_torn_and_repeated_trials() -> None:
    made = samples(6, trials=2)
    first, second = made[::2], made[1::2]
    lines = [*map(line_of, first[:2])]  # a worker died here; the trial was walked again
    lines += trial_lines("t00", first)
    lines += ['{"sample": {"trial": "t0', "", "nonsense"]
    lines += [*trial_lines("t00", first), *map(line_of, second), end_of("gone", 3)]
    read, trials, bad = read_lines(lines)
    assert read == first
    assert trials == {"t00": 3}
    assert bad == 3  # torn, nonsense, an end without its samples


@pytest.mark.parametrize("line", ['{"end": "a", "samples": 1e999}', "[" * 100_000, "1", "[]", '"sample"', "null"])
def test_lines_that_are_no_samples_are_counted(line: str) -> None:
    assert read_lines([line]) == ([], {}, 1)
