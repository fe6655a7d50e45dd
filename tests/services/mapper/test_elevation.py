"""The map itself: known ground is recovered as surely as stated, drift makes it less sure, what is unseen stays so."""

import numpy as np
import pytest

from surefoot.geometry.rotations import matrix_from_rpy
from surefoot.services.mapper.mapper import MapParams, Mapper, MapPose
from tests.services.mapper.scenes import TICK_NS, Slope, Stair, centres, picture, pose

PARAMS = MapParams(cell=0.01, cells=121)


def looked(ground, images=12, sigma=0.004, seed=0, drop=0.0, params=PARAMS):
    """A map of images that a robot takes while it walks ahead by 2 mm an image, with exact odometry."""
    rng, mapper = np.random.default_rng(seed), Mapper(params)
    for k in range(images):
        mapper.moved(pose(0.002 * k, tick=k))
        mapper.look(picture(ground, 0.002 * k, tick=k, sigma=sigma, rng=rng, drop=drop), k * 10_000_000)
    return mapper


@pytest.mark.parametrize("ground", [Slope(), Slope(0.02, 0.2, -0.1), Slope(-0.01, -0.3, 0.2)])
def test_a_plane_is_recovered_as_surely_as_the_map_states(ground):
    off, variance = [], []
    for seed in range(6):
        mapper = looked(ground, seed=seed)
        heights, v = mapper.heights()
        known = np.isfinite(heights)
        assert known.sum() > 1000
        off.append((heights - ground.height(*centres(mapper)))[known])
        variance.append(v[known])
    nees = np.concatenate(off) ** 2 / np.concatenate(variance)
    assert 0.4 < nees.mean() < 1.3
    assert np.mean(nees < 4.0) > 0.9
    assert np.sqrt(np.mean(np.concatenate(off) ** 2)) < 0.003


def test_a_step_stays_sharp():
    mapper = looked(Stair(0.45, 0.04), images=30)
    heights, v = mapper.heights()
    x, _ = centres(mapper)
    low, high = np.isfinite(heights) & (x < 0.435), np.isfinite(heights) & (x > 0.465)
    assert np.abs(np.median(heights[low])) < 1e-3
    assert abs(np.median(heights[high]) - 0.04) < 1e-3
    edge = np.isfinite(heights) & (np.abs(x - 0.45) < 0.006)
    assert np.median(v[edge]) > 2.0 * np.median(v[low])  # a cell that holds both heights is less sure


def test_more_images_make_a_cell_surer_and_one_image_never_less_sure_than_its_noise():
    few, many = looked(Slope(), images=2), looked(Slope(), images=20)
    (_, v_few), (_, v_many) = few.heights(), many.heights()
    assert np.nanmedian(v_many) < 0.5 * np.nanmedian(v_few)
    assert np.nanmax(v_few) < 0.02**2


def test_drift_adds_to_the_variance_of_what_was_seen_before_and_not_of_what_is_seen_now():
    mapper = looked(Slope())
    _, before = mapper.heights()
    growth = 0.005**2
    mapper.moved(pose(0.022, tick=12, variance=(0, 0, growth, 0, 0, 0)))
    _, later = mapper.heights()
    assert np.nanmax(np.abs(later - before - growth)) < 1e-12
    mapper.moved(pose(0.022, tick=13, variance=(0, 0, 0.5 * growth, 0, 0, 0)))  # surer: what is gone is not undone
    _, still = mapper.heights()
    assert np.nanmax(np.abs(still - later)) < 1e-12
    mapper.look(picture(Slope(), 0.022, tick=13, sigma=0.004), 130_000_000)
    _, again = mapper.heights()
    assert np.nanmin(again - before) < 0.0
    assert np.nanmax(again) <= np.nanmax(later)


def test_drift_along_the_ground_counts_on_slopes_only():
    flat, steep = looked(Slope(), sigma=5e-4), looked(Slope(0.0, 0.5), sigma=5e-4)
    for mapper, least, most in ((flat, 0.0, 1e-5), (steep, 2e-5, 4e-5)):
        _, before = mapper.heights()
        mapper.moved(pose(0.022, tick=12, variance=(1e-4, 1e-4, 0, 0, 0, 0)))
        _, after = mapper.heights()
        assert least <= np.nanmedian(after - before) <= most  # 1e-4 slope^2, a usual slope beside unseen cells


def test_with_a_height_that_drifts_cells_are_as_sure_as_stated():
    step, nees = 0.001, []
    for seed in range(8):
        rng, mapper, wrong = np.random.default_rng(seed), Mapper(PARAMS), 0.0
        for k in range(40):
            wrong += step * rng.standard_normal()
            mapper.moved(pose(0.004 * k, 0.1 + wrong, k, (0, 0, (k + 1) * step**2, 0, 0, 0)))
            mapper.look(picture(Slope(), 0.004 * k, 0.1, k, 0.003, rng), k * 10_000_000)
        heights, v = mapper.heights()
        known = np.isfinite(heights)
        nees.append(np.mean((heights[known] - wrong) ** 2 / v[known]))
    assert 0.5 < np.mean(nees) < 1.5


def test_what_no_pixel_showed_stays_unknown():
    mapper = looked(Slope(), drop=0.3)
    heights, v = mapper.heights()
    x, _ = centres(mapper)
    assert np.isnan(heights[x < 0.0]).all()  # behind the camera
    assert (np.isnan(heights) == np.isnan(v)).all()


def test_a_map_moves_along_and_forgets_what_lies_behind():
    mapper = looked(Slope(0.0, 0.1))
    heights, _ = mapper.heights()
    known = {}
    for place in zip(*(c[np.isfinite(heights)].round(6) for c in (*centres(mapper), heights)), strict=True):
        known[place[:2]] = place[2]
    mapper.moved(pose(0.082, tick=20))
    mapper.begin(np.array([[0.1, 0.0, 0.0], [-0.1, 0.1, 0.0], [-0.1, -0.1, 0.0]]))
    moved, _ = mapper.heights()
    x, y = centres(mapper)
    assert x[0, 0] == pytest.approx(0.08 - 0.6)
    same = [known.get((round(a, 6), round(b, 6))) for a, b in zip(x.ravel(), y.ravel(), strict=True)]
    kept = np.array([np.nan if one is None else one for one in same]).reshape(x.shape)
    assert np.isfinite(kept).sum() > 1000
    assert np.nanmax(np.abs(moved - kept)) < 1e-5


def test_ground_that_has_moved_begins_anew():
    mapper = looked(Slope(), images=30)
    before, _ = (layer.copy() for layer in mapper.heights())
    mapper.moved(pose(0.06, tick=30))
    mapper.look(picture(Stair(0.52, 0.04), 0.06, tick=30, sigma=0.004), 30 * 10_000_000)
    heights, _ = mapper.heights()
    x, _ = centres(mapper)
    rows = np.s_[:, : -round(0.06 / 0.01)], np.s_[:, round(0.06 / 0.01) :]
    then, now, x = before[rows[1]], heights[rows[0]], x[rows[0]]  # the grid has moved along by 0.06 m
    new = (x > 0.54) & (np.abs(now - then) > 0.02)
    assert new.sum() > 20
    assert np.abs(now[new] - 0.04).max() < 0.01
    assert np.nanmax(np.abs((now - then)[x < 0.5])) < 0.02


def tilted(seed, bias, images=40, step=0.004):
    """A map under odometry that is tilted by a constant pitch, and the robot's true height above level ground.

    The odometry loses height by the tilt on its way; its covariance shows it.
    """
    rng, mapper = np.random.default_rng(seed), Mapper(PARAMS)
    pitch = bias * rng.standard_normal()
    turn = matrix_from_rpy(0.0, pitch, 0.0)
    for k in range(images):
        way = step * k
        covariance = np.zeros((6, 6))
        covariance[3, 3] = covariance[4, 4] = bias**2
        covariance[2, 2], covariance[2, 4] = (bias * way) ** 2, -(bias**2) * way
        covariance[4, 2] = covariance[2, 4]
        place = turn @ np.array([way, 0.0, 0.1])
        mapper.moved(MapPose(k * TICK_NS, place, turn, covariance))
        mapper.look(picture(Slope(), way, 0.1, k, 0.002, rng), k * TICK_NS)
    return mapper, pitch, place


def test_a_constant_tilt_counts_by_the_way_to_the_cell_now_not_by_the_way_walked():
    nees, stated = [], []
    for seed in range(40):
        mapper, _, place = tilted(seed, 0.02)
        heights, v = mapper.heights()
        x, y = centres(mapper)
        known = np.isfinite(heights) & (np.hypot(x - place[0], y - place[1]) < 0.35)
        off = (heights - place[2] + 0.1)[known]  # relative to the robot, which stands 0.1 m above the ground
        nees.append(np.mean(off**2 / v[known]))
        stated.append(np.sqrt(np.mean(v[known])))
    assert 0.5 < np.mean(nees) < 1.5
    assert np.mean(stated) < 0.02 * 0.35


def test_variances_that_a_rotation_explains_are_no_drift():
    mapper = looked(Slope())
    _, before = mapper.heights()
    covariance = np.zeros((6, 6))
    covariance[3, 3] = covariance[4, 4] = covariance[2, 2] = 1e-6
    covariance[2, 4] = -1e-6  # z is wrong by the pitch alone
    covariance[4, 2] = covariance[2, 4]
    mapper.moved(pose(0.022, tick=12)._replace(covariance=covariance))
    _, after = mapper.heights()
    x, y = centres(mapper)
    assert np.nanmax(np.abs(after - before - 1e-6 * ((x - 0.022) ** 2 + y**2))) < 1e-6 * 0.01


def test_play_of_the_variances_is_no_drift_and_the_way_up_after_a_fix_is():
    def drifted(variances):
        mapper = Mapper(PARAMS)
        for k, variance in enumerate(variances):
            mapper.moved(pose(tick=k, variance=(0, 0, variance, 0, 0, 0)))
        return mapper._drift.z

    assert drifted([1.0, 2.0, 1.95, 2.0, 1.95, 2.0]) == pytest.approx(1.0)
    assert drifted([1.0, 2.0, 0.5, 2.0]) == pytest.approx(2.5)


def test_the_ground_at_the_start_is_the_plane_under_the_feet():
    mapper = Mapper(PARAMS)
    mapper.moved(pose())
    feet = np.array([[0.1, 0.1, 0.02], [0.1, -0.1, 0.02], [-0.1, 0.1, 0.0], [-0.1, -0.1, 0.0]])
    mapper.begin(feet)
    heights, v = mapper.heights()
    x, y = centres(mapper)
    near = (np.abs(x) < 0.17) & (np.abs(y) < 0.17)
    assert np.abs(heights[near] - (0.01 + 0.1 * x[near])).max() < 1e-9
    assert np.isnan(heights[np.abs(x) > 0.19]).all()
    assert v[near] == pytest.approx(PARAMS.start_deviation**2)


def test_equal_images_give_equal_bits():
    first, second = (looked(Slope(0.0, 0.1), seed=3, drop=0.1) for _ in range(2))
    for one, other in zip(first.heights(), second.heights(), strict=True):
        assert one.tobytes() == other.tobytes()
