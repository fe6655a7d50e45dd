"""Files of others as logs: round trips, what has to be assumed, and what is refused."""

from dataclasses import replace

import numpy as np
import pytest

from surefoot.errors import SurefootError
from surefoot.lab.estimation.export import save_csv, save_npz
from surefoot.lab.estimation.files import log_of_table, open_log
from surefoot.lab.estimation.track import track
from surefoot.record.tables import read_table
from surefoot.robot.reader import load_robot
from tests.lab.estimation.walks import noisy
from tests.surefoot.expect import expect_error


@pytest.fixture(scope="module")
def walk():
    log = noisy()
    return replace(log, order=None)


def standing(robot, n=60):
    """Columns of a robot at rest, 100 rows a second, without contacts."""
    return {
        "stamp_ns": 10_000_000 * np.arange(n), "foot_stamp_ns": 10_000_000 * np.arange(n), "gyro": np.zeros((n, 3)),
        "acc": np.tile([0.0, 0.0, 9.81], (n, 1)), "joints": np.tile(robot.neutral, (n, 1)),
    }  # fmt: skip


def refused(path, **options) -> SurefootError:
    with pytest.raises(SurefootError) as found:
        open_log(path, **options)
    return found.value


@pytest.mark.parametrize("save", [save_npz, save_csv])
def test_a_log_survives_the_file(walk, tmp_path, save):
    path = save(walk, tmp_path / f"log.{save.__name__[-3:]}")
    log = open_log(path).log
    np.testing.assert_array_equal(log.stamp_ns, walk.stamp_ns)
    np.testing.assert_array_equal(log.foot_ns, walk.foot_ns)
    np.testing.assert_array_equal(log.w, walk.w)
    np.testing.assert_allclose(log.foot_position, walk.foot_position, atol=1e-15)
    np.testing.assert_allclose(log.foot_rot, walk.foot_rot, atol=1e-12)
    np.testing.assert_array_equal(log.contact, walk.contact)


def test_the_file_gives_the_same_estimates(walk, tmp_path):
    log = open_log(save_npz(walk, tmp_path / "log.npz"), sigma_w=0.0054, sigma_q=0.035).log
    log = replace(log, sensors=walk.sensors, rot_base_from_imu=walk.rot_base_from_imu)
    np.testing.assert_array_equal(track("ekf", log).v, track("ekf", walk).v)


def test_joints_become_feet_by_the_description(tmp_path):
    n, columns = 60, standing(load_robot("bioloid"))
    del columns["stamp_ns"], columns["foot_stamp_ns"]
    columns |= {"t": 0.01 * np.arange(n), "contact": np.ones((n, 2))}
    np.savez(tmp_path / "log.npz", **columns)
    opened = open_log(tmp_path / "log.npz", robot="bioloid")
    assert opened.log.foot_position.shape == (n, 2, 3)
    assert opened.log.foot_position[0, 0, 2] < -0.1
    assert refused(tmp_path / "log.npz").field == "robot"
    assert refused(tmp_path / "log.npz", robot="nao").field == "joints"  # the wrong robot
    np.savez(tmp_path / "deg.npz", **(columns | {"joints": np.degrees(columns["joints"])}))
    error = refused(tmp_path / "deg.npz", robot="bioloid")
    assert error.field == "joints"
    assert "0.0174533" in error.message


def test_named_joints_are_put_in_the_order_of_the_robot():
    robot = load_robot("bioloid")
    order = np.random.default_rng(0).permutation(robot.nj)
    columns = standing(robot) | {"contact": np.ones((60, 2)), "joint_names": np.array(robot.joint_names)[order]}
    columns["joints"] = columns["joints"][:, order]
    log, _ = log_of_table("named", columns, robot)
    np.testing.assert_array_equal(log.joints[0], robot.neutral)
    columns["joint_names"] = np.array(["other", *robot.joint_names[1:]])
    with expect_error(SurefootError, field=f"joint_{robot.joint_names[0]}"):
        log_of_table("named", columns, robot)


def test_contacts_by_force_and_by_height_are_said_to_be(walk, tmp_path):
    force = np.where(walk.contact, 12.0, 0.3)
    by_force = open_log(save_npz(_without_contacts(walk, force=force), tmp_path / "f.npz"))
    assert (by_force.log.contact == walk.contact).mean() > 0.99
    assert any("force" in note for note in by_force.notes)
    by_height = open_log(save_npz(_without_contacts(walk), tmp_path / "h.npz"))
    assert (by_height.log.contact == walk.contact).mean() > 0.8
    assert any("no contacts" in note for note in by_height.notes)


@pytest.mark.parametrize(("switches", "noted"), [(1, False), (3, True), (4, False), (5, True)])
def test_switches_without_known_places_are_said_to_be_one_flag(switches, noted):
    robot = load_robot("bioloid")
    _, notes = log_of_table("soles", standing(robot) | {"touch": np.ones((60, 2, switches))}, robot)
    assert any(f"{switches} switches a foot, bioloid has places for 4" in note for note in notes) == noted


def _without_contacts(log, force=None):
    return replace(log, contact=None, force=force)


def test_a_log_without_feet_leaves_the_inertial_unit(walk, tmp_path):
    np.savez(tmp_path / "imu.npz", stamp_ns=walk.stamp_ns, gyro=walk.w, acc=walk.q)
    opened = open_log(tmp_path / "imu.npz")
    assert any("no feet" in note for note in opened.notes)
    found = track("imu", opened.log)
    assert np.isfinite(found.v).all()
    assert not found.flags["sensors_ok"][-1]


BROKEN = {
    "acc in g": (lambda log: {"q": log.q / 9.81}, "acc", "9.81"),
    "acc with the other sign": (lambda log: {"q": -log.q}, "acc", "-1"),
    "gyro in deg/s": (lambda log: {"w": np.degrees(log.w)}, "gyro", "0.0174533"),
    "no finite row": (lambda log: {"w": np.full_like(log.w, np.nan)}, "gyro", "finite"),
    "foot that is no rotation": (lambda log: {"foot_rot": 1.1 * log.foot_rot}, "foot_rotation", "row 0, foot 0"),
    "contact in percent": (lambda log: {"contact": 100.0 * log.contact}, "contact0", "row 0"),
}


@pytest.mark.parametrize("kind", BROKEN)
def test_wrong_units_are_refused_with_the_factor(walk, tmp_path, kind):
    change, field, word = BROKEN[kind]
    error = refused(save_npz(replace(walk, **change(walk)), tmp_path / "log.npz"))
    assert error.field == field
    assert word in error.message


def test_a_gyro_with_the_other_sign_is_seen_in_motion(walk, tmp_path):
    t = walk.seconds
    w = np.zeros_like(walk.w)
    w[:, 0] = 0.5 * np.cos(2.0 * t)  # rolls by 14 deg
    roll = 0.25 * np.sin(2.0 * t)
    q = 9.81 * np.stack([np.zeros_like(roll), np.sin(roll), np.cos(roll)], 1)
    feet = {"foot_position": np.tile([0.0, 0.1, -0.3], (len(t), 1, 1)), "contact": np.ones((len(t), 1))}
    np.savez(tmp_path / "good.npz", stamp_ns=walk.stamp_ns, gyro=w, acc=q, **feet)
    open_log(tmp_path / "good.npz")
    np.savez(tmp_path / "bad.npz", stamp_ns=walk.stamp_ns, gyro=-w, acc=q, **feet)
    error = refused(tmp_path / "bad.npz")
    assert (error.field, "-1" in error.message) == ("gyro", True)


def test_nan_in_cells_is_counted_and_harmless(walk, tmp_path):
    w, position = walk.w.copy(), walk.foot_position.copy()
    w[500:503, 1] = np.nan
    position[200:204, 0] = np.inf
    log = open_log(save_npz(replace(walk, w=w, foot_position=position), tmp_path / "log.npz")).log
    found = track("ekf", log)
    assert found.refused["imu_nonfinite"] == 3
    assert found.refused["kinematics_nonfinite"] == 4
    assert np.isfinite(found.v).all()


def test_stamps_that_repeat_are_counted(walk, tmp_path):
    stamps = walk.stamp_ns.copy()
    stamps[700] = stamps[699]
    log = open_log(save_npz(replace(walk, stamp_ns=stamps), tmp_path / "log.npz")).log
    assert track("ekf", log).refused == {"imu_duplicate": 1}


def test_arrays_of_an_npz_that_are_not_read_are_named_with_near_names(tmp_path):
    path = save_npz(noisy(), tmp_path / "log.npz")
    assert not any("not read" in note for note in open_log(path).notes)
    columns = dict(np.load(path))
    np.savez(path, **columns, tru_position=columns["true_position"], mood=np.zeros(3))
    (note,) = (note for note in open_log(path).notes if "not read" in note)
    assert note.startswith("not read of log.npz: 'tru_position' (did you mean 'true_position'?), 'mood'; read are t, ")
    np.savez(path, **columns, feet="ball", foot_radus=0.02)
    assert "'foot_radus' (did you mean 'foot_radius'?)" in refused(path).message


def test_columns_of_a_csv_that_are_not_read_are_named_with_near_names(tmp_path):
    path = save_csv(noisy(), tmp_path / "log.csv")
    assert not any("not read" in note for note in open_log(path).notes)
    header, *rows = path.read_text().splitlines()
    more = f"{header},mood,true_pos_x,torque_knee"
    path.write_text("\n".join(["# feets = point", more, *(f"{row},1,2,3" for row in rows)]))
    (note,) = (note for note in open_log(path).notes if "not read" in note)
    known = "not read of log.csv: 'mood', 'true_pos_x' (did you mean 'true_px'?), 'torque_knee', "
    assert note == known + "'feets' (did you mean 'feet'?); known columns: docs/estimate.md"
    path.write_text("\n".join([header.replace("acc_x,acc_y,acc_z", "acc_1,acc_2,acc_3"), *rows]))
    assert "'acc_1' (did you mean 'acc_" in refused(path).message


def test_the_reader_is_told_by_the_suffix(tmp_path):
    assert refused(tmp_path / "none.npz").code == "invalid"
    (tmp_path / "log.bag").write_bytes(b"x")
    assert refused(tmp_path / "log.bag").code == "invalid"
    assert read_table(save_npz(noisy(), tmp_path / "a.npz"))["gyro"].shape[1] == 3
