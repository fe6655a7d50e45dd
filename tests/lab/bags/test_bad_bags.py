"""Bad logs are refused in one sentence that names the field; nothing half written stays behind."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from surefoot.errors import SurefootError
from surefoot.lab.bags.fit import fitted
from surefoot.lab.bags.importing import record
from surefoot.lab.bags.raw import RawLog, log_of_table
from surefoot.lab.bags.ros import BagTopics, log_of_bag
from surefoot.record.fields import FieldPath
from surefoot.robot.reader import load_robot

from .sway import MS, ORDER, ROBOT, Sway, sway, write_csv, write_ros1, write_ros2

NAMES = load_robot(ROBOT).joint_names
SHORT = sway().cut(slice(0, 120))
TOPICS = BagTopics("/imu/data", "/joint_states", FieldPath.of("/feet"), feet=ORDER)


def refusal(path: Path, topics: BagTopics = TOPICS, robot: str = ROBOT) -> str:
    """Return the sentence of the refusal of a bag."""
    with pytest.raises(SurefootError) as error:
        fitted(log_of_bag(path, topics), load_robot(robot))
    assert error.value.field
    assert "\n" not in error.value.message
    return error.value.message


@pytest.fixture(scope="module")
def good(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_ros1(tmp_path_factory.mktemp("good") / "good.bag", SHORT, NAMES)


def test_near_names_of_topics_and_joints_are_suggested(good: Path) -> None:
    assert "'/imu/data'" in refusal(good, replace(TOPICS, imu="/imu/dat"))
    assert "/joint_states" in refusal(good, replace(TOPICS, joints="/imu/data"))
    assert "/imu/data" in refusal(good, replace(TOPICS, imu="/joint_states"))  # one topic for both
    wrong = tuple(name.replace("hip", "hipp") for name in NAMES)
    assert "did you mean" in refusal(good, replace(TOPICS, joint_names=wrong))


def test_a_topic_that_can_hold_no_feet_is_named_with_its_type(good: Path, tmp_path: Path) -> None:
    from rosbags.rosbag1 import Writer
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    from .sway import messages

    store = get_typestore(Stores.ROS1_NOETIC)
    rows = messages(SHORT, store, NAMES)
    store.register(get_types_from_msg("geometry_msgs/TransformStamped[] transforms", "tf2_msgs/msg/TFMessage"))
    tree = store.types["tf2_msgs/msg/TFMessage"]([])
    with Writer(tmp_path / "tree.bag") as writer:
        for topic, found in {**rows, "/tf": [(SHORT.stamp_ns[0], tree)]}.items():
            link = writer.add_connection(topic, found[0][1].__msgtype__, typestore=store)
            for stamp, message in found:
                writer.write(link, int(stamp), store.serialize_ros1(message, message.__msgtype__))
    allowed = "allowed are types with a field data, contacts, foot_force or effort: /feet, /joint_states"
    for path, topic, kind in (
        (tmp_path / "tree.bag", "/tf", "tf2_msgs/msg/TFMessage"),
        (tmp_path / "tree.bag", "/tf.transforms", "tf2_msgs/msg/TFMessage"),
        (good, "/imu/data", "sensor_msgs/msg/Imu"),
    ):
        found = refusal(path, replace(TOPICS, contacts=FieldPath.of(topic)))
        assert found == f"{topic.partition('.')[0]} is a {kind}, {allowed}"


def test_another_robot_is_named(good: Path) -> None:
    assert "messor" in refusal(good, robot="messor")


@pytest.mark.parametrize("share", [0.0, 0.3, 0.9, 0.999])
def test_cut_off(good: Path, tmp_path: Path, share: float) -> None:
    data = good.read_bytes()
    (tmp_path / "cut.bag").write_bytes(data[: int(share * len(data))])
    assert "cut off" in refusal(tmp_path / "cut.bag")
    whole = write_ros2(tmp_path / "two", SHORT, NAMES)
    mcap = next(whole.glob("*.mcap"))
    mcap.write_bytes(mcap.read_bytes()[: int(share * mcap.stat().st_size)])
    assert "cut off" in refusal(whole)


def test_a_folder_that_is_no_bag_and_a_recording_of_ours_are_named(tmp_path: Path) -> None:
    assert "without metadata.yaml" in refusal(tmp_path)
    record(fitted(log_of_rows(SHORT), load_robot(ROBOT)), ROBOT, tmp_path / "ours.mcap")
    assert "surefoot estimate" in refusal(tmp_path / "ours.mcap")


def test_unknown_encoding(tmp_path: Path) -> None:
    bag = write_ros2(tmp_path / "two", SHORT, NAMES)
    meta = bag / "metadata.yaml"
    meta.write_text(meta.read_text().replace("serialization_format: cdr", "serialization_format: protobuf"))
    assert "encoding" in refusal(bag)
    (tmp_path / "x.bag").write_bytes(b"#ROSBAG V1.2\n" + b"x" * 100)
    assert "encoding" in refusal(tmp_path / "x.bag")


def test_joints_without_names_need_them(tmp_path: Path) -> None:
    bag = write_ros1(tmp_path / "a.bag", SHORT, [])
    assert "--joint-names" in refusal(bag)
    named = log_of_bag(bag, replace(TOPICS, joint_names=NAMES))
    assert fitted(named, load_robot(ROBOT)).joints.values.shape[1] == len(NAMES)


def shifted(first: int, by_ns: int) -> Sway:
    stamps = SHORT.stamp_ns.copy()
    stamps[first:] += by_ns
    return replace(SHORT, stamp_ns=stamps)


def test_jumping_clocks(tmp_path: Path) -> None:
    back = write_ros1(tmp_path / "back.bag", shifted(50, -7 * MS), NAMES)
    assert "row 50: the stamp goes back" in refusal(back)
    rows = log_of_bag(back, replace(TOPICS, sort=True)).imu.stamp_ns
    assert (np.diff(rows) >= 0).all()
    assert "jumps ahead by 3600" in refusal(write_ros1(tmp_path / "ahead.bag", shifted(50, 3600 * 1000 * MS), NAMES))


def test_a_topic_of_two_types(tmp_path: Path) -> None:
    from rosbags.rosbag1 import Writer
    from rosbags.typesys import Stores, get_typestore

    from .sway import messages

    store = get_typestore(Stores.ROS1_NOETIC)
    with Writer(tmp_path / "twice.bag") as writer:
        rows = messages(SHORT, store, NAMES)
        for name, topic in (("/imu/data", "/joint_states"), ("/joint_states", "/joint_states"), ("/imu/data",) * 2):
            link = writer.add_connection(topic, rows[name][0][1].__msgtype__, typestore=store)
            for stamp, message in rows[name]:
                writer.write(link, stamp, store.serialize_ros1(message, message.__msgtype__))
    assert "one type is allowed" in refusal(tmp_path / "twice.bag")


def test_a_topic_that_comes_twice_counts_once(tmp_path: Path) -> None:
    doubled = replace(SHORT, **{name: np.repeat(part, 2, axis=0) for name, part in vars(SHORT).items()})
    once, twice = (write_ros1(tmp_path / f"{k}.bag", log, NAMES) for k, log in enumerate((SHORT, doubled)))
    players = [
        record(fitted(log_of_bag(bag, TOPICS), load_robot(ROBOT)), ROBOT, tmp_path / f"{k}.mcap")
        for k, bag in enumerate((once, twice))
    ]
    assert not players[0].intake.refused
    assert players[1].intake.refused["imu_duplicate"] == len(SHORT.stamp_ns)
    assert (tmp_path / "0.mcap").read_bytes() == (tmp_path / "1.mcap").read_bytes()


def test_an_unknown_frame_needs_a_transform(tmp_path: Path) -> None:
    bag = write_ros1(tmp_path / "a.bag", SHORT, NAMES, frame="camera")
    assert "'camera'" in refusal(bag)
    log = log_of_bag(bag, TOPICS)
    assert fitted(log, load_robot(ROBOT), imu_frame="imu").imu.values.shape == (len(SHORT.stamp_ns), 6)


@pytest.mark.parametrize("place", ["/feet.nothing", "/feet.header", "/feet.effort[0:3]", "fe[et"])
def test_places_that_hold_no_feet(good: Path, place: str) -> None:
    with pytest.raises(SurefootError):
        fitted(log_of_bag(good, replace(TOPICS, contacts=FieldPath.of(place), feet=())), load_robot(ROBOT))


@pytest.mark.parametrize("value", [0.0, 217.0])
def test_feet_that_show_nothing_are_left_out(value: float) -> None:
    log = log_of_rows(replace(SHORT, raw=np.full_like(SHORT.raw, value)))
    made = fitted(log, load_robot(ROBOT))
    assert made.feet is None
    assert any("foot forces" in note for note in made.notes)


def log_of_rows(log: Sway) -> RawLog:
    from surefoot.lab.bags.raw import Stream

    imu = Stream(log.stamp_ns, np.hstack([log.gyro, log.acc]).astype(np.float64))
    feet = Stream(log.stamp_ns, log.raw.astype(np.float64))
    joints = Stream(log.stamp_ns, log.joints.astype(np.float64))
    return RawLog(imu, "", joints, NAMES, feet=feet, feet_names=ORDER)


def test_nothing_half_written_stays(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    made = fitted(log_of_rows(SHORT), load_robot(ROBOT))

    def fail(*_: object) -> None:
        raise OSError(28, "No space left on device")

    with monkeypatch.context() as patch:
        patch.setattr("surefoot.lab.bags.importing.LocalSystem.run_until", fail)
        with pytest.raises(OSError, match="No space"):
            record(made, ROBOT, tmp_path / "run.mcap")
    assert not list(tmp_path.iterdir())
    (tmp_path / "run.mcap").touch()
    with pytest.raises(SurefootError, match="exists"):
        record(made, ROBOT, tmp_path / "run.mcap")


def test_a_table_without_joints_is_named(tmp_path: Path) -> None:
    path = write_csv(tmp_path / "a.csv", SHORT, NAMES)
    path.write_text(path.read_text().replace("joint_", "angle_"))
    with pytest.raises(SurefootError, match="no joint angles"):
        log_of_table(path, False)
