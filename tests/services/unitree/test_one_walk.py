"""One walk as Unitree's messages over DDS, ROS 2 messages, a bag and a table gives the same estimate, bit for bit."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from surefoot.bus.ros2 import types
from surefoot.lab.cli.main import main
from surefoot.lab.runs.local import run_local
from surefoot.record.columns import Columns, recorded_columns
from surefoot.services.supervisor.scenarios.scenario import parse_scenario
from tests.lab.bags.sway import MS, ORDER, ROBOT, START_NS, Sway, messages, recorded_walk, write_csv, write_ros2
from tests.services.ros_robot import test_driver as ros
from tests.surefoot.net import Net

pytest.importorskip("cyclonedds")
from surefoot.services.unitree.messages import MemoryAsSent

from .test_driver import MAKER, NAMES, Quiet, driver, low_state

WALK = """
description = "one step"
compose = "lupo"
max_duration_s = 3.6
[[step]]
when = "ready"
do = "walk"
distance = 0.3
"""
FORCE = {"foot_zero": (0.0,) * 4, "foot_scale": (1.0,) * 4, "contact_on": 20.0, "contact_off": 12.0}
STATED = ("--contact-on", "20", "--contact-off", "12")


@pytest.fixture(scope="module")
def walk(tmp_path_factory: pytest.TempPathFactory) -> Sway:
    """The sensor numbers of a walk as every way can carry them: float32, and forces in whole newtons."""
    path = tmp_path_factory.mktemp("walk") / "run.mcap"
    run_local(parse_scenario(WALK), 1, recording=path)
    log = recorded_walk(path, 100)
    assert (log.raw[100:].min(axis=0) < 12.0).any()  # a foot lifts
    return log


@pytest.fixture(scope="module")
def net() -> Iterator[Net]:
    net = Net()
    yield net
    net.close()


def by_dds(log: Sway, out: Path) -> Columns:
    order = [NAMES.index(name) for name in MAKER]
    sent = [
        low_state(
            int(stamp - START_NS) // MS, log.joints[k, order].tolist(), log.gyro[k].tolist(), log.acc[k].tolist(),
            log.raw[k].astype(int).tolist(),
        ).serialize()
        for k, stamp in enumerate(log.stamp_ns)
    ]  # fmt: skip
    made = Quiet(driver(**FORCE).config)
    start = made.on_start
    made.on_start = lambda: (start(), [made.take(MemoryAsSent.deserialize(data)) for data in sent])  # type: ignore[method-assign]
    columns = ros.ran(made, out, len(sent) - 1)
    assert not made.intake.refused
    return columns


def by_topics(log: Sway, out: Path, net: Net) -> Columns:
    made, store = ros.driver(net, **FORCE), types()
    rows = messages(log, store, NAMES)
    kinds = {"/imu/data": "imu", "/feet": "feet", "/joint_states": "joints"}
    queue = sorted((stamp, i, topic, m) for i, topic in enumerate(kinds) for stamp, m in rows[topic])
    start = made.on_start
    made.on_start = lambda: (start(), [ros.feed(made, kinds[t], m, store) for _, _, t, m in queue])  # type: ignore[method-assign]
    columns = ros.ran(made, out, len(log.stamp_ns) - 1)
    assert not made.intake.refused
    return columns


def by_file(source: Path, out: Path, *words: str) -> Columns:
    with pytest.raises(SystemExit) as end:
        main(["bag", "import", str(source), "--robot", ROBOT, "-o", str(out), *STATED, *words])
    assert end.value.code == 0
    return recorded_columns(out)[0]


def test_four_ways_give_the_same_sensor_messages_and_estimates(walk: Sway, net: Net, tmp_path: Path) -> None:
    bag, table = write_ros2(tmp_path / "bag", walk, NAMES), write_csv(tmp_path / "table.csv", walk, NAMES)
    dds = by_dds(walk, tmp_path / "dds.mcap")
    others = {
        "topics": by_topics(walk, tmp_path / "topics.mcap", net),
        "bag": by_file(bag, tmp_path / "bag.mcap", "--contacts", "/feet", "--feet", ",".join(ORDER)),
        "table": by_file(table, tmp_path / "table.mcap"),
    }
    assert len(dds["published_position"]) == len(walk.stamp_ns)
    assert dds["published_flags"][-1, 0] > 0.5  # initialised
    assert 0.0 < dds["touch"].mean() < 1.0
    carried = {"gyro", "acc", "joints", "touch", "force", "stamp_ns", "joints_stamp_ns"}
    keys = {key for key in dds if key in carried or key.startswith("published_")}
    assert keys >= carried
    for way, columns in others.items():
        for key in sorted(keys):
            np.testing.assert_array_equal(dds[key], columns[key], err_msg=f"{way}: {key}")
