"""Models made one."""

from dataclasses import replace

import pytest

from surefoot.services.footholds.learning.fit import Candidate, LearnError, LearnOptions, learn
from surefoot.services.footholds.learning.merge import merge
from surefoot.services.footholds.models.files import decode, encode
from surefoot.services.footholds.models.lattice import Lattice
from surefoot.services.footholds.models.learned import LearnedModel
from tests.services.footholds.learning.made import gather, samples, spoiled
from tests.services.refusals import refused

ONE = LearnOptions(candidates=(Candidate(12, 0.1, 1e-6),))


def two() -> tuple[LearnedModel, LearnedModel]:
    """Models of different trials."""
    second = [spoiled(each, trial=f"other {each.trial}") for each in samples(400, 1)]
    return learn(gather(samples(400)), ONE), learn(gather(second), ONE)


def bins_of(model: LearnedModel) -> bytes:
    data = encode(model)
    return data[data.index(b'"bins"') :]


def test_merged_models_equal_learning_from_both_sets() -> None:
    made = samples(1200, trials=12)
    first, second = ([s for s in made if (s.trial < "t06") == left] for left in (True, False))
    a, b, both = (learn(gather(part), ONE) for part in (first, second, made))
    joined = merge(a, b)
    assert bins_of(joined) == bins_of(both) == bins_of(merge(b, a))
    assert (joined.ranges, joined.terms.weights) == (both.ranges, pytest.approx(both.terms.weights))
    assert encode(decode(encode(joined))) == encode(joined)
    assert joined.name == "learned/1200"


def test_less_weight_counts_for_less() -> None:
    a, b = two()
    half = merge(a, b, 0.5)
    assert sum(each.count for each in half.bins.values()) == pytest.approx(600.0)


def test_what_does_not_go_together() -> None:
    a, b = two()
    for other, code in (
        (a, "twice"),
        (merge(a, b), "twice"),
        (replace(b, relief=True), "mixed_conditions"),
        (replace(b, lattice=Lattice(width=(0.1, 0.1, 0.1))), "other_lattice"),
        (replace(b, conditions=replace(b.conditions, cell=0.01)), "mixed_conditions"),
    ):
        with refused(LearnError, code):
            merge(a, other)
    with pytest.raises(LearnError):
        merge(a, b, 1.5)
    with pytest.raises(LearnError):
        merge(replace(a, choice={}), b)
