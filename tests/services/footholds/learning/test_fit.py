"""Learning finds the law behind samples, equal bytes come from equal samples, bad ones are refused."""

from dataclasses import replace

import numpy as np
import pytest

from surefoot.services.footholds.features import Features
from surefoot.services.footholds.learning import fit
from surefoot.services.footholds.learning.merge import candidate_of
from surefoot.services.footholds.learning.relearn import relearned
from surefoot.services.footholds.models.files import decode, encode
from surefoot.services.footholds.models.lattice import inputs
from surefoot.services.footholds.models.learned import rule_columns
from surefoot.services.footholds.models.protocol import UNLEARNED
from tests.services.footholds.learning.made import CELL, FOOT, gather, law, of_planes, samples, spoiled
from tests.services.refusals import refused

QUICK = fit.LearnOptions(candidates=(fit.Candidate(15, 0.1, 1e-6), fit.Candidate(40, 0.3, 1e-8)))


def layer(values: np.ndarray) -> np.ndarray:
    return values[None].astype(np.float32)


def test_finds_the_law_and_its_table_agrees() -> None:
    model = fit.learn(gather(samples(2000)), QUICK)
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


def test_the_size_that_orders_best_on_what_was_held_back_is_chosen() -> None:
    found = gather(samples(1500, noise=0.3))
    ranks = [fit.learn(found, fit.LearnOptions(candidates=(c,))).choice["rank"] for c in QUICK.candidates]
    assert fit.learn(found, QUICK).choice["rank"] == max(ranks)


def test_equal_samples_in_any_order_give_equal_bytes() -> None:
    made = samples(400)
    found = encode(fit.learn(gather(made), QUICK))
    assert found == encode(fit.learn(gather(reversed(made)), QUICK))
    assert found != encode(fit.learn(gather(made[1:]), QUICK))


def test_spread_is_that_of_the_bin() -> None:
    model = fit.learn(gather(samples(4000, noise=0.5)), QUICK)
    a, b, c = np.array([0.0]), np.array([0.42]), np.array([0.02])
    found = float(model.spread(Features(layer(a), layer(b * 8 * CELL), layer(c)), CELL)[0, 0])
    assert found == pytest.approx(0.5 * float(law(a, b, c)[0]), rel=0.5)
    unknown = Features(layer(a), layer(np.array([np.nan])), layer(c))
    assert np.isnan(model.spread(unknown, CELL)).all()


def test_cells_outside_ranges_or_without_support_are_unlearned() -> None:
    made = gather(samples(500))
    model = fit.learn(made, fit.LearnOptions(candidates=QUICK.candidates[:1], support=2))
    u = inputs(made.x)
    inside = Features(*(layer(column * scale) for column, scale in zip(u.T, (8 * CELL, 8 * CELL, 1.0), strict=True)))
    keys = [tuple(key) for key in model.lattice.keys(made.x).tolist()]
    lone = np.array([model.bins[key].count < 2 for key in keys])
    found = model.predict(inside, CELL)[0]
    assert 0.05 < lone.mean() < 0.95
    assert (found[~lone] != UNLEARNED).mean() > 0.99  # float32 may put a point on an edge into the next bin
    assert (found[lone] == UNLEARNED).mean() > 0.95
    box = fit.learn(made, fit.LearnOptions(candidates=QUICK.candidates[:1]))
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

    with refused(fit.LearnError, "cancelled"):
        fit.learn(gather(samples(300)), QUICK, stop)
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
        with refused(fit.LearnError, code):
            fit.learn(gather(given), QUICK)


def test_the_file_and_another_round_keep_size_and_trust_of_the_fit() -> None:
    tried = tuple(replace(each, enough=50.0) for each in QUICK.candidates)
    made = [spoiled(each, source=f"{each.trial[-1]} ground exact") for each in samples(600)]
    model, beside = fit.learn_and_compare(of_planes(made), replace(QUICK, candidates=tried))
    again = decode(encode(model))
    assert encode(again) == encode(model)
    assert candidate_of(again) in tried
    assert (beside.by, again.relief, len(again.trials)) == ("terrains", True, 10)
    more = [spoiled(each, trial=f"n{each.trial}") for each in samples(50, seed=5)]
    assert relearned(again, more).name.endswith("+1")
    with refused(fit.LearnError, "no_samples"):
        relearned(again, made[:50])  # it knows these trials


def test_a_model_falls_back_to_a_rule_that_only_grows_with_steepness() -> None:
    made = [each for each in samples(600) if each.k2 < 0.4 * 8 * CELL]
    model = fit.learn(of_planes(made), fit.LearnOptions(candidates=(fit.Candidate(15, 0.1, 1e-6, enough=20.0),)))
    steep = np.array([0.1, 0.3, 0.6, 1.5, 3.9])
    k = Features(layer(np.zeros(5)), layer(steep * 8 * CELL), layer(steep / np.hypot(1.0, steep)))
    found, support = model.predict(k, CELL)[0], model.support_of(k, CELL)[0]
    assert (found >= 0.0).all()
    assert (np.diff(found[2:]) > 0.0).all() or found[-1] == 1.0
    assert support[0] > 0.3
    assert (support[2:] == 0.0).all()
    rule = (rule_columns(steep) * model.base).sum(axis=1)
    np.testing.assert_allclose(found[3:], np.minimum(rule, 1.0)[3:], atol=0.01)


def test_shuffled_slips_give_a_warning_and_true_ones_none() -> None:
    made = [spoiled(s, source=f"{s.trial[-1]} ground exact") for s in samples(1500, noise=0.5)]
    order = np.random.default_rng(0).permutation(len(made))
    mixed_up = [spoiled(s, sliding=made[k].sliding) for s, k in zip(made, order, strict=True)]
    options = fit.LearnOptions(candidates=fit.CANDIDATES[:2])
    assert "held back" in fit.learn_and_compare(of_planes(mixed_up), options)[1].warning
    rows = fit.learn_and_compare(of_planes(made), options)[1].rows
    assert [row.name for row in rows] == ["learned", "hand-made", "min-K2", "nominal"]
    assert rows[0].r2 > 0.5
    assert rows[0].rank > rows[1].rank
    assert 0.6 < rows[0].held < 1.0
