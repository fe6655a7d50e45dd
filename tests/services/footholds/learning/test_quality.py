"""Statistics of a model: order, warnings, honest intervals, on samples with a known law."""

import numpy as np
import pytest

from surefoot.services.footholds.learning.fit import Candidate, LearnOptions, learn
from surefoot.services.footholds.learning.quality import auc, expected, prediction_quality, slip_interval
from surefoot.services.footholds.learning.samples import PATCH, UNKNOWN_UM
from tests.services.footholds.learning.made import gather, samples, spoiled


def drawn(count: int, seed: int) -> list:
    """Slips that scatter about the law as a gamma distribution with a deviation of .7 of the mean."""
    rng = np.random.default_rng(seed)
    made = samples(count, seed)
    return [spoiled(s, sliding=s.sliding * float(rng.gamma(2.0, 0.5)), heights_um=()) for s in made]


def test_a_model_of_the_law_orders_warns_and_knows_its_spread() -> None:
    model = learn(gather(drawn(4000, 1)), LearnOptions(candidates=(Candidate(15, 0.1, 1e-6),)))
    found = prediction_quality(model, drawn(1500, 2))
    assert found.stances == 1500
    assert found.spearman > 0.7
    assert found.warned > 0.85
    assert found.held == pytest.approx(0.8, abs=0.12)
    others = drawn(1500, 2)
    order = np.random.default_rng(0).permutation(len(others))
    shuffled = [spoiled(s, sliding=others[j].sliding) for s, j in zip(others, order, strict=True)]
    assert abs(prediction_quality(model, shuffled).spearman) < 0.1


def test_the_interval_holds_its_share_of_a_gamma_distribution() -> None:
    rng = np.random.default_rng(3)
    draws = rng.gamma(1.5, 0.02, 20_000)
    low, high = slip_interval(np.full(len(draws), 0.03), np.full(len(draws), 0.02 * np.sqrt(1.5)), least=0.0)
    assert np.mean((draws >= low) & (draws <= high)) == pytest.approx(0.8, abs=0.01)
    low, high = slip_interval(np.full(len(draws), 0.04), np.full(len(draws), 0.02 * np.sqrt(1.5)), least=0.01)
    assert np.mean((draws + 0.01 >= low) & (draws + 0.01 <= high)) == pytest.approx(0.8, abs=0.01)


def test_what_is_expected_is_the_mean_over_where_the_foot_may_land() -> None:
    """Beside a wall the chosen cell is as flat as in the open; a foot that may land on its edge slides farther."""
    model = learn(gather(drawn(4000, 1)), LearnOptions(candidates=(Candidate(15, 0.1, 1e-6),)))
    flat = spoiled(drawn(1, 3)[0], k1=0.0, k2=0.0, cos_k3=0.0)
    rise = np.zeros((PATCH, PATCH), dtype=np.int64)
    rise[:, PATCH // 2 + 2 :] = 8_000
    unknown = np.full((PATCH, PATCH), UNKNOWN_UM, dtype=np.int64)
    heights = (np.zeros_like(rise), rise, unknown)
    stances = [spoiled(flat, leg=leg, heights_um=tuple(z.ravel().tolist())) for leg, z in enumerate(heights)]
    open_, beside, alone = expected(model, gather(stances))
    assert beside > 1.2 * open_
    assert alone == pytest.approx(expected(model, gather([spoiled(flat, heights_um=())]))[0])
    assert open_ == pytest.approx(alone, rel=0.1)


def test_the_area_is_the_share_of_pairs_in_order() -> None:
    rng = np.random.default_rng(0)
    score, positive = np.round(rng.normal(size=40), 1), rng.random(40) < 0.3
    pairs = [(a > b) + 0.5 * (a == b) for a in score[positive] for b in score[~positive]]
    assert auc(score, positive) == pytest.approx(float(np.mean(pairs)))
    assert np.isnan(auc(score, np.zeros(40, dtype=np.bool_)))
