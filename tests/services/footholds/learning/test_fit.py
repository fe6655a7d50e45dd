"""Learning finds the law behind samples, equal bytes come from equal samples, bad ones are refused."""

import numpy as np
import pytest

from surefoot.services.footholds.features import Features
from surefoot.services.footholds.learning.fit import Candidate, LearnError, LearnOptions, candidates, fit_terms, learn
from surefoot.services.footholds.learning.merge import candidate_of
from surefoot.services.footholds.learning.relearn import relearned
from surefoot.services.footholds.learning.samples import gather
from surefoot.services.footholds.models.files import decode, encode
from surefoot.services.footholds.models.lattice import Lattice, filled, inputs
from surefoot.services.footholds.models.protocol import UNLEARNED
from tests.services.footholds.learning.made import CELL, FOOT, law, samples, spoiled
from tests.services.refusals import refused

QUICK = LearnOptions(candidates=(Candidate(15, 0.1, 1e-6), Candidate(40, 0.3, 1e-8)))


def layer(values: np.ndarray) -> np.ndarray:
    return values[None].astype(np.float32)


def test_finds_the_law_and_its_table_agrees() -> None:
    model = learn(gather(samples(4000)), QUICK)
    rng = np.random.default_rng(1)
    b = rng.uniform(0.05, 0.75, 300)
    a, c = rng.uniform(-0.9, 0.9, 300) * b, rng.uniform(-0.3, 0.3, 300) * b
    found = model.predict(Features(layer(a * 8 * CELL), layer(b * 8 * CELL), layer(c)), CELL)[0]
    known = found != UNLEARNED
    assert known.mean() > 0.95
    np.testing.assert_allclose(found[known], law(a, b, c)[known], atol=0.012)
    assert model.table_error() < 0.005
    exact = model.terms.values(np.column_stack((a, b, c)))
    np.testing.assert_allclose(found[known], np.maximum(exact, 0.0)[known], atol=0.005)
    assert model.unfit(CELL, True, FOOT) == ""
    for wrong in ((0.01, True, FOOT), (CELL, False, FOOT), (CELL, True, 0.02)):
        assert model.unfit(*wrong)


def test_the_better_size_is_chosen_on_trials_that_were_held_back() -> None:
    found = gather(samples(3000, noise=0.3))
    errors = [learn(found, LearnOptions(candidates=(c,))).choice["error"] for c in QUICK.candidates]
    assert learn(found, QUICK).choice["error"] == min(errors)


def test_equal_samples_in_any_order_give_equal_bytes() -> None:
    made = samples(800)
    assert encode(learn(gather(made), QUICK)) == encode(learn(gather(reversed(made)), QUICK))
    assert encode(learn(gather(made), QUICK)) != encode(learn(gather(made[1:]), QUICK))


def test_spread_is_that_of_the_bin() -> None:
    model = learn(gather(samples(4000, noise=0.5)), QUICK)
    a, b, c = np.array([0.0]), np.array([0.42]), np.array([0.02])
    found = float(model.spread(Features(layer(a), layer(b * 8 * CELL), layer(c)), CELL)[0, 0])
    assert found == pytest.approx(0.5 * float(law(a, b, c)[0]), rel=0.5)
    nowhere = Features(layer(a), layer(np.array([3.0]) * 8 * CELL), layer(c))
    assert np.isnan(model.spread(nowhere, CELL)).all()


def test_cells_outside_ranges_or_without_support_are_unlearned() -> None:
    made = gather(samples(500))
    model = learn(made, LearnOptions(candidates=QUICK.candidates[:1], support=2))
    u = inputs(made.x)
    inside = Features(*(layer(column * scale) for column, scale in zip(u.T, (8 * CELL, 8 * CELL, 1.0), strict=True)))
    keys = [tuple(key) for key in model.lattice.keys(made.x).tolist()]
    lone = np.array([model.bins[key].count < 2 for key in keys])
    found = model.predict(inside, CELL)[0]
    assert 0.05 < lone.mean() < 0.95
    assert (found[~lone] != UNLEARNED).mean() > 0.99  # float32 may put a point on an edge into the next bin
    assert (found[lone] == UNLEARNED).mean() > 0.95
    box = learn(made, LearnOptions(candidates=QUICK.candidates[:1]))
    assert (box.predict(inside, CELL) == UNLEARNED).mean() < 0.02
    far = Features(layer(np.array([0.0, np.nan])), layer(np.array([1.0, 1.0])), layer(np.array([0.0, 0.0])))
    values = box.predict(far, CELL)[0]
    assert values[0] == UNLEARNED
    assert values[1] == UNLEARNED or np.isnan(values[1])


def test_cancelled_between_fits() -> None:
    shares: list[float] = []

    def stop(share: float) -> bool:
        shares.append(share)
        return len(shares) < 4

    with refused(LearnError, "cancelled"):
        learn(gather(samples(300)), QUICK, stop)
    assert shares == sorted(shares)
    assert len(shares) == 4


def test_what_cannot_be_learned_from_is_named() -> None:
    made = samples(100)
    for given, code in (
        ([], "no_samples"),
        ([spoiled(made[0], k1=float("nan"))], "no_samples"),
        ([spoiled(s, k1=0.0, k2=0.01, cos_k3=0.1) for s in made], "all_alike"),
        ([spoiled(s, trial=s.trial if s.trial < "t03" else "t00") for s in made], "too_few_trials"),
        ([*made, spoiled(made[0], step=999, cell=0.01)], "mixed_conditions"),
        ([*made, spoiled(made[0], step=999, robot="messor")], "mixed_conditions"),
    ):
        with refused(LearnError, code):
            learn(gather(given), QUICK)


@pytest.mark.parametrize(
    ("family", "search", "refined"),
    [
        ("gaussian", "drawn", 20),
        ("gaussian", "swarm", 0),
        ("gaussian", "swarm", 20),
        ("gaussian", "evolution", 0),
        ("gaussian", "evolution", 20),
        ("elementary", "evolution", 0),
    ],
)
def test_every_family_and_search_learns_and_is_kept_in_the_file(family: str, search: str, refined: int) -> None:
    tried = candidates(family, search, 6, 150, refined)[:2]  # type: ignore[arg-type]
    options = LearnOptions(candidates=tried, folds=2)
    model = learn(gather(samples(300, trials=6)), options)
    assert model.choice["error"] < 0.06
    again = decode(encode(model))
    assert encode(again) == encode(model) == encode(learn(gather(samples(300, trials=6)), options))
    assert candidate_of(again) in tried
    more = [spoiled(each, trial=f"n{each.trial}") for each in samples(50, seed=5)]
    assert relearned(again, more).name.endswith("+1")


def test_a_hybrid_is_no_worse_than_its_start() -> None:
    found = gather(samples(400))
    bins = filled(Lattice(), found.x, found.r)
    costs = []
    for refined in (0, 60):
        (one, *_) = candidates("gaussian", "swarm", 6, 200, refined)
        terms = fit_terms(Lattice(), bins, one, 0)
        y = np.array([each.mean for each in bins.values()])
        costs.append(float(np.mean((terms.values(inputs(Lattice().centres(bins))) - y) ** 2)))
    assert costs[1] < 0.5 * costs[0]


def test_a_blind_model_does_not_look_at_the_third_coefficient() -> None:
    found = gather(samples(400))
    bins = filled(Lattice(), found.x, found.r)
    u = inputs(found.x[:20])
    for one in (
        Candidate(8, 0.1, 1e-6, blind=True),
        Candidate(6, 0.0, 1e-6, family="elementary", search="evolution", evaluations=100, blind=True),
    ):
        terms = fit_terms(Lattice(), bins, one, 0)
        other = u * np.array([1.0, 1.0, -1.0])
        np.testing.assert_allclose(terms.values(u), terms.values(other), atol=1e-12)


@pytest.mark.parametrize(
    ("family", "search", "evaluations"),
    [("elementary", "drawn", 10), ("elementary", "swarm", 10), ("gaussian", "swarm", 0)],
)
def test_what_does_not_go_together_is_refused(family: str, search: str, evaluations: int) -> None:
    with refused(LearnError, "invalid"):
        candidates(family, search, 5, evaluations)  # type: ignore[arg-type]
