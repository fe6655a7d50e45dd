"""Rules: every one chooses, the rivals prefer what their rules state, draws repeat with their seed."""

import math

import numpy as np
import pytest

from benchmarks.foothold_walks import rule_of
from benchmarks.rivals import GridMapRule, MinK2
from surefoot.lab.footholds.rules import exploring_rule, model_rule, random_rule
from surefoot.services.footholds.features import Features
from surefoot.services.footholds.models.score import HandScore
from surefoot.services.footholds.select import SelectParams
from tests.services.footholds.grounds import CELL, ground_of, landing, ragno, standing


def hilly(seed: int) -> np.ndarray:
    rng = np.random.default_rng(seed)
    x, y = np.meshgrid(CELL * np.arange(200), CELL * np.arange(160))
    return 0.01 * np.sin(x / 0.03 + rng.uniform(0, 6)) * np.cos(y / 0.03 + rng.uniform(0, 6))


@pytest.mark.parametrize("name", ["learned", "learned:2", "hand", "min-k2:8", "grid-map:8", "averaged:8", "random"])
def test_every_named_rule_chooses(name: str) -> None:
    rule = rule_of(name, 3, "shipped", "ragno")
    assert rule is not None
    found = rule(ground_of(hilly(1), smooth=True), ragno(), standing(), [landing(0), landing(4)], 1)
    assert [each.status for each in found] == ["ok", "ok"]


def test_names_that_are_no_rule() -> None:
    assert rule_of("nominal", 0, "shipped", "ragno") is None
    with pytest.raises(ValueError, match="min-k2"):
        rule_of("best", 0, "shipped", "ragno")
    with pytest.raises(ValueError, match="messor"):
        rule_of("learned", 0, "shipped", "messor")


@pytest.mark.parametrize("model", [MinK2(), GridMapRule()])
def test_rivals_prefer_flat_cells_and_a_weight_pulls_them_back(model: MinK2 | GridMapRule) -> None:
    ground, legs = ground_of(hilly(2)), [landing(leg) for leg in range(6)]
    free = model_rule(model, SelectParams(distance_weight=0.0))(ground, ragno(), standing(), legs, 1)
    near = model_rule(model, SelectParams(distance_weight=100.0))(ground, ragno(), standing(), legs, 1)

    def way(found) -> float:  # type: ignore[no-untyped-def]
        return sum(math.dist(f.foothold[:2], leg.nominal[:2]) for f, leg in zip(found, legs, strict=True))

    assert sum(each.slip for each in free) < sum(each.slip for each in near)
    assert way(near) < 0.5 * way(free)
    assert np.isnan([each.spread for each in free]).all()


def test_slope_of_the_grid_map_rule() -> None:
    slope = 0.3
    k2 = np.full((1, 1), 6.0 * CELL * slope, dtype=np.float32)  # a plane along x
    features = Features(np.zeros((1, 1), dtype=np.float32), k2, np.zeros((1, 1), dtype=np.float32))
    cost = float(GridMapRule().predict(features, CELL)[0, 0])
    assert cost == pytest.approx(0.5 * math.atan(slope) / 0.6, rel=0.15)


def test_draws_repeat_and_exploration_keeps_its_share() -> None:
    ground, legs = ground_of(hilly(4)), [landing(0)]
    mine = model_rule(HandScore(), SelectParams())
    either, drawn = exploring_rule(5, 0.3, mine), random_rule(5)
    explored = 0
    chosen = mine(ground, ragno(), standing(), legs, 0)[0].foothold
    for step in range(60):
        found = either(ground, ragno(), standing(), legs, step)[0].foothold
        at_random = drawn(ground, ragno(), standing(), legs, step)[0].foothold
        assert found in (chosen, at_random)
        explored += found == at_random
    assert 8 <= explored <= 30
    with pytest.raises(ValueError, match=r"1\.5"):
        exploring_rule(5, 1.5, mine)
