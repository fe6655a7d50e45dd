"""Re-learning: (19) and the counted form against their equations, and against learning from everything at once."""

import numpy as np
import pytest

from surefoot.services.footholds.learning import relearner
from surefoot.services.footholds.learning.fit import Candidate, LearnError, LearnOptions, learn
from surefoot.services.footholds.learning.merge import merge
from surefoot.services.footholds.learning.relearn import relearned
from surefoot.services.footholds.models.lattice import filled
from surefoot.services.footholds.models.learned import LearnedModel
from tests.services.footholds.learning.made import gather, law, samples, spoiled
from tests.services.refusals import refused

ONE = LearnOptions(candidates=(Candidate(12, 0.3, 1e-6),))
OLD = samples(400, seed=1, noise=0.1)
NEW = [spoiled(each, trial=f"new {each.trial}") for each in samples(300, seed=2, noise=0.1)]


def old() -> LearnedModel:
    return learn(gather(OLD), ONE)


def test_the_counted_form_with_weight_1_is_learning_from_all() -> None:
    again, everything = relearned(old(), NEW), learn(gather([*OLD, *NEW]), ONE)
    assert again.bins == everything.bins
    np.testing.assert_array_equal(again.terms.weights, everything.terms.weights)
    assert (again.ranges, again.name) == (everything.ranges, f"{everything.name}+1")
    assert merge(old(), learn(gather(NEW), ONE)).bins == everything.bins


def test_both_forms_follow_their_equations() -> None:
    model, c = old(), 0.4
    found = gather(NEW)
    fresh = filled(model.lattice, found.x, found.r)
    both = [key for key in fresh if key in model.bins]
    assert len(both) > 20
    counted, paper = relearned(model, NEW, "counted", c), relearned(model, NEW, "paper", c)
    for key in both:
        a, b = model.bins[key], fresh[key]
        mean = (a.count * a.mean + c * b.count * b.mean) / (a.count + c * b.count)
        assert counted.bins[key].mean == pytest.approx(mean, abs=1e-8)
        assert counted.bins[key].count == pytest.approx(a.count + c * b.count)
        assert paper.bins[key].mean == pytest.approx((a.mean + c * b.mean) / (1.0 + c), abs=1e-8)
        assert paper.bins[key].count == a.count
    for key, each in fresh.items():
        if key not in model.bins:
            assert paper.bins[key] == each
    assert all(counted.bins[key] == each for key, each in model.bins.items() if key not in fresh)


def test_ground_that_was_withheld_is_learned_in_a_round() -> None:
    cell = OLD[0].cell
    known = [each for each in OLD if each.k2 < 0.35 * 8 * cell]
    model = learn(gather(known), ONE)
    again = relearned(model, NEW)
    held = gather(samples(500, seed=3))
    truth = law(held.x[:, 0] * held.x[:, 1], held.x[:, 1], held.x[:, 2])

    def error(one: LearnedModel) -> float:
        u = np.column_stack((held.x[:, 0] * held.x[:, 1], held.x[:, 1], held.x[:, 2]))
        return float(np.sqrt(np.mean((one.terms.values(u) - truth) ** 2)))

    assert error(again) < 0.3 * error(model)


def test_the_source_of_outcomes_keeps_one_line() -> None:
    model = old()
    for k in range(3):
        mine = [spoiled(each, trial=f"{k} {each.trial}", source="own slip") for each in NEW]
        model = relearned(model, mine, "paper", 0.5)
    assert [line for line in model.provenance if "own slip" in line] == [
        "re-learned (paper, c = 0.5): own slip, samples 900"
    ]
    assert model.name.endswith("+3")


@pytest.mark.parametrize(
    ("outcomes", "weight", "code"),
    [
        ([], 1.0, "no_samples"),
        ([spoiled(NEW[0], sliding=float("nan"))], 1.0, "no_samples"),
        ([spoiled(NEW[0], cell=0.01)], 1.0, "mixed_conditions"),
        ([spoiled(NEW[0], robot="messor")], 1.0, "mixed_conditions"),
        (NEW, -0.1, "invalid"),
        (NEW, float("nan"), "invalid"),
    ],
)
def test_outcomes_that_do_not_go_with_the_model_are_refused(outcomes: list, weight: float, code: str) -> None:
    with refused(LearnError, code):
        relearned(old(), outcomes, "counted", weight)


def test_outcomes_that_are_known_again_are_bounded(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(relearner, "MOST", 5)
    learner = relearner.Relearner(relearner.RelearnParams(every=100), lambda text: None)
    taken = [spoiled(each, trial=f"own {k}") for k, each in enumerate(samples(8))]
    learner.take(taken[:1] * 2)
    assert learner.refused == {"twice": 1}
    for each in taken:
        learner.close()  # nothing waits
        learner.take([each])
    assert len(learner._known) == 5
