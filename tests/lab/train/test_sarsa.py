"""Training: the update against a plain one, what is learned, checkpoints."""

import numpy as np
import pytest

from surefoot.errors import SurefootError
from surefoot.lab.statistics import success_bound
from surefoot.lab.train.evaluation import Seeds, episodes, paired, summary
from surefoot.lab.train.learning import corners
from surefoot.lab.train.runs import make_sarsa
from surefoot.lab.train.sarsa import Schedule, Training
from surefoot.services.navigator.environment.episodes import RESULT
from surefoot.services.navigator.policy.arrays import arrays
from surefoot.services.navigator.policy.grids import GRID, add_values
from surefoot.services.navigator.policy.library import find
from surefoot.services.navigator.policy.params import load


def test_corners_are_weights_of_the_table_that_is_read():
    rng, world = np.random.default_rng(0), arrays(load("paper"))
    table = rng.normal(size=(3, 5, 8, 4))
    for mirrored in (0.0, -1.0):
        grid = np.zeros(GRID)
        grid[:5] = 0.0, 6.0, -8.0, -2.0, mirrored
        for _ in range(50):
            d, phi, h = rng.uniform([0, -3.14, -9], [7, 3.14, -1])
            cells, weights = np.zeros(8, dtype=np.int64), np.zeros(8)
            flip = corners(table, grid, d, phi, h, cells, weights)
            assert weights.sum() == pytest.approx(1.0)
            assert (weights >= 0).all()
            want = np.zeros(4)
            add_values(table, grid, world.tables.actions, d, phi, h, 1.0, want)
            got = np.array([weights @ table.reshape(-1)[cells + a] for a in range(4)])
            assert (got[[0, 2, 1, 3]] if flip else got) == pytest.approx(want)


def test_it_learns_to_arrive_sooner_than_the_paper_s_controller():
    model = load("paper")
    training = Training(model, seed=12345)
    training.advance(1500)
    world = arrays(model)
    ours, hand = (episodes(world, p, Seeds(0, 300), stream=4) for p in (training.policy(), find("hand", model)))
    assert summary(ours)["success"] > 0.99
    assert paired(ours, hand)["difference_ci95_percent"][1] < -3.0
    early, late = training.seconds[:100].mean(), training.seconds[-100:].mean()
    assert late < 0.6 * early


def test_a_training_that_was_interrupted_goes_on_with_the_same_bits(tmp_path):
    model, schedule = load("paper"), Schedule(episodes=60)
    whole = Training(model, 3, schedule)
    whole.advance(60)
    part = Training(model, 3, schedule)
    part.advance(25)
    part.keep(tmp_path / "c.npz")
    again = Training(model, 3, schedule)
    again.take_up(tmp_path / "c.npz")
    assert again.done == 25
    again.advance(100)
    assert np.array_equal(again.table, whole.table)
    assert np.array_equal(again.policy().tables.table, whole.policy().tables.table)
    assert np.array_equal(again.seconds, whole.seconds)


def test_checkpoints_of_other_trainings_and_damaged_ones_are_refused(tmp_path):
    training = Training(load("paper"), 3, Schedule(episodes=10))
    training.keep(tmp_path / "c.npz")
    with pytest.raises(SurefootError, match="another model"):
        Training(load("paper"), 4, Schedule(episodes=10)).take_up(tmp_path / "c.npz")
    (tmp_path / "c.npz").write_bytes((tmp_path / "c.npz").read_bytes()[:100])
    with pytest.raises(SurefootError, match="no checkpoint"):
        training.take_up(tmp_path / "c.npz")


def test_of_several_trainings_the_best_is_kept_and_all_are_listed(tmp_path):
    policy, trained = make_sarsa(load("paper"), Schedule(episodes=150), 0, 3, tmp_path / "p.npz")
    assert [t.seed for t in trained] == [0, 1, 2]
    kept = next(t for t in trained if t.kept)
    assert (-kept.success, kept.mean_s) == min((-t.success, t.mean_s) for t in trained)
    assert policy.provenance["seed"] == str(kept.seed)
    assert policy.provenance["chosen_of"] == "3"
    assert not list(tmp_path.iterdir())


def test_statistics():
    assert success_bound(1000, 1000) == pytest.approx(0.05 ** (1 / 1000))
    assert success_bound(0, 10) == 0.0
    results = np.zeros(4, RESULT)
    results["seconds"], results["ended"], results["decisions"] = [1, 2, 3, 4], 1, 10
    s = summary(results)
    assert (s["mean_s"], s["median_s"], s["success"]) == (2.5, 2.5, 1.0)
    results["nees_at"] = [0.5, 7.81, 7.82, 90.0]  # 7.815: 95 % of chi2 with 3 degrees of freedom
    assert summary(results)["inside_95_at_20"] == 0.5
    other = results.copy()
    other["seconds"] += [1.0, 1.1, 0.9, 1.0]
    assert paired(results, other)["difference_s"] == pytest.approx(-1.0)
    assert paired(results, results)["p_paired_t"] == 1.0
