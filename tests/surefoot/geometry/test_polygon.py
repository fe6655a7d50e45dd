"""Convex polygons against brute force."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial import ConvexHull

from surefoot.geometry.polygon import area, clip, half_planes, hull, ray, signed_distance

SQUARE = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
seeds = st.integers(0, 10_000)
FEW = settings(max_examples=40)


def cloud(seed: int) -> np.ndarray:
    rng = np.random.default_rng(seed)
    return rng.normal(size=(int(rng.integers(3, 40)), 2)) * rng.uniform(0.01, 10.0)


@FEW
@given(seeds)
def test_hull_is_convex_counter_clockwise_and_holds_all_points(seed: int) -> None:
    points = cloud(seed)
    corners = hull(points)
    edges = np.roll(corners, -1, axis=0) - corners
    turns = edges[:, 0] * np.roll(edges, -1, axis=0)[:, 1] - edges[:, 1] * np.roll(edges, -1, axis=0)[:, 0]
    assert np.all(turns > 0.0)
    assert {tuple(c) for c in corners} <= {tuple(p) for p in points}
    assert all(signed_distance(corners, x, y) > -1e-9 for x, y in points)


def scattered(rng: np.random.Generator, noise: float) -> np.ndarray:
    """Return corners of a polygon, some of them at the same x or y, each several times, apart by a noise."""
    angle = np.sort(rng.uniform(0.0, 2.0 * math.pi, rng.integers(3, 12)))
    corners = np.round(np.column_stack((np.cos(angle), np.sin(angle))) * rng.uniform(0.05, 0.2), 1)
    points = np.repeat(corners, rng.integers(1, 5), axis=0)
    return rng.permutation(points + noise * rng.standard_normal(points.shape))


@pytest.mark.parametrize("noise", [1e-16, 1e-15, 1e-14, 1e-13, 1e-12, 1e-11, 1e-9])
def test_hull_of_points_that_differ_by_rounding_is_that_of_qhull(noise: float) -> None:
    """Corners on an upright edge are sorted by the rounding of x; none may be lost."""
    rng = np.random.default_rng(7)
    compared = 0
    while compared < 300:
        points = scattered(rng, noise)
        if np.linalg.matrix_rank(points - points[0], tol=1e-3) < 2:
            continue
        compared += 1
        assert area(hull(points)) == pytest.approx(ConvexHull(points, qhull_options="QJ").volume, rel=1e-6)


def test_hull_of_little() -> None:
    assert hull(np.empty((0, 2))).shape == (0, 2)
    np.testing.assert_array_equal(hull(np.array([[1.0, 2.0]] * 3)), [[1.0, 2.0]])
    np.testing.assert_array_equal(hull(np.array([[2.0, 2.0], [0.0, 0.0], [1.0, 1.0]])), [[0.0, 0.0], [2.0, 2.0]])
    np.testing.assert_array_equal(hull(np.array([[0.0, 1.0], [0.0, 0.0], [0.0, 0.5]])), [[0.0, 0.0], [0.0, 1.0]])


def test_hull_leaves_out_points_on_edges_and_duplicates() -> None:
    middles = 0.5 * (SQUARE + np.roll(SQUARE, -1, axis=0))
    np.testing.assert_array_equal(hull(np.concatenate((SQUARE, middles, SQUARE))), SQUARE)


def test_area_is_signed() -> None:
    assert area(SQUARE) == pytest.approx(1.0)
    assert area(SQUARE[::-1].copy()) == pytest.approx(-1.0)
    assert area(SQUARE + 1e6) == pytest.approx(1.0, abs=1e-9)
    assert area(SQUARE[:2]) == pytest.approx(0.0, abs=1e-12)


@pytest.mark.parametrize(
    ("point", "distance"),
    [
        ((0.5, 0.5), 0.5),
        ((0.9, 0.5), 0.1),
        ((1.0, 0.3), 0.0),
        ((2.0, 0.5), -1.0),
        ((4.0, 5.0), -5.0),
        ((-3.0, -4.0), -5.0),
    ],
)
def test_signed_distance_of_a_square(point: tuple[float, float], distance: float) -> None:
    assert signed_distance(SQUARE, *point) == pytest.approx(distance, abs=1e-12)


def test_signed_distance_without_inside() -> None:
    assert signed_distance(np.empty((0, 2)), 0.0, 0.0) == -math.inf
    assert signed_distance(SQUARE[:1], 3.0, 4.0) == pytest.approx(-5.0)
    assert signed_distance(SQUARE[:2], 0.5, 2.0) == pytest.approx(-2.0)
    assert signed_distance(SQUARE[:2], 0.5, 0.0) == pytest.approx(0.0, abs=1e-12)


@FEW
@given(seeds, st.floats(-3, 3), st.floats(-3, 3))
def test_signed_distance_is_the_smallest_over_all_edges_inside(seed: int, x: float, y: float) -> None:
    corners = hull(cloud(seed))
    edges = np.roll(corners, -1, axis=0) - corners
    normals = np.column_stack((edges[:, 1], -edges[:, 0])) / np.linalg.norm(edges, axis=1)[:, None]
    slack = np.einsum("ij,ij->i", normals, corners - [x, y])
    got = signed_distance(corners, x, y)
    if slack.min() >= 0.0:
        assert got == pytest.approx(slack.min(), abs=1e-9)
    else:
        assert got <= slack.min() + 1e-9  # a corner may be further away than the line through its edge


@FEW
@given(seeds, st.floats(0, 6.28), st.floats(-1, 1))
def test_clip_keeps_the_right_side(seed: int, angle: float, limit: float) -> None:
    corners, a = hull(cloud(seed)), (math.cos(angle), math.sin(angle))
    kept, rest = clip(corners, *a, limit), clip(corners, -a[0], -a[1], -limit)
    assert np.all(kept @ a <= limit + 1e-9)
    assert area(kept) + area(rest) == pytest.approx(area(corners), rel=1e-9, abs=1e-12)


def test_half_planes() -> None:
    normals = np.array([[1.0, 0.0], [0.0, 1.0], [-1.0, 0.0], [0.0, -1.0]])
    found = half_planes(normals, np.array([1.0, 1, 0, 0]), 9.0).round(9)
    np.testing.assert_allclose(sorted(map(tuple, found)), sorted(map(tuple, SQUARE)), atol=1e-9)
    assert half_planes(normals, np.array([-1.0, 1, 0, 0]), 9.0).shape == (0, 2)
    open_side = half_planes(normals[:1], np.array([0.0]), 2.0)
    assert area(open_side) == pytest.approx(8.0)


@pytest.mark.parametrize(
    ("start", "direction", "expected"),
    [
        ((0.5, 0.5), (1.0, 0.0), (-0.5, 0.5)),
        ((-1.0, 0.5), (1.0, 0.0), (1.0, 2.0)),
        ((2.0, 0.5), (1.0, 0.0), (-2.0, -1.0)),
        ((0.0, 0.0), (math.sqrt(0.5), math.sqrt(0.5)), (0.0, math.sqrt(2.0))),
        ((-1.0, 1.0), (1.0, 0.0), (1.0, 2.0)),
    ],
)
def test_ray_through_a_square(start: tuple, direction: tuple, expected: tuple) -> None:
    assert ray(SQUARE, *start, *direction) == pytest.approx(expected)


def test_ray_misses_or_meets_little() -> None:
    assert all(map(math.isnan, ray(SQUARE, 0.0, 1.1, 1.0, 0.0)))
    assert all(map(math.isnan, ray(np.empty((0, 2)), 0.0, 0.0, 1.0, 0.0)))
    assert ray(SQUARE[:2], 0.5, -1.0, 0.0, 1.0) == (1.0, 1.0)
    assert ray(SQUARE[:2], -1.0, 0.0, 1.0, 0.0) == (1.0, 2.0)
    assert ray(SQUARE[:1], 0.0, -3.0, 0.0, 1.0) == (3.0, 3.0)
