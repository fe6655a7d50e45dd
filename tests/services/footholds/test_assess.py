"""Layers of the scored ground."""

import numpy as np
import pytest

from surefoot.services.footholds.assess import LAYERS, Window, assess, whole_map, window_about
from surefoot.services.footholds.masks import Reason
from surefoot.services.footholds.models.files import load, shipped
from surefoot.services.footholds.models.protocol import SlipModel
from surefoot.services.footholds.models.score import HandScore
from surefoot.services.footholds.select import Landing, SelectParams, placement, select
from tests.services.footholds.grounds import CELL, STROKE, flat, ground_of, neutral, ragno, rough, standing
from tests.services.footholds.numpy_features import map_features_numpy

MODEL = HandScore()


def layers(z: np.ndarray, window: Window, nominal: tuple[float, float] | None) -> dict[str, np.ndarray]:
    found = assess(ground_of(z), MODEL, window, nominal, STROKE, LAYERS, SelectParams(distance_weight=8.0))
    return dict(zip(LAYERS, found.layers, strict=True))


def bumps() -> np.ndarray:
    return np.random.default_rng(0).normal(0.0, 0.004, (60, 80))


def test_whole_map() -> None:
    z = bumps()
    ground = ground_of(z)
    got = layers(z, whole_map(ground), None)
    expected = map_features_numpy(ground.surface.z, np.array(STROKE), CELL)
    np.testing.assert_allclose(got["k1"], expected.k1, atol=1e-6)
    np.testing.assert_allclose(got["cos_k3"], expected.cos_k3, atol=1e-6)
    assert np.isnan(got["spread"]).all()
    np.testing.assert_array_equal(got["support"], 0.0)
    np.testing.assert_array_equal(got["k4"], 0.0)
    np.testing.assert_array_equal(got["z"], ground.surface.z)
    np.testing.assert_array_equal(got["centre"], ground.centres.z)
    assert (got["mask"][0].astype(int) & Reason.UNKNOWN).all()


def test_window_is_a_part_of_the_map() -> None:
    z = bumps()
    ground = ground_of(z)
    window = window_about(ground, -0.35, -0.25, 15)
    whole, part = layers(z, whole_map(ground), None), layers(z, window, (-0.35, -0.25))
    cut = (slice(window.row, window.row + 15), slice(window.col, window.col + 15))
    for name in ("z", "centre", "k1", "k2", "cos_k3", "p", "mask"):
        np.testing.assert_array_equal(part[name], whole[name][cut])
    q, free = part["p"] + 8.0 * part["k4"], part["mask"] == 0
    assert free[7, 7]
    assert part["q"][7, 7] == pytest.approx(float(q[6:9, 6:9][free[6:9, 6:9]].mean()), abs=1e-6)
    np.testing.assert_allclose(part["q"][~free], q[~free], atol=1e-6)
    assert part["k4"][7, 7] == pytest.approx(0.0, abs=1e-6)
    assert part["k4"][7, 9] == pytest.approx(2 * CELL, abs=1e-6)


@pytest.mark.parametrize("seed", range(3))
def test_all_cells_nearer_than_clear_are_free(seed: int) -> None:
    ground = ground_of(rough(seed))
    window = window_about(ground, -0.1, 0.05, 31)
    mask, clear = assess(ground, MODEL, window, None, STROKE, ("mask", "clear"), SelectParams()).layers
    free = np.pad(mask == 0, 1)
    taken = np.argwhere(~free) - 1
    assert 0 < free.sum() < mask.size
    for (row, col), radius in np.ndenumerate(clear):
        least = CELL * np.hypot(taken[:, 0] - row, taken[:, 1] - col).min()
        assert radius == pytest.approx(least, abs=1e-6)


def test_leg_adds_reach() -> None:
    ground, foot = ground_of(flat()), neutral(0)
    window = window_about(ground, float(foot[0]), float(foot[1]), 61)
    placed = placement(ragno(), 0, standing(), STROKE)
    found = assess(ground, MODEL, window, None, STROKE, ("mask",), SelectParams(), placed)
    assert 0 < found.counts[0] < 61 * 61
    assert found.counts[0] == np.count_nonzero(found.layers[0].astype(int) & Reason.REACH)


@pytest.mark.parametrize("model", [HandScore(), load(shipped("ragno") or "")], ids=lambda model: model.name)
@pytest.mark.parametrize("gaps", [0.0, 0.08])
@pytest.mark.parametrize("seed", range(4))
def test_the_free_cell_of_the_least_q_is_the_choice_and_its_q_the_score(model: SlipModel, seed: int, gaps: float):
    z = rough(seed)
    z[np.random.default_rng(seed).random(z.shape) < gaps] = np.nan
    ground, foot, params = ground_of(z), neutral(0), SelectParams()
    at = (float(foot[0]) + 0.003, float(foot[1]))
    (chosen,) = select(ground, ragno(), model, standing(), [Landing(0, (*at, 0.0), STROKE)], params)
    placed = placement(ragno(), 0, standing(), STROKE)
    window = window_about(ground, *at, params.size)
    q, p, k4, mask, spread, support = assess(
        ground, model, window, at, STROKE, ("q", "p", "k4", "mask", "spread", "support"), params, placed
    ).layers
    best = np.unravel_index(int(np.argmin(np.where(mask == 0, q, np.inf))), q.shape)
    assert chosen.foothold is not None
    assert ground.surface.index(*chosen.foothold[:2]) == (window.row + best[0], window.col + best[1])
    assert (chosen.score, chosen.slip) == (pytest.approx(float(q[best])), pytest.approx(float(p[best])))
    if model.relief:
        assert chosen.score == pytest.approx(float(p[best] + model.distance_weight * k4[best]), abs=1e-6)
        assert chosen.spread == pytest.approx(float(spread[best]))
        assert ((support[mask == 0] >= 0.0) & (support[mask == 0] < 1.0)).all()
