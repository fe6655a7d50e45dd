"""Swing paths: ends, continuity, clearance over any swept ground, slow touch-down."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from surefoot.geometry.heightmap import HeightMap
from surefoot.services.walker.legged import swing

SHAPE = swing.SwingShape()
heights = st.floats(-0.08, 0.08)
grounds = st.lists(st.floats(-0.08, 0.08), min_size=swing.SAMPLES, max_size=swing.SAMPLES)


def plan(p0, p1, ground, clearance=0.03, margin=0.006):
    top = swing.top_of(p0, p1, ground, clearance)
    return top, *swing.window(SHAPE, p0, p1, top, ground, margin)


def path(p0, p1, top, go, arrive, n=1001):
    return np.array([swing.point(SHAPE, p0, p1, top, go, arrive, v) for v in np.linspace(0.0, 1.0, n)])


@given(z0=heights, z1=heights, ground=grounds, dx=st.floats(-0.1, 0.1), dy=st.floats(-0.1, 0.1))
def test_begins_and_ends_on_the_footholds_and_never_jumps(z0, z1, ground, dx, dy):
    p0, p1 = np.array([0.1, -0.2, z0]), np.array([0.1 + dx, -0.2 + dy, z1])
    top, go, arrive = plan(p0, p1, np.array(ground))
    points = path(p0, p1, top, go, arrive)
    assert (points[0], points[-1]) == (pytest.approx(p0, abs=1e-12), pytest.approx(p1, abs=1e-12))
    way = top - min(z0, z1) + np.hypot(dx, dy)
    assert np.abs(np.diff(points, axis=0)).max() < 0.02 * way + 1e-4  # in a thousandth of the time


@given(z0=heights, z1=heights, ground=grounds)
def test_clears_the_swept_ground_away_from_the_ends(z0, z1, ground):
    ground = np.array(ground)
    ground[0], ground[-1] = min(ground[0], z0), min(ground[-1], z1)  # the foot stands on, not in, the ground
    p0, p1 = np.array([0.0, 0.0, z0]), np.array([0.05, 0.0, z1])
    top, go, arrive = plan(p0, p1, ground)
    points = path(p0, p1, top, go, arrive)
    at = points[:, 0] / 0.05 * (swing.SAMPLES - 1)
    low = ground[np.minimum(at.astype(int), swing.SAMPLES - 2)]
    middle = (at > 0.3 * swing.SAMPLES) & (at < 0.7 * swing.SAMPLES)
    assert (points[middle, 2] >= low[middle]).all()
    assert top >= max(z0, z1, ground.max()) + 0.03 - 1e-12


def test_a_cliff_beside_the_foot_is_climbed_upright():
    ground = np.full(swing.SAMPLES, 0.04)
    ground[0] = 0.0
    p0, p1 = np.zeros(3), np.array([0.05, 0.0, 0.04])
    _, go, arrive = plan(p0, p1, ground)
    _, flat_go, flat_arrive = plan(p0, p1, np.zeros(swing.SAMPLES))
    assert (go, arrive) != (flat_go, flat_arrive)
    assert go > flat_go


def test_last_part_is_slow_straight_and_goes_on_below_the_landing():
    v = np.linspace(SHAPE.fall_end, 1.2, 50)
    z = np.array([swing.height(SHAPE, 0.0, 0.04, 0.01, x) for x in v])
    speed = np.diff(z) / np.diff(v)
    assert speed == pytest.approx(-SHAPE.approach / (1.0 - SHAPE.fall_end), rel=1e-9)
    assert swing.height(SHAPE, 0.0, 0.04, 0.01, 1.0) == pytest.approx(0.01)


@given(top=st.floats(0.02, 0.1), z1=st.floats(-0.05, 0.01))
def test_the_fall_never_rises(top, z1):
    z = [swing.height(SHAPE, 0.0, top, z1, v) for v in np.linspace(SHAPE.fall_start, 1.0, 200)]
    assert np.diff(z).max() <= 1e-12


def test_swept_ground_sees_a_wall_across_the_path_and_leaves_holes_out():
    z = np.zeros((81, 81), dtype=np.float32)
    z[:, 45] = 0.03  # a wall at x = 0.225
    z[35:46, 20:24] = np.nan
    centres = HeightMap(z=z, cell=0.005, origin=(0.0, 0.0))
    ground = swing.swept_ground(centres, np.array([0.2, 0.2, 0.0]), np.array([0.25, 0.2, 0.0]), 0.012)
    assert np.nanmax(ground) == pytest.approx(0.03)
    beside = swing.swept_ground(centres, np.array([0.3, 0.2, 0.0]), np.array([0.35, 0.2, 0.0]), 0.012)
    assert np.nanmax(beside) == pytest.approx(0.0, abs=1e-9)
    hole = swing.swept_ground(centres, np.array([0.105, 0.2, 0.0]), np.array([0.112, 0.2, 0.0]), 0.0)
    assert np.isnan(hole).all()


def test_standing_feet_approach_their_foothold_by_at_most_the_reach():
    n, zeros = 3, np.zeros((3, 3))
    swinging, landed = np.array([False, True, True]), np.array([True, True, False])
    feet_to = np.full((n, 3), 0.01)
    paths = swing.SwingPaths(SHAPE, swinging, zeros, feet_to, np.full(n, 0.05), np.full(n, 0.1), np.full(n, 0.6))
    out, share = swing.targets(paths, landed, 0.4, zeros, 0.002, np.array([0.5, 0.95, 0.05]), 0.1)
    assert (out[:2], out[2, 2]) == (pytest.approx(np.full((2, 3), 0.002)), pytest.approx(0.05))
    assert share == pytest.approx([0.6, 1.0, 0.0])  # grows on the ground, shrinks in the air, within 0 and 1
