"""Properties of the choice."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from surefoot.robot.description import Robot
from surefoot.robot.kinematics import foot_positions
from surefoot.services.footholds.features import Features, Layer, window_features
from surefoot.services.footholds.footing import average_landings
from surefoot.services.footholds.ground import FootholdGround, build_ground
from surefoot.services.footholds.masks import REASONS, Limits, mask_window
from surefoot.services.footholds.models.protocol import UNLEARNED
from surefoot.services.footholds.models.score import HandScore
from surefoot.services.footholds.select import (
    Foothold,
    Landing,
    SelectParams,
    TrunkPose,
    WindowCosts,
    best_cell,
    landing_weights,
    placement,
    select,
)
from tests.services.footholds.grounds import CELL, STROKE, flat, ground_of, landing, neutral, ragno, rough, standing
from tests.surefoot.robot.test_legs import changed, skewed

NAN = float("nan")
MODEL = HandScore()
RADIUS = 0.008


def ask(
    ground: FootholdGround, base: TrunkPose, *landings: Landing, params: SelectParams | None = None
) -> tuple[Foothold, ...]:
    return select(ground, ragno(), MODEL, base, landings, params or SelectParams())


def test_flat_ground_picks_the_nominal_footholds() -> None:
    legs = [landing(leg, 0.013, 0.007) for leg in range(6)]
    for found, asked in zip(ask(ground_of(flat()), standing(0.013, 0.007), *legs), legs, strict=True):
        assert found.status == "ok"
        assert found.foothold == pytest.approx((asked.nominal[0], asked.nominal[1], RADIUS), abs=1e-7)
        assert found.contact == pytest.approx((asked.nominal[0], asked.nominal[1], 0.0), abs=1e-7)
        assert found.normal == pytest.approx((0.0, 0.0, 1.0), abs=1e-9)
        assert (found.slip, found.trunk_shift, found.reason) == (pytest.approx(MODEL.flat), 0.0, "")
        assert found.counts[-1] > 100


@settings(max_examples=40)
@given(st.integers(0, 30), st.integers(0, 5), st.integers(-9, 9), st.integers(-9, 9), st.integers(-8, 8))
def test_moving_everything_moves_the_foothold(seed: int, leg: int, cols: int, rows: int, up: int) -> None:
    dx, dy, dz = cols * CELL, rows * CELL, up / 64.0
    z = rough(seed)
    here = ask(ground_of(z), standing(), landing(leg))[0]
    moved_ground = ground_of(z + dz, origin=(-0.5 + dx, -0.4 + dy))
    there = ask(moved_ground, standing(dx, dy, dz), landing(leg, dx, dy))[0]
    assert (there.status, there.counts) == (here.status, here.counts)
    if here.foothold is None or there.foothold is None:
        return
    assert np.subtract(there.foothold, here.foothold) == pytest.approx((dx, dy, dz), abs=1e-6)
    assert there.normal == pytest.approx(here.normal, abs=1e-5)
    assert there.score == pytest.approx(here.score, abs=1e-4)


@settings(max_examples=60)
@given(st.integers(0, 10_000), st.integers(0, 5), st.booleans(), st.floats(-0.03, 0.03))
def test_never_picks_a_masked_cell(seed: int, leg: int, robust: bool, height: float) -> None:
    rng = np.random.default_rng(seed)
    z = rough(seed, 0.02)
    z[rng.random(z.shape) < 0.01] = np.nan
    ground = ground_of(z)
    base = standing(ground=0.01 + height)
    asked = landing(leg)
    params = SelectParams(robust=robust)
    found = ask(ground, base, asked, params=params)[0]
    assert found.status in ("ok", "raise_trunk", "infeasible")
    if found.foothold is None:
        assert found.status == "infeasible"
        assert found.reason
        return
    assert (found.trunk_shift == 0.0) == (found.status == "ok")
    x, y = found.foothold[:2]
    raised = replace(base, position=(*base.position[:2], base.position[2] + found.trunk_shift))
    placed = placement(ragno(), leg, raised, STROKE)
    row, col = ground.surface.index(x, y)
    cell = window_features(ground.surface.z, row, col, 1, 1, np.array(STROKE), CELL)
    slip = MODEL.predict(cell, CELL)
    assert mask_window(ground, row, col, slip, params.limits, placed)[0, 0] == 0
    assert found.slip == pytest.approx(float(slip[0, 0]))
    assert max(abs(x - asked.nominal[0]), abs(y - asked.nominal[1])) <= 8 * CELL
    assert found.foothold[2] == pytest.approx(ground.centres.height_at(x, y))
    assert found.normal is not None
    assert math.hypot(*found.normal) == pytest.approx(1.0)
    assert math.dist(found.contact or (), found.foothold) == pytest.approx(RADIUS)


class PlaneScore(HandScore):
    """The score over coefficients of planes, which are known beside unknown cells."""

    relief = True


def test_beside_unknown_cells_contact_and_normal_are_numbers() -> None:
    beside = 0
    for seed in range(4):
        z = rough(seed, 0.004)
        z[np.random.default_rng(seed).random(z.shape) < 0.1] = np.nan
        ground = ground_of(z)
        for found in select(ground, ragno(), PlaneScore(), standing(), [landing(leg) for leg in range(6)]):
            assert found.foothold is not None
            row, col = ground.surface.index(*found.foothold[:2])
            beside += bool(np.isnan(ground.surface.z[row - 1 : row + 2, col - 1 : col + 2]).any())
            assert math.hypot(*(found.normal or ())) == pytest.approx(1.0)
            assert math.dist(found.contact or (), found.foothold) == pytest.approx(RADIUS)
    assert beside > 4


def quadruped(edit=lambda data: None) -> tuple[Robot, np.ndarray, TrunkPose]:
    """A quadruped with a changed description, its neutral feet (L, 3) m and its base over flat ground."""
    robot = changed(edit)
    feet = foot_positions(robot.model, robot.neutral)
    return robot, feet, TrunkPose((0.0, 0.0, robot.foot_radius - float(feet[0, 2])))


def test_legs_of_a_quadruped_stand_beside_a_hole_within_their_reach() -> None:
    robot, feet, base = quadruped()
    z = flat()
    row, col = round((feet[0, 1] + 0.4) / CELL), round((feet[0, 0] + 0.5) / CELL)
    z[row - 2 : row + 3, col - 2 : col + 3] = -0.03
    legs = [Landing(leg, (float(x), float(y), 0.0), STROKE) for leg, (x, y) in enumerate(feet[:, :2])]
    found = select(build_ground(ground_of(z).surface, robot.foot_radius, False), robot, MODEL, base, legs)
    assert [each.status for each in found] == ["ok"] * 4
    places = [each.foothold or (np.inf, np.inf, np.inf) for each in found]
    away = [math.dist(place[:2], leg.nominal[:2]) for place, leg in zip(places, legs, strict=True)]
    assert away[1:] == pytest.approx([0.0] * 3, abs=1e-9)
    assert 0.02 < away[0] < 0.05
    far = replace(base, position=(0.0, 0.0, 0.6))
    out_of_reach = select(build_ground(ground_of(flat()).surface, robot.foot_radius, False), robot, MODEL, far, legs)
    assert {each.status for each in out_of_reach} == {"infeasible"}


def test_legs_of_another_kind_are_offered_ground_without_regard_to_reach() -> None:
    robot, feet, base = quadruped(skewed)
    ground = build_ground(ground_of(flat()).surface, robot.foot_radius, False)
    found = select(ground, robot, MODEL, base, [Landing(0, (float(feet[0, 0]), float(feet[0, 1]), 0.0), STROKE)])[0]
    assert found.status == "ok"


def distances(sx: float, sy: float) -> np.ndarray:
    """K4 of a window of 15 x 15 cells whose first cell lies at (sx, sy) from the nominal foothold."""
    steps = CELL * np.arange(15)
    return np.hypot(sx + steps[None, :], sy + steps[:, None]).astype(np.float32)


def reference(mask: np.ndarray, slip: np.ndarray, sx: float, sy: float, weight: float, robust: bool) -> int:
    """The choice in plain loops."""
    n, best = mask.shape[0], []
    q = {(i, j): slip[i, j] + weight * math.hypot(sx + j * CELL, sy + i * CELL) for i in range(n) for j in range(n)}
    for i in range(n):
        for j in range(n):
            if mask[i, j]:
                continue
            block = [(i + a, j + b) for a in (-1, 0, 1) for b in (-1, 0, 1)] if robust else [(i, j)]
            values = [q[cell] for cell in block if cell in q and not mask[cell]]
            best.append((round(sum(values) / len(values), 8), math.hypot(sx + j * CELL, sy + i * CELL), i * n + j))
    return min(best)[2] if best else -1


@given(st.integers(0, 10_000), st.booleans(), st.floats(0.0, 1.0))
def test_choice_equals_plain_loops(seed: int, robust: bool, share: float) -> None:
    rng = np.random.default_rng(seed)
    mask = (rng.random((15, 15)) < share).astype(np.uint8)
    slip = rng.uniform(0.0, 0.5, (15, 15)).astype(np.float32)
    sx, sy = rng.uniform(-8 * CELL, -6 * CELL, 2)
    got = best_cell(mask, WindowCosts(slip, slip, distances(sx, sy), 8.0, robust))
    assert got == reference(mask, slip, sx, sy, 8.0, robust)


def test_equal_cells_go_to_the_nearer_then_to_the_first() -> None:
    slip, mask = np.zeros((15, 15), dtype=np.float32), np.zeros((15, 15), dtype=np.uint8)
    costs = WindowCosts(slip, slip, distances(-7 * CELL, -7 * CELL), 0.0, False)
    assert best_cell(mask, costs) == 7 * 15 + 7  # K4, though k = 0
    mask[7, 7] = 1
    assert best_cell(mask, costs) == 6 * 15 + 7
    assert best_cell(np.ones_like(mask), costs._replace(block=True)) == -1


@pytest.mark.parametrize(("error", "border"), [(0.0, 0), (0.002, 0), (0.003, 1), (0.005, 2), (1.0, 6)])
def test_landing_weights_are_a_gaussian_within_two_deviations(error: float, border: int) -> None:
    found = landing_weights(error, CELL)
    assert (found.shape, found[border, border]) == ((2 * border + 1,) * 2, 1.0)
    assert np.array_equal(found, found[::-1])
    assert np.array_equal(found, found.T)
    if border:
        assert found[border, border + 1] == pytest.approx(math.exp(-0.5 * (CELL / error) ** 2))


@given(st.integers(0, 10_000), st.floats(0.0, 0.9))
def test_choice_over_landings_equals_plain_loops(seed: int, share: float) -> None:
    rng = np.random.default_rng(seed)
    mask = (rng.random((15, 15)) < share).astype(np.uint8)
    around = rng.uniform(0.0, 1.4, (19, 19)).astype(np.float32)
    for value in (np.nan, UNLEARNED):
        around[rng.random(around.shape) < 0.1] = value
    slip = np.ascontiguousarray(around[2:-2, 2:-2])
    mask[~(slip >= 0.0)] = 4
    sx, sy = rng.uniform(-8 * CELL, -6 * CELL, 2)
    blur = landing_weights(0.005, CELL)
    means = np.full(slip.shape, np.nan)
    for i, j in np.argwhere(mask == 0):
        part = around[i : i + 5, j : j + 5].astype(np.float64)
        known = part >= 0.0
        means[i, j] = (blur * np.minimum(part, 1.0))[known].sum() / blur[known].sum()
    mean = np.empty_like(slip)
    average_landings(around, blur, mean)
    np.testing.assert_allclose(mean[mask == 0], means[mask == 0], rtol=1e-6)
    got = best_cell(mask, WindowCosts(slip, mean, distances(sx, sy), 2.0, False))
    assert got == reference(mask, mean, sx, sy, 2.0, False)


def test_random_cells_are_free_seeded_and_different_for_each_leg() -> None:
    ground, legs = ground_of(rough(3)), [landing(leg) for leg in range(6)]
    drawn = [ask(ground, standing(), *legs, params=SelectParams(seed=seed)) for seed in (1, 1, 2)]
    assert [f.foothold for f in drawn[0]] == [f.foothold for f in drawn[1]]
    assert [f.foothold for f in drawn[0]] != [f.foothold for f in drawn[2]]
    offsets = {
        (round(f.foothold[0] - asked.nominal[0], 4), round(f.foothold[1] - asked.nominal[1], 4))
        for f, asked in zip(drawn[0], legs, strict=True)
        if f.foothold is not None
    }
    assert len(offsets) > 3
    alone = ask(ground, standing(), legs[3], params=SelectParams(seed=1))[0]
    assert alone.foothold == drawn[0][3].foothold


class Refuses(HandScore):
    """A model that predicts the same slip for every cell."""

    value = UNLEARNED

    def predict(self, features: Features, cell: float) -> Layer:
        return np.where(np.isnan(features.k1), np.float32(NAN), np.float32(self.value)).astype(np.float32)


@pytest.mark.parametrize("value", [UNLEARNED, 0.9])
def test_random_cells_ignore_the_model_but_no_other_reason(value: float) -> None:
    ground, asked, base = ground_of(rough(5)), landing(2), standing()
    model = Refuses()
    object.__setattr__(model, "value", value)
    assert select(ground, ragno(), model, base, [asked], SelectParams())[0].status == "infeasible"
    placed = placement(ragno(), asked.leg, base, asked.stroke)
    cells = set()
    for seed in range(40):
        found = select(ground, ragno(), model, base, [asked], SelectParams(seed=seed))[0]
        assert found.status == "ok"
        row, col = ground.surface.index(*found.foothold[:2])
        bits = mask_window(ground, row, col, np.zeros((1, 1), dtype=np.float32), Limits(), placed)[0, 0]
        assert bits == 0
        cells.add((row, col))
    assert len(cells) > 25
    wall = flat()
    wall[:, :] = np.nan
    assert select(ground_of(wall), ragno(), model, base, [asked], SelectParams(seed=1))[0].status == "infeasible"


def test_avoids_a_peak_and_an_edge() -> None:
    asked = landing(0)
    x, y = asked.nominal[:2]
    ground = ground_of(flat())
    row, col = ground.surface.index(x, y)
    peak = flat()
    peak[row, col] = 0.012
    found = ask(ground_of(peak), standing(), asked)[0]
    assert math.dist(found.foothold[:2], (x, y)) > 1.4 * CELL
    assert found.normal == pytest.approx((0.0, 0.0, 1.0), abs=1e-6)
    edge = flat()
    edge[:, : col + 1] = 0.02  # the nominal cell is the last before the ground drops
    found = ask(ground_of(edge), standing(ground=0.01), asked)[0]
    assert abs(found.foothold[0] - x) > 1.4 * CELL


def test_robust_choice_shuns_a_lone_good_cell() -> None:
    class Painted(HandScore):
        name = "painted"  # type: ignore[assignment]

        def predict(self, features: Features, cell: float) -> np.ndarray:
            p = np.full(features.k1.shape, 0.1, dtype=np.float32)
            p[3, 3] = 0.0
            p[2:5, 2:5][p[2:5, 2:5] > 0] = 0.35
            return p

    params = SelectParams(distance_weight=1.0)
    ground, base, asked = ground_of(flat()), standing(), landing(4)
    single = select(ground, ragno(), Painted(), base, [asked], replace(params, robust=False))[0]
    robust = select(ground, ragno(), Painted(), base, [asked], params)[0]
    assert (single.slip, robust.slip) == (0.0, pytest.approx(0.1))


def test_trunk_too_high_is_lowered_and_too_low_is_raised() -> None:
    for height, sign in ((0.185, -1), (0.0, 1)):
        base = TrunkPose((0.0, 0.0, height))
        found = ask(ground_of(flat()), base, landing(0), params=SelectParams(limits=Limits(reach_margin=0.02)))[0]
        assert found.status == "raise_trunk", (height, found)
        assert math.copysign(1, found.trunk_shift) == sign
        assert found.foothold is not None
        assert "trunk" in found.reason
        moved = TrunkPose((0.0, 0.0, height + found.trunk_shift))
        again = ask(ground_of(flat()), moved, landing(0), params=SelectParams(limits=Limits(reach_margin=0.02)))[0]
        assert (again.status, again.foothold) == ("ok", pytest.approx(found.foothold))


@pytest.mark.parametrize(
    ("base", "asked", "word"),
    [
        (TrunkPose((0.0, 0.0, 1.0)), landing(0), "reach"),
        (TrunkPose((NAN, 0.0, 0.1)), landing(0), "finite"),
        (TrunkPose((0.0, 0.0, 0.1), (0.0, 0.0, 0.0, 0.0)), landing(0), "quaternion"),
        (TrunkPose((0.0, 0.0, 0.1), (1e300, 1e300, 0.0, 0.0)), landing(0), "quaternion"),
        (standing(), Landing(0, (NAN, 0.0, 0.0), STROKE), "finite"),
        (standing(), Landing(0, (1e30, 0.0, 0.0), STROKE), "outside"),
        (standing(), Landing(0, (5.0, 5.0, 0.0), STROKE), "unknown"),
        (standing(), Landing(0, (0.18, 0.12, 0.0), (math.inf, 0.0, 0.0)), "finite"),
    ],
)
def test_what_cannot_be_is_typed(base: TrunkPose, asked: Landing, word: str) -> None:
    found = ask(ground_of(flat()), base, asked)[0]
    assert found.status == "infeasible"
    assert word in found.reason
    assert found.foothold is None


def test_unknown_map_and_tiny_maps() -> None:
    for z in (np.full((160, 200), np.nan), np.zeros((1, 1)), np.zeros((2, 3))):
        assert ask(ground_of(z), standing(), landing(0))[0].status == "infeasible"


def test_a_zero_stroke_and_an_unused_nominal_height_are_fine() -> None:
    asked = Landing(0, (*landing(0).nominal[:2], NAN), (0.0, 0.0, 0.0))
    assert ask(ground_of(flat()), standing(), asked)[0].status == "ok"


def test_window_at_the_border_of_the_map() -> None:
    x, y = landing(0).nominal[:2]
    ground = ground_of(np.zeros((100, 100)), origin=(x - 0.01, y - 0.01))
    found = ask(ground, standing(), landing(0))[0]
    assert (found.status, found.counts[REASONS.index("unknown")]) == ("ok", 225 - 9 * 9)


def test_legs_are_answered_in_order() -> None:
    found = ask(ground_of(rough(1, 0.002)), standing(), landing(5), landing(0))
    assert [np.sign(one.foothold[1]) for one in found if one.foothold] == [-1, 1]
    assert abs(found[0].foothold[0] - neutral(5)[0]) < 0.04  # type: ignore[index]
