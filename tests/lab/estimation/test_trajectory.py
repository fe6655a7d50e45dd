"""Measures of trajectories, against known errors and against evo."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from surefoot.lab.estimation.trajectory import (
    Poses,
    laid_over,
    pairs_by_path,
    pairs_by_time,
    path_length,
    relative_error,
)

HZ, ROWS = 100, 1500
SECONDS = np.arange(ROWS) / HZ


def walk(seed: int, wobble: float = 0.05) -> Poses:
    """A walk of about 4 m that turns, seed by seed a little different."""
    rng = np.random.default_rng(seed)
    yaw = 0.1 * SECONDS + wobble * np.sin(SECONDS + rng.uniform(0.0, 3.0))
    step = 0.3 / HZ * np.stack([np.cos(yaw), np.sin(yaw), wobble * np.sin(3.0 * SECONDS)], axis=1)
    tilt = wobble * np.sin(np.outer(SECONDS, [5.0, 7.0]) + rng.uniform(0.0, 3.0, size=2))
    return Poses(np.cumsum(step, axis=0), Rotation.from_euler("ZYX", np.column_stack([yaw, tilt])).as_matrix())


def moved(poses: Poses, turn: float, by) -> Poses:
    rot = Rotation.from_euler("z", turn).as_matrix()
    return Poses(poses.position @ rot.T + by, rot @ poses.rot)


def test_a_place_in_the_world_is_no_error():
    true = walk(0)
    seen = moved(true, 1.2, [3.0, -2.0, 0.5])
    for pairs in (pairs_by_path(path_length(true.position, SECONDS))[1], pairs_by_time(SECONDS)):
        assert len(pairs.first) > 20
        assert np.abs(relative_error(true, seen, pairs)).max() < 1e-9
    assert np.abs(laid_over(seen.position, true.position) - true.position).max() < 1e-9


def test_a_longer_way_is_its_share():
    true = walk(0)
    length, pairs = pairs_by_path(path_length(true.position, SECONDS))
    errors = relative_error(true, Poses(1.03 * true.position, true.rot), pairs)
    assert length == 1.0
    assert np.sqrt(np.mean(np.sum(errors**2, axis=1))) == pytest.approx(0.03, rel=0.03)


def test_no_other_turn_lies_nearer():
    true, seen = walk(0).position, walk(1).position

    def off(position):
        return np.sum((position - true) ** 2)

    best = laid_over(seen, true)
    for turn in (-0.02, -0.001, 0.001, 0.02):
        c, s = np.cos(turn), np.sin(turn)
        middle = best.mean(axis=0)
        assert off((best - middle) @ np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]]) + middle) > off(best)
    for axis in np.eye(3):
        assert off(best + 1e-3 * axis) > off(best)


@pytest.mark.parametrize(("way", "length"), [(1.2, 1.0), (0.7, 0.5), (0.12, 0.1), (0.05, np.nan)])
def test_the_longest_length_that_fits_is_taken(way, length):
    found, pairs = pairs_by_path(np.linspace(0.0, way, 500))
    np.testing.assert_equal(found, length)
    assert len(pairs.first) == len(pairs.last)
    assert bool(len(pairs.first)) == bool(np.isfinite(length))


def test_scatter_of_a_camera_makes_no_way():
    rng = np.random.default_rng(0)
    true = walk(0).position
    held = np.repeat(true[::2] + 3e-3 * rng.normal(size=(ROWS // 2, 3)), 2, axis=0)
    rough = np.linalg.norm(np.diff(held, axis=0), axis=1).sum()
    exact = np.linalg.norm(np.diff(true, axis=0), axis=1).sum()
    assert rough > 1.2 * exact
    assert path_length(held, SECONDS)[-1] == pytest.approx(exact, rel=0.02)


def test_times_without_a_second_have_no_pairs():
    assert len(pairs_by_time(SECONDS[:50]).first) == 0
    assert len(pairs_by_time(SECONDS[:3]).first) == 0


def test_evo_measures_the_same():
    pytest.importorskip("evo", reason="evo is not installed: pip install evo")
    from evo.core import metrics
    from evo.core.trajectory import PoseTrajectory3D

    def of(poses: Poses) -> PoseTrajectory3D:
        quats = np.roll(Rotation.from_matrix(poses.rot).as_quat(), 1, axis=1)
        return PoseTrajectory3D(poses.position, quats, SECONDS)

    def rms(metric, true: Poses, seen: Poses) -> float:
        metric.process_data((of(true), of(seen)))
        return metric.get_statistic(metrics.StatisticsType.rmse)

    true, seen = walk(0), moved(walk(1), 0.4, [1.0, 2.0, 0.1])
    part = metrics.PoseRelation.translation_part
    pairs = pairs_by_time(SECONDS)
    ours = np.sqrt(np.mean(np.sum(relative_error(true, seen, pairs) ** 2, axis=1)))
    assert ours == pytest.approx(rms(metrics.RPE(part, HZ, metrics.Unit.frames, all_pairs=True), true, seen), rel=1e-6)
    _, pairs = pairs_by_path(path_length(true.position, SECONDS))
    ours = np.sqrt(np.mean(np.sum(relative_error(true, seen, pairs) ** 2, axis=1)))
    theirs = rms(metrics.RPE(part, 1.0, metrics.Unit.meters, all_pairs=True, pairs_from_reference=True), true, seen)
    assert ours == pytest.approx(theirs, rel=0.03)

    laid = laid_over(seen.position, true.position)
    ours = np.sqrt(np.mean(np.sum((laid - true.position) ** 2, axis=1)))
    assert ours == pytest.approx(rms(metrics.APE(part), true, Poses(laid, seen.rot)), rel=1e-9)
    flat = [Poses(poses.position * [1.0, 1.0, 0.0], poses.rot) for poses in (true, seen)]
    aligned = of(flat[1])
    aligned.align(of(flat[0]))  # evo_ape -a
    ours = np.sqrt(np.mean(np.sum((laid_over(flat[1].position, flat[0].position) - flat[0].position) ** 2, axis=1)))
    assert ours == pytest.approx(rms(metrics.APE(part), flat[0], Poses(aligned.positions_xyz, seen.rot)), rel=1e-6)
