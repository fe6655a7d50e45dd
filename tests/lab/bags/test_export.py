"""Exports come back as they were; a format that is not known, or a path that exists, is refused."""

from pathlib import Path

import numpy as np
import pytest

from surefoot.errors import SurefootError
from surefoot.lab.bags.exporting import FORMATS, export
from surefoot.lab.bags.fit import fitted
from surefoot.lab.bags.importing import record
from surefoot.lab.bags.raw import log_of_table
from surefoot.lab.bags.ros import BagTopics, log_of_bag
from surefoot.record.columns import Columns, recorded_columns
from surefoot.record.fields import FieldPath
from surefoot.robot.reader import load_robot

from .sway import ROBOT, sway
from .test_bad_bags import log_of_rows


@pytest.fixture(scope="module")
def walk(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("export") / "walk.mcap"
    record(fitted(log_of_rows(sway()), load_robot(ROBOT)), ROBOT, out)
    return out


def estimates(path: Path) -> Columns:
    return {key: part for key, part in recorded_columns(path)[0].items() if key.startswith("published")}


def test_bag_and_table_come_back_bit_for_bit(walk: Path, tmp_path: Path) -> None:
    robot = load_robot(ROBOT)
    bag = export(walk, "rosbag2", tmp_path / "bag")
    table = export(walk, "csv", tmp_path / "walk.csv")
    logs = [
        log_of_bag(bag, BagTopics("/imu/data", "/joint_states", FieldPath.of("/foot_contacts"))),
        log_of_table(table, False),
    ]
    for k, log in enumerate(logs):
        record(fitted(log, robot), ROBOT, tmp_path / f"{k}.mcap")
        again = estimates(tmp_path / f"{k}.mcap")
        for key, part in estimates(walk).items():
            np.testing.assert_array_equal(part, again[key], err_msg=key)


def test_odometry_of_the_bag_is_that_of_the_recording(walk: Path, tmp_path: Path) -> None:
    from rosbags.highlevel import AnyReader

    own, seen = recorded_columns(walk)[0], []
    with AnyReader([export(walk, "rosbag2", tmp_path / "bag")]) as reader:
        links = [c for c in reader.connections if c.topic == "/odom"]
        for link, _, data in reader.messages(links):
            p = reader.deserialize(data, link.msgtype).pose.pose.position
            seen.append((p.x, p.y, p.z))
    np.testing.assert_array_equal(np.array(seen), own["published_position"])
    lines = np.loadtxt(export(walk, "tum", tmp_path / "walk.tum"))
    np.testing.assert_allclose(lines[:, 1:4], own["published_position"], atol=1e-9)


def test_parquet_holds_the_table(walk: Path, tmp_path: Path) -> None:
    parquet = pytest.importorskip("pyarrow.parquet")
    table = parquet.read_table(export(walk, "parquet", tmp_path / "walk.parquet"))
    gyro = table["gyro_x"].to_numpy()
    np.testing.assert_array_equal(gyro[np.isfinite(gyro)], recorded_columns(walk)[0]["gyro"][:, 0])


def test_refusals(walk: Path, tmp_path: Path) -> None:
    with pytest.raises(SurefootError, match=r"rosbag2.*csv"):
        export(walk, "rosbag", tmp_path / "x")
    with pytest.raises(SurefootError, match="exists"):
        export(walk, "csv", walk)
    for kind in FORMATS:
        for other in ("nao", "messor"):
            with pytest.raises(SurefootError, match=f"got {other!r}, allowed is that of .*: {ROBOT!r}") as refused:
                export(walk, kind, tmp_path / "x", other)
            assert refused.value.field == "robot"
    (tmp_path / "bad.mcap").write_bytes(walk.read_bytes()[:5000])
    for kind in FORMATS:
        with pytest.raises(SurefootError):
            export(tmp_path / "bad.mcap", kind, tmp_path / "out")
    assert [path.name for path in tmp_path.iterdir()] == ["bad.mcap"]
