"""The hand-made score: its formula, and the order the paper found."""

from dataclasses import fields

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from surefoot.services.footholds.features import Features, map_features
from surefoot.services.footholds.models.protocol import SlipModel
from surefoot.services.footholds.models.score import HandScore

CELL = 0.005
FORWARD = np.array([-0.05, 0.0, 0.0])


def one(k1: float, k2: float, cos_k3: float, model: SlipModel | None = None, cell: float = CELL) -> float:
    cells = [np.full((1, 1), value, dtype=np.float32) for value in (k1, k2, cos_k3)]
    return float((model or HandScore()).predict(Features(*cells), cell)[0, 0])


def centre(z: np.ndarray) -> float:
    features = map_features(z.astype(np.float32), FORWARD, CELL)
    return float(HandScore().predict(features, CELL)[z.shape[0] // 2, z.shape[1] // 2])


@given(st.floats(-0.2, 0.2), st.floats(0, 0.3), st.floats(-1, 1))
def test_formula(k1: float, k2: float, cos_k3: float) -> None:
    m = HandScore()
    a, b = k1 / (8 * CELL), k2 / (8 * CELL)

    def s(x: float) -> float:
        return max(x, 0.0) / (1.0 + max(x, 0.0))

    face = (m.face if cos_k3 > 0 else m.lean) * cos_k3
    value = m.flat + m.peak * s(a - m.dead) - m.hole * s(-a - m.dead) + m.rough * s(b - abs(a) - m.dead) + face
    assert one(k1, k2, cos_k3) == pytest.approx(min(max(value, 0.0), 1.0), abs=2e-6)


def test_the_papers_order() -> None:
    x = np.tile(np.arange(-2, 3), (5, 1))
    flat, slope = np.zeros((5, 5)), 0.3 * CELL * x
    peak, hole = np.zeros((5, 5)), np.zeros((5, 5))
    peak[2, 2], hole[2, 2] = 0.01, -0.01
    ridge, groove = 0.01 * (x == 0), -0.01 * (x == 0)
    edge_behind, edge_ahead, wall_behind = -0.01 * (x < 0), -0.01 * (x > 0), 0.01 * (x < 0)  # walking along +x
    assert centre(flat) == pytest.approx(HandScore().flat)
    assert max(centre(hole), centre(groove), centre(wall_behind)) < centre(flat)
    assert centre(flat) < centre(slope) < centre(edge_behind) < centre(peak)
    assert centre(flat) < centre(edge_ahead) < centre(edge_behind)
    assert centre(flat) < centre(ridge) < centre(peak)
    assert centre(flat) < centre(-slope) < centre(slope)  # as in walks, other than under a single foot


def test_same_shape_same_score_in_any_cell() -> None:
    assert one(0.02, 0.03, 0.1, cell=0.005) == pytest.approx(one(0.04, 0.06, 0.1, cell=0.010))


@pytest.mark.parametrize("where", range(3))
def test_unknown_stays_unknown(where: int) -> None:
    values = [0.0, 0.0, 0.0]
    values[where] = float("nan")
    if where == 0:
        values[1] = float("nan")  # K1 and K2 are unknown together
    assert np.isnan(one(*values))


@pytest.mark.parametrize("name", [field.name for field in fields(HandScore)])
@pytest.mark.parametrize("value", [-0.1, float("nan"), 11.0])
def test_weights_out_of_range_are_refused(name: str, value: float) -> None:
    with pytest.raises(ValueError, match=name):
        HandScore(**{name: value})


def test_weights_count() -> None:
    assert one(0.0, 0.0, 0.0, HandScore(flat=0.2)) == pytest.approx(0.2)
