"""The same walk as ROS 1 bag, ROS 2 bag and CSV gives the same recording; what is there is found, by name and frame."""

import json
import tomllib
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from surefoot.lab.bags.fit import fitted
from surefoot.lab.bags.raw import RawLog, Stream, Transform
from surefoot.lab.cli.main import main
from surefoot.record.columns import recorded_columns
from surefoot.robot.reader import load_robot

from .sway import MS, ORDER, PER_NEWTON, ROBOT, START_NS, ZERO, Sway, sway, write_csv, write_ros1, write_ros2

Run = tuple[int, str, str]
NAMES = load_robot(ROBOT).joint_names
FORCES = ("--contacts", "/feet", "--feet", ",".join(ORDER))


def surefoot(capsys: pytest.CaptureFixture[str], *words: object) -> Run:
    with pytest.raises(SystemExit) as end:
        main([str(word) for word in words])
    shown = capsys.readouterr()
    return int(str(end.value.code)), shown.out, shown.err


def imported(capsys: pytest.CaptureFixture[str], log: Path, out: Path, *words: str) -> dict[str, Any]:
    code, shown, wrong = surefoot(capsys, "bag", "import", log, "--robot", ROBOT, "-o", out, "--json", *words)
    assert code == 0, wrong
    return json.loads(shown)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("bags")


@pytest.fixture
def walk(folder: Path, capsys: pytest.CaptureFixture[str]) -> Path:
    """The recording of the ROS 1 bag."""
    out = folder / "one.mcap"
    if not out.exists():
        bag = write_ros1(folder / "one.bag", sway(), [f"{name}_joint".upper() for name in NAMES])
        report = imported(capsys, bag, out, *FORCES, "--calibration", str(folder / "feet.toml"))
        assert report["joint_rows"] == len(sway().stamp_ns)
    return out


def same(a: Path, b: Path) -> None:
    one, other = (recorded_columns(path)[0] for path in (a, b))
    assert one.keys() == other.keys()
    for key, values in one.items():
        np.testing.assert_array_equal(values, other[key], err_msg=key)


def test_ros2_bag_and_table_give_the_bits_of_the_ros1_bag(
    walk: Path, folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    rng = np.random.default_rng(0)
    order = rng.permutation(len(NAMES))
    shuffled = replace(sway(), joints=sway().joints[:, order])
    names = [NAMES[i] for i in order]
    imported(capsys, write_ros2(folder / "two", shuffled, names, mcap=False), folder / "two.mcap", *FORCES)
    same(walk, folder / "two.mcap")
    imported(capsys, write_csv(folder / "table.csv", shuffled, names), folder / "table.mcap")
    same(walk, folder / "table.mcap")


def test_a_bare_mcap_file_and_an_npz_table_give_the_bits_of_the_ros1_bag(
    walk: Path, folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bag = write_ros2(folder / "three", sway(), NAMES, mcap=True)
    (file,) = bag.glob("*.mcap")
    bare = file.rename(folder / "bare_log.mcap")
    imported(capsys, bare, folder / "bare.mcap", *FORCES)
    same(walk, folder / "bare.mcap")
    log, legs = sway(), load_robot(ROBOT).leg_names
    np.savez(
        folder / "table.npz", stamp_ns=log.stamp_ns, gyro=log.gyro, acc=log.acc, foot_stamp_ns=log.stamp_ns,
        joints=log.joints, joint_names=NAMES, force=log.raw[:, [ORDER.index(leg) for leg in legs]],
    )  # fmt: skip
    imported(capsys, folder / "table.npz", folder / "npz.mcap")
    same(walk, folder / "npz.mcap")


def test_the_next_commands_of_a_file_with_a_space_can_be_pasted(
    walk: Path, folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = folder / "a b.mcap"
    code, shown, wrong = surefoot(capsys, "bag", "import", walk.with_suffix(".bag"), "--robot", ROBOT, "-o", out)
    assert code == 0, wrong
    assert shown.endswith(f"next: surefoot report '{out}', surefoot estimate '{out}'\n")


def test_the_estimate_moves_as_the_robot_did_and_equals_that_over_the_recording(
    walk: Path, folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    columns = recorded_columns(walk)[0]
    ready = columns["published_flags"][:, 0] > 0.5
    assert ready[-1]
    t = 1e-9 * columns["published_stamp_ns"][ready] - 0.8
    true = 0.01 * 2.0 * np.pi * np.sin(2.0 * np.pi * np.clip(t, 0.0, None))
    assert np.abs(columns["published_velocity_imu"][ready, 0] - true).max() < 0.02
    assert np.abs(true).max() > 0.05
    code, shown, _ = surefoot(capsys, "compare", walk, walk, "--json")
    assert code == 0
    assert surefoot(capsys, "estimate", walk, "-o", folder / "estimate")[0] == 0
    code, shown, _ = surefoot(capsys, "compare", folder / "estimate", walk, "--json")
    assert code == 0
    assert all(part["largest"] == 0.0 for part in json.loads(shown)["differences"].values())


def test_a_report_needs_no_truth(walk: Path, capsys: pytest.CaptureFixture[str]) -> None:
    code, shown, wrong = surefoot(capsys, "report", walk, "--json")
    assert code == 0, wrong
    assert json.loads(shown)["values"]["duration_s"] == pytest.approx(1.6, abs=0.02)
    assert "Way by the odometry" in walk.with_suffix(".html").read_text()


def test_zero_and_scale_of_the_feet_are_found(walk: Path, folder: Path) -> None:
    table = tomllib.loads((folder / "feet.toml").read_text())["unitree"]
    assert table["foot_zero"] == pytest.approx([ZERO] * 4, rel=1e-6)
    assert table["foot_scale"] == pytest.approx([1.0 / PER_NEWTON] * 4, rel=1e-6)
    touch = recorded_columns(walk)[0]["touch"]
    lifted = sway().raw[:, [ORDER.index(leg) for leg in load_robot(ROBOT).leg_names]] < ZERO + 1.0
    ticks = recorded_columns(walk)[0]["joints_stamp_ns"] // (2 * MS)
    np.testing.assert_array_equal(touch > 0.5, ~lifted[ticks])


def raw_of(log: Sway, **more: Any) -> RawLog:
    imu = Stream(log.stamp_ns, np.hstack([log.gyro, log.acc]).astype(np.float64))
    return RawLog(imu, "", Stream(log.stamp_ns, log.joints.astype(np.float64)), NAMES, **more)


def test_inertial_rows_are_turned_by_the_fixed_transforms() -> None:
    robot = load_robot(ROBOT)
    half = np.sqrt(0.5)
    log = raw_of(sway())
    log.imu_frame = "sensor"
    log.frames = {
        "sensor": Transform("plate", np.zeros(3), np.array([half, 0.0, 0.0, half])),
        "plate": Transform("base_link", robot.imu.position, np.array([half, half, 0.0, 0.0])),
    }
    # x of the sensor is y of the plate; y of the plate is z of the trunk
    turned = fitted(log, robot).imu.values
    from surefoot.geometry.rotations import matrix_from_quat

    in_base = turned[:, :3] @ matrix_from_quat(robot.imu.quat_wxyz).T
    np.testing.assert_allclose(in_base[:, 2], log.imu.values[:, 0], atol=1e-12)


def test_torques_stand_in_for_foot_forces() -> None:
    from surefoot.robot.kinematics import foot_jacobians, gravity_torques

    robot, log = load_robot(ROBOT), sway()
    up, torque = np.array([0.0, 0.0, 9.81]), np.zeros_like(log.joints, dtype=np.float64)
    for k, q in enumerate(log.joints.astype(np.float64)):
        torque[k] = gravity_torques(robot.model, q, up)
        for leg, own in enumerate(robot.model.leg_joints):
            pushed = foot_jacobians(robot.model, q)[leg].T @ np.array([0.0, 0.0, 0.25 * 9.81 * robot.mass])
            torque[k, own] -= pushed[: len(own)] * (0.0 if leg == 1 and k % 100 > 50 else 1.0)
    made = fitted(raw_of(log, torque=torque), robot)
    assert made.feet is not None
    assert made.contact is not None
    assert np.median(made.feet.values.sum(axis=1)) == pytest.approx(9.81 * robot.mass, rel=0.3)


def test_stamps_may_begin_anywhere_and_joints_late() -> None:
    log = sway()
    late = raw_of(log)
    late.joints = Stream(log.stamp_ns[600:], late.joints.values[600:])
    made = fitted(late, load_robot(ROBOT))
    assert made.joints.stamp_ns[0] == START_NS + 1200 * MS
    assert any("1.20 s after" in note for note in made.notes)
