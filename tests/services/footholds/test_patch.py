"""The choice on a bare patch of heights, and the example that uses it."""

import importlib.util
import itertools
import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from surefoot.errors import SurefootError
from surefoot.geometry.heightmap import HeightMap
from surefoot.services.footholds.models.files import load, shipped
from surefoot.services.footholds.models.score import HandScore
from surefoot.services.footholds.patch import PatchFoothold, PatchStep, choose_on_patch
from surefoot.services.footholds.rectangles import largest_rectangle
from surefoot.services.footholds.relief import scale_of

RAGNO = load(shipped("ragno"))
EXAMPLE = Path(__file__).parents[3] / "examples" / "quadruped.py"


@given(st.integers(0, 10_000), st.floats(0.3, 1.0))
def test_the_largest_rectangle_by_trying_all(seed: int, share: float) -> None:
    rng = np.random.default_rng(seed)
    free = rng.random((7, 6)) < share
    row, col = int(rng.integers(7)), int(rng.integers(6))
    free[row, col] = True
    top, bottom, left, right = largest_rectangle(free, row, col)
    assert top <= row <= bottom
    assert left <= col <= right
    assert free[top : bottom + 1, left : right + 1].all()
    rows = itertools.product(range(row + 1), range(row, 7))
    areas = [
        (b - t + 1) * (r - a + 1)
        for (t, b), a, r in itertools.product(rows, range(col + 1), range(col, 6))
        if free[t : b + 1, a : r + 1].all()
    ]
    assert (bottom - top + 1) * (right - left + 1) == max(areas)


def chosen(z: np.ndarray, **more: object) -> PatchFoothold:
    step = PatchStep(more.pop("stroke", (-0.03, 0.0, 0.0)), more.pop("foot_radius", 0.008))  # type: ignore[arg-type]
    return choose_on_patch(z, 0.005, RAGNO, step, **more)  # type: ignore[arg-type]


def test_flat_ground_keeps_the_nominal_foothold_and_a_slope_is_left() -> None:
    flat = chosen(np.zeros((21, 21)))
    assert flat.foothold == pytest.approx((0.0, 0.0, 0.008))
    assert flat.slip < 0.05
    assert flat.spread > 0.0
    assert flat.rectangle == pytest.approx((-0.045, -0.045, 0.045, 0.045))
    assert flat.counts["unknown"] == 21 * 21 - 19 * 19
    x = 0.005 * (np.arange(21) - 10)
    z = np.tile(0.5 * np.clip(x, -0.02, 0.02), (21, 1))  # a slope with flat ground on both sides
    aside = chosen(z)
    assert abs(aside.foothold[0]) > 0.02
    stubborn = chosen(z, distance_weight=1000.0)
    assert abs(stubborn.foothold[0]) < 0.01
    assert aside.slip < 0.5 * stubborn.slip


def test_allowed_cells_and_no_cell_at_all() -> None:
    allowed = np.zeros((21, 21), dtype=np.bool_)
    allowed[4, 15] = True
    found = chosen(np.zeros((21, 21)), allowed=allowed)
    assert found.foothold[:2] == pytest.approx((0.025, -0.03))
    assert found.rectangle == pytest.approx((0.025, -0.03, 0.025, -0.03))
    none = chosen(np.full((21, 21), np.nan))
    assert none.foothold is None
    assert math.isnan(none.slip)
    assert none.counts["free"] == 0


@pytest.mark.parametrize(
    "wrong",
    [
        {"z": np.zeros((2, 9))}, {"z": np.zeros(9)}, {"z": np.full((5, 5), np.inf)}, {"foot_radius": 0.0},
        {"foot_radius": 0.03}, {"stroke": (math.nan, 0.0, 0.0)}, {"stroke": (1.0, 2.0)}, {"distance_weight": -1.0},
        {"allowed": np.ones((3, 3), dtype=np.bool_)}, {"smooth": False},
    ],
)  # fmt: skip
def test_what_cannot_be(wrong: dict[str, object]) -> None:
    with pytest.raises(SurefootError):
        chosen(**({"z": np.zeros((9, 9))} | wrong))  # type: ignore[arg-type]


def test_a_larger_robot_on_larger_ground_chooses_the_same() -> None:
    model, rng = RAGNO, np.random.default_rng(4)
    z = 0.004 * rng.random((21, 21))
    small = choose_on_patch(z, 0.005, model, PatchStep((-0.03, 0.0, 0.0), 0.008))
    large = choose_on_patch(4.0 * z, 0.02, model.scaled(4.0), PatchStep((-0.12, 0.0, 0.0), 0.032))
    assert small.foothold is not None
    assert large.foothold == pytest.approx([4.0 * value for value in small.foothold], abs=1e-6)
    assert large.slip == pytest.approx(small.slip, abs=1e-5)
    assert HandScore().unfit(0.02, True, 0.032) == ""


def test_the_example_finds_a_way_out_of_the_ditch(capsys: pytest.CaptureFixture[str]) -> None:
    spec = importlib.util.spec_from_file_location("quadruped", EXAMPLE)
    example = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(example)
    example.main()
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) == 8
    assert lines[0].startswith("FL: ")
    assert not lines[0].startswith("FL: +0 +0")
    assert lines[2].startswith("FR: +0 +0")


def fractal(rng: np.random.Generator, n: int) -> np.ndarray:
    """Heights (n, n) m of fractal ground with a standard deviation of 15 mm."""
    f = np.fft.fftfreq(n)
    r = np.hypot(f[:, None], f[None, :])
    r[0, 0] = math.inf
    z = np.fft.ifft2((rng.normal(size=(n, n)) + 1j * rng.normal(size=(n, n))) / r**1.8).real
    return 0.015 * z / z.std()


@pytest.mark.parametrize("kind", ["noise", "fractal", "fractal and noise"])
@pytest.mark.parametrize("n", [15, 22, 41])
def test_a_patch_that_is_turned_or_mirrored_has_the_same_foothold(kind: str, n: int) -> None:
    quarter, mirror = np.array([[0.0, -1.0], [1.0, 0.0]]), np.array([[-1.0, 0.0], [0.0, 1.0]])
    for seed in range(8):
        rng = np.random.default_rng((seed, n))
        z = fractal(rng, n) if "fractal" in kind else np.zeros((n, n))
        z = (z + rng.normal(0.0, rng.uniform(0.002, 0.006), (n, n)) * ("noise" in kind)).astype(np.float32)
        stroke, nominal, found = rng.uniform(-0.05, 0.05, 2), rng.uniform(-0.01, 0.01, 2), []
        for k, mirrored in itertools.product(range(4), (False, True)):
            axes = np.linalg.matrix_power(quarter, k) @ (mirror if mirrored else np.eye(2))
            seen = np.rot90(z[:, ::-1] if mirrored else z, -k)  # rows are y: rot90 turns from y to x
            step = PatchStep((*(axes @ stroke), 0.0), 0.008, tuple(axes @ nominal))
            at = choose_on_patch(seen, 0.005, RAGNO, step).foothold
            found.append(None if at is None else tuple((axes.T @ at[:2]).round(6) + 0.0))
        assert len(set(found)) == 1, (seed, found)


def test_the_noise_of_a_large_map_is_found_by_cells_on_both_sides_of_its_middle() -> None:
    for shape in ((200, 200), (201, 203), (300, 301)):
        z = np.random.default_rng(4).normal(0.0, 0.003, shape).astype(np.float32)
        z[:, : shape[1] // 2 - 20] *= 3.0
        scales = []
        for seen in (z, z[::-1], z[:, ::-1], np.ascontiguousarray(z.T)):
            raw = HeightMap(z=seen, cell=0.005, origin=(0.0, 0.0))
            scales.append(scale_of(raw, raw.smoothed()))
        assert scales[0] > 1
        assert len(set(scales)) == 1


@pytest.mark.parametrize("degrees", [10.0, 20.0, 30.0])
@pytest.mark.parametrize("gap", ["ahead", "behind", "aside", "drop-outs", "none"])
def test_on_an_even_slope_no_foot_goes_to_the_edge_of_what_is_known(degrees: float, gap: str) -> None:
    y, x = 0.005 * (np.mgrid[0:61, 0:61] - 30)
    z = math.tan(math.radians(degrees)) * x
    unknown = {"ahead": abs(x - 0.035) < 0.015, "behind": abs(x + 0.035) < 0.015, "aside": abs(y - 0.035) < 0.015}
    unknown |= {"drop-outs": np.random.default_rng(0).random(z.shape) < 0.02, "none": z > 1.0}
    z[unknown[gap]] = np.nan
    assert chosen(z).foothold[:2] == pytest.approx((0.0, 0.0))
