"""Feet, contacts, forces and clocks that a log contradicts: refused, or reported in one sentence with what was seen."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from surefoot.errors import SurefootError
from surefoot.lab.estimation.checks import check_kinematics
from surefoot.lab.estimation.export import save_npz
from surefoot.lab.estimation.files import open_log
from surefoot.lab.estimation.log import Log
from surefoot.lab.estimation.logs import DATA
from tests.lab.estimation.walks import noisy
from tests.surefoot.expect import expect_error


@pytest.fixture(scope="module")
def log() -> Log:
    return replace(noisy("turn"), order=None, touch=None)


@pytest.fixture(scope="module")
def columns(log, tmp_path_factory):
    with np.load(save_npz(log, tmp_path_factory.mktemp("checks") / "walk.npz")) as file:
        return {key: file[key] for key in file.files}


def opened(columns, folder):
    np.savez(folder / "log.npz", **columns)
    return open_log(folder / "log.npz")


def load(log: Log) -> np.ndarray:
    """Forces of a robot of 2 kg."""
    return np.where(log.contact, 19.6 / np.maximum(log.contact.sum(axis=1, keepdims=True), 1), 0.1)


def seconds(columns, factor: float, since: float = 0.0):
    out = {key: value for key, value in columns.items() if not key.endswith("stamp_ns")}
    t, feet = (1e-9 * columns[key] + since for key in ("stamp_ns", "foot_stamp_ns"))
    return out | {"t": factor * t, "foot_t": factor * feet}


def scaled(columns, factor: float):
    return columns | {"foot_position": factor * columns["foot_position"]}


def transposed(columns):
    return columns | {"foot_rotation": np.swapaxes(columns["foot_rotation"], 2, 3)}


WRONG = {
    "feet in mm": (lambda c, _: scaled(c, 1e3), "foot_position", "in mm, multiply by 0.001"),
    "feet in cm": (lambda c, _: scaled(c, 1e2), "foot_position", "in cm, multiply by 0.01"),
    "times of feet in ms": (
        lambda c, _: seconds(c, 1.0) | {"foot_t": 1e-6 * c["foot_stamp_ns"]}, "foot_t", "in ms, multiply by 0.001",
    ),
    "stamps of feet in us": (
        lambda c, _: c | {"foot_stamp_ns": c["foot_stamp_ns"] // 1000}, "foot_stamp_ns", "in us, multiply by 1000",
    ),
    "another clock": (lambda c, _: c | {"foot_stamp_ns": c["foot_stamp_ns"] + 10**12}, "foot_stamp_ns", "clock"),
    "ms since 1970": (lambda c, _: seconds(c, 1e3, 1.7e9), "t", "in ms, multiply by 0.001"),
    "us since 1970": (lambda c, _: seconds(c, 1e6, 1.7e9), "t", "in us, multiply by 1e-06"),
    "ns as s": (lambda c, _: seconds(c, 1e9, 1.7e9), "t", "in ns, multiply by 1e-09"),
    "stamps in ms": (lambda c, _: c | {"stamp_ns": c["stamp_ns"] // 10**6}, "stamp_ns", "in ms, multiply by 1e+06"),
    "forces of the other sign": (lambda c, log: c | {"force": -load(log)}, "force", "multiply by -1"),
    "forces of other feet": (lambda c, log: c | {"force": load(log)[:, ::-1]}, "force", "in contact"),
    "contacts in another order": (lambda c, _: c | {"contact": c["contact"][:, ::-1]}, "contact", "another order"),
    "rotations transposed": (lambda c, _: transposed(c), "foot_rotation", "transposed"),
}  # fmt: skip


@pytest.mark.parametrize("kind", WRONG)
def test_what_cannot_be_right_is_refused_with_what_was_seen(log, columns, tmp_path, kind):
    change, field, text = WRONG[kind]
    with expect_error(SurefootError, "invalid", field=field, text=text):
        opened(change(columns, log), tmp_path)


def some(values, rows, value):
    out = np.array(values, dtype=np.float64)
    out[rows] = value
    return out


ODD = {
    "orientations of some samples are NaN": lambda c: {
        "foot_rotation": some(c["foot_rotation"], slice(100, 120), np.nan)
    },
    "no foot is finite": lambda c: {"foot_position": np.full_like(c["foot_position"], np.nan)},
    "all samples of the feet at one time": lambda c: {"foot_stamp_ns": np.full_like(c["foot_stamp_ns"], 10**9)},
    "half of the accelerometer is NaN": lambda c: {"acc": some(c["acc"], slice(0, 1000), np.nan)},
    "a truth that stays": lambda c: {"true_position": 0.0 * c["true_position"]},
    "forces are NaN": lambda c: {"force": np.full(c["contact"].shape, np.nan)},
}


@pytest.mark.parametrize("kind", ODD)
@pytest.mark.parametrize("aligning", [False, True])
def test_odd_logs_are_read_without_a_word_too_much(columns, tmp_path, kind, aligning):
    np.savez(tmp_path / "odd.npz", **(columns | ODD[kind](columns)))
    found = open_log(tmp_path / "odd.npz", aligning=aligning)
    assert not any("another" in note or "lies" in note for note in found.notes)


@pytest.mark.parametrize("factor", [0.0, -1.0, 1.1])
def test_true_orientations_that_are_none_are_refused(columns, tmp_path, factor):
    with expect_error(SurefootError, "invalid", field="true_rotation", text="row 0"):
        opened(columns | {"true_rotation": factor * columns["true_rotation"]}, tmp_path)


def test_seconds_since_1970_are_seconds(columns, tmp_path):
    found = opened(seconds(columns, 1.0, 1.7e9), tmp_path).log
    assert found.seconds[-1] == pytest.approx(1e-9 * np.ptp(columns["stamp_ns"]), abs=1e-6)


@pytest.mark.parametrize(("factor", "noted"), [(1.0, False), (1e-3, True), (1e3, True)])
def test_forces_of_another_scale_are_noted(log, columns, tmp_path, factor, noted):
    notes = opened(columns | {"force": factor * load(log)}, tmp_path).notes
    assert any("forces add up" in note for note in notes) == noted


def test_a_robot_that_is_carried_is_noted(log, columns, tmp_path):
    up = (log.foot_ns > 8e9) & (log.foot_ns < 11e9)
    notes = opened(columns | {"contact": columns["contact"] & ~up[:, None]}, tmp_path).notes
    assert any("from 8.0 to 11.0 s no foot stands" in note for note in notes)


def test_a_robot_that_lies_is_noted(log):
    turn = Rotation.from_rotvec([0.0, 1.5, 0.0]).as_matrix()
    lies = log.seconds > 12.0
    fallen = replace(log, q=np.where(lies[:, None], log.q @ turn.T, log.q))
    (note,) = check_kinematics(fallen)
    assert "feet are not below the IMU" in note


def test_contacts_that_are_none_are_noted(log):
    always = replace(log, contact=np.ones_like(log.contact))
    assert any("relative to each other" in note for note in check_kinematics(always))


@pytest.mark.parametrize("kind", ["plain", "slip", "edges", "false"])
def test_good_logs_have_no_note(kind):
    assert check_kinematics(replace(noisy(kind), order=None)) == ()


@pytest.mark.parametrize(
    "name", ["icub3_gazebo_walk", "icub_real_com", "icub_kindyn_walk", "go1_trot_sim", "casbot_walk_a"]
)
def test_good_foreign_logs_have_no_note(name):
    path = DATA / f"{name}.npz"
    if not path.exists():
        pytest.skip(f"no {path.name} in ../shared/data")
    assert check_kinematics(open_log(path).log) == ()


def test_other_orders_in_foreign_logs_are_refused():
    path = DATA / "icub_kindyn_walk.npz"
    if not path.exists():
        pytest.skip(f"no {path.name} in ../shared/data")
    log = open_log(path).log
    with expect_error(SurefootError, "invalid", field="contact"):
        check_kinematics(replace(log, contact=log.contact[:, ::-1], force=None))
    with expect_error(SurefootError, "invalid", field="force"):
        check_kinematics(replace(log, contact=log.contact[:, ::-1]))
    with expect_error(SurefootError, "invalid", field="foot_rotation"):
        check_kinematics(replace(log, foot_rot=np.swapaxes(log.foot_rot, 2, 3)))
