"""Recordings of this project: the log is what the service saw, and its estimates are those that were published."""

import shutil
from dataclasses import replace

import numpy as np
import pytest

from surefoot.errors import SurefootError
from surefoot.lab.estimation import results
from surefoot.lab.estimation.differences import departures, load_estimated
from surefoot.lab.estimation.files import open_log
from surefoot.lab.estimation.recorded import log_of_columns, log_of_recording, published
from surefoot.lab.estimation.scores import score
from surefoot.lab.estimation.track import track
from surefoot.lab.runs.local import run_local
from surefoot.record.columns import recorded_columns
from surefoot.robot.profiles import ROBOTS
from surefoot.robot.reader import load_robot, robot_file
from surefoot.services.supervisor.scenarios.scenario import find_scenario, load_scenario
from tests.surefoot.expect import expect_error


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    """Five seconds of Ragno's walk."""
    path = tmp_path_factory.mktemp("walk") / "ragno.mcap"
    run_local(replace(load_scenario(find_scenario("flat")), max_duration_s=5.0), 3, recording=path)
    return path


def test_replay_gives_the_published_bits(recording):
    columns, robot = recorded_columns(recording)
    live, log = published(columns, load_robot(robot)), log_of_recording(recording)
    mode = recorded_mode(recording)
    replayed = track(mode, log, level_ground=True)  # as the scenario configures the service
    np.testing.assert_array_equal(replayed.v, live.v)
    np.testing.assert_array_equal(replayed.p, live.p)
    np.testing.assert_array_equal(replayed.position, live.position)
    np.testing.assert_array_equal(replayed.yaw, live.yaw)


def recorded_mode(path) -> str:
    """The estimator behind state/velocity in a recording."""
    from surefoot.record.recording import read_recording

    return next(read_recording(path, ("state/velocity",))).message().mode


def test_the_truth_is_that_of_the_imu(recording):
    log = log_of_recording(recording)
    period = np.diff(log.seconds)[:, None]
    by_position = np.diff(log.position, axis=0) / period
    middle = 0.5 * (log.v_world[1:] + log.v_world[:-1])
    assert np.sqrt(np.mean((by_position - middle) ** 2)) < 2e-3
    assert log.touch.shape[2] == log.points.shape[1]
    assert log.rest[1] - log.rest[0] == 50
    assert score(log, track("ekf", log)).rmse < 0.02


def test_a_recording_that_ends_between_velocity_and_odometry_keeps_the_rows_of_both(recording):
    columns, name = recorded_columns(recording)
    whole = published(columns, load_robot(name))
    odometry = ("published_position", "published_yaw", "published_velocity_odom")
    cut = published({k: v[:-1] if k in odometry else v for k, v in columns.items()}, load_robot(name))
    assert len(cut.position) == len(whole.position)
    np.testing.assert_array_equal(cut.position[:-5], whole.position[:-5])
    np.testing.assert_array_equal(cut.v[:-5], whole.v[:-5])


def test_recordings_that_do_not_fit_are_refused(recording):
    columns, _ = recorded_columns(recording)
    with expect_error(SurefootError, field="joints"):
        log_of_columns("ragno", columns, load_robot("nao"))
    with expect_error(SurefootError, field="gyro"):
        log_of_columns("ragno", {k: v for k, v in columns.items() if k != "gyro"}, load_robot("ragno"))
    with expect_error(SurefootError, field="state/velocity"):
        published({}, load_robot("ragno"))


def test_a_truncated_recording_is_refused(recording, tmp_path):
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(recording.read_bytes()[:20_000])
    with expect_error(SurefootError, "malformed"):
        log_of_recording(cut)


def of_others(recording):
    """Columns of the recording as others would write them: joint angles, contacts, truth of the IMU."""
    log = log_of_recording(recording)
    truth = log.known()
    return {
        "stamp_ns": log.stamp_ns, "gyro": log.w, "acc": log.q, "foot_stamp_ns": log.foot_ns, "joints": log.joints,
        "contact": log.contact, "true_position": truth.position, "true_rotation": truth.rot,
        "true_velocity": truth.v_world,
    }  # fmt: skip


def test_a_table_with_the_joints_of_a_robot_is_estimated(recording, tmp_path):
    """Columns in any order, and by the names that other software gives the joints: the same estimate."""
    columns, ragno = of_others(recording), load_robot("ragno")
    np.savez(tmp_path / "plain.npz", **columns)
    plain = track("best", open_log(tmp_path / "plain.npz", robot="ragno").log)
    others = {name: f"m{i}_{name[::-1]}" for i, name in enumerate(ragno.joint_names)}
    text = robot_file("ragno").read_text(encoding="utf-8")
    named = "\n".join(f'"{ours}" = "{theirs}"' for ours, theirs in others.items())
    (tmp_path / "robot.toml").write_text(f"{text}\n[other_names]\n{named}\n", encoding="utf-8")
    turned = list(others.values())[::-1]
    np.savez(tmp_path / "named.npz", **(columns | {"joints": columns["joints"][:, ::-1], "joint_names": turned}))
    found = track("best", open_log(tmp_path / "named.npz", robot=str(tmp_path / "robot.toml")).log)
    np.testing.assert_array_equal(found.v, plain.v)
    assert load_robot(tmp_path / "robot.toml").hash == ragno.hash
    assert np.isfinite(plain.v[100:]).all()


def test_joints_in_another_order_of_legs_are_refused(recording, tmp_path):
    columns = of_others(recording)
    np.savez(tmp_path / "good.npz", **columns)
    good = open_log(tmp_path / "good.npz", robot="ragno")
    assert not any("another" in note for note in good.notes)
    legs = columns["joints"].reshape(len(columns["joints"]), 6, 3)[:, [3, 4, 5, 0, 1, 2]]
    np.savez(tmp_path / "legs.npz", **(columns | {"joints": legs.reshape(len(legs), 18)}))
    with expect_error(SurefootError, "invalid", field="contact", text="another order"):
        open_log(tmp_path / "legs.npz", robot="ragno")
    both = {"joints": legs.reshape(len(legs), 18), "contact": columns["contact"][:, [3, 4, 5, 0, 1, 2]]}
    np.savez(tmp_path / "both.npz", **(columns | both))
    assert any("another order" in note for note in open_log(tmp_path / "both.npz", robot="ragno").notes)


def test_a_robot_with_the_same_joints_and_other_legs_is_noted(recording, tmp_path):
    np.savez(tmp_path / "ragno.npz", **of_others(recording))
    assert any("of another robot" in note for note in open_log(tmp_path / "ragno.npz", robot="messor").notes)


def test_a_recording_is_of_its_own_robot(recording, tmp_path):
    with expect_error(SurefootError, "invalid", field="robot", text="ragno"):
        open_log(recording, robot="messor")  # as many joints, of the same names
    own = shutil.copytree(ROBOTS / "ragno", tmp_path / "calibrated")
    log = open_log(recording, robot=str(own)).log
    shutil.rmtree(own)  # the log carries its description
    assert len(track("best", log).v) == len(log.stamp_ns)


def test_a_recording_is_compared_with_its_replay(recording, tmp_path):
    log = log_of_recording(recording)
    found = results.estimate(log, "kinematics_gyro", tmp_path / "parts")
    results.pack(tmp_path / "parts", tmp_path / "estimates.npz")
    one, other = load_estimated(recording), load_estimated(tmp_path / "estimates.npz")
    assert one.errors["rmse"] < 0.02
    assert other.errors == {}
    off = departures(one, other)
    assert 0.0 < off["velocity"].rms < 0.05
    assert departures(other, one)["tilt"].rms == pytest.approx(off["tilt"].rms, rel=0.1)
    np.testing.assert_array_equal(other.v, found.track.v)
