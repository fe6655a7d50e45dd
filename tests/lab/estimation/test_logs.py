"""Logs of others: loaders give what the notes beside the files state; data may be absent."""

import importlib.util

import numpy as np
import pytest

from surefoot.errors import SurefootError
from surefoot.lab.estimation.contacts import without_rolling
from surefoot.lab.estimation.go1 import LINK, go1_feet, go1_forces
from surefoot.lab.estimation.log import Log
from surefoot.lab.estimation.logs import DATA, FOREIGN, foreign
from surefoot.lab.estimation.track import track
from tests.surefoot.expect import expect_error

WITHOUT_TRUTH = {"spot_staircase", "go1_bag_a"}
HAS_BAGS = importlib.util.find_spec("rosbags") is not None


def read(name: str) -> Log:
    if not (DATA / FOREIGN[name].file).exists():
        pytest.skip(f"{FOREIGN[name].file} is not in {DATA}")
    if FOREIGN[name].file.endswith(".bag") and not HAS_BAGS:
        pytest.skip("ROS bags need rosbags: pip install rosbags")
    return foreign(name)


@pytest.mark.parametrize("name", FOREIGN)
def test_every_log_is_whole(name: str) -> None:
    log = read(name)
    assert log.name == name
    assert (np.diff(log.stamp_ns) > 0).all()
    assert (np.diff(log.foot_ns) >= 0).all()
    assert np.isfinite(log.w).all()
    assert np.isfinite(log.foot_position[log.contact]).all()
    assert (log.truth is None) == (name in WITHOUT_TRUTH)
    assert np.linalg.norm(log.q.mean(axis=0)) == pytest.approx(9.8, abs=0.7)
    assert 0.2 < log.contact.mean() <= 1.0


def test_unknown_names_are_refused_with_the_known_ones() -> None:
    with expect_error(SurefootError, "invalid", text="go1_trot_none"):
        foreign("go2_trot")


def test_a_bag_without_its_reader_names_the_package() -> None:
    row = FOREIGN["go1_bag_a"]
    if HAS_BAGS or not (DATA / row.file).exists():
        pytest.skip("rosbags is installed, or the bag is absent")
    with expect_error(SurefootError, "invalid", text="pip install rosbags"):
        row.read()


def test_jacobian_of_the_forces_by_virtual_work() -> None:
    rng = np.random.default_rng(4)
    joints = np.tile([0.1, 0.8, -1.5], 4) + rng.normal(size=(5, 12)) * 0.2
    force, eps = np.zeros((5, 4, 3)), 1e-6
    force[..., 2] = rng.uniform(20.0, 80.0, size=(5, 4))
    force[..., :2] = rng.normal(size=(5, 4, 2)) * 10.0
    torques = np.zeros((5, 12))
    for i in range(12):
        step = np.zeros(12)
        step[i] = eps
        moved = (go1_feet(joints + step)[0] - go1_feet(joints - step)[0]) / (2.0 * eps)
        torques[:, i] = -np.sum(moved * force, axis=(1, 2))
    np.testing.assert_allclose(go1_forces(joints, torques), force[..., 2], rtol=1e-6)


def test_straight_legs_hang_under_their_hips_and_scale() -> None:
    feet, calf = go1_feet(np.zeros((1, 12)))
    np.testing.assert_allclose(feet[0, :, 2], -2.0 * LINK)
    np.testing.assert_allclose(calf[0], np.repeat(np.eye(3)[None], 4, axis=0), atol=1e-12)
    np.testing.assert_allclose(go1_feet(np.zeros((1, 12)), 1.05)[0][0, :, 2], -2.1 * LINK)


def test_the_trot_agrees_with_the_feet_of_its_file() -> None:
    log = read("go1_trot")
    np.testing.assert_allclose(log.foot_position, np.load(DATA / "go1_trot_sim.npz")["pf"], atol=1e-6)
    for name, least in (("go1_trot_force", 0.88), ("go1_trot_torque", 0.88)):  # a foot that bears little does not stand
        assert ((read(name).contact == log.contact).mean(axis=0) > least).all()
    slow = read("go1_trot_200")
    np.testing.assert_array_equal(slow.foot_position, log.foot_position[4::5])
    np.testing.assert_allclose(slow.w[7], log.w[35:40].mean(axis=0))
    assert slow.stamp_ns[7] == log.stamp_ns[39]


def test_unknown_contacts_reach_the_estimator_as_such() -> None:
    log = read("go1_trot_200_none")
    assert np.isnan(log.switches).all()
    assert np.isfinite(track("best", log).v).all()


def test_balls_without_rolling_rest() -> None:
    log = read("go1_trot")
    whole = np.lib.stride_tricks.sliding_window_view(log.contact, 21, axis=0).all(axis=-1)

    def speed(one: Log) -> float:
        seen = one.position[:, None] + np.einsum("nij,nfj->nfi", one.rot, one.foot_position)
        return float(np.median(np.linalg.norm(seen[20:] - seen[:-20], axis=2)[whole])) / 0.02

    assert speed(without_rolling(log)) < 0.7 * speed(log)
    assert without_rolling(read("spot_staircase")).radius is None
