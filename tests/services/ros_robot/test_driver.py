"""A robot on ROS 2 as the driver: the bits of its bag, and every bad message counted by name."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from surefoot.bus.ros2 import types
from surefoot.errors import Refusal, SurefootError
from surefoot.lab.bags.fit import fitted
from surefoot.lab.bags.importing import record
from surefoot.lockstep.local import LocalSystem
from surefoot.record.columns import Columns, recorded_columns
from surefoot.robot.reader import load_robot
from surefoot.services.estimator.config import EstimatorConfig
from surefoot.services.estimator.service import EstimatorService
from surefoot.services.recorder.service import Recorder, RecorderConfig
from surefoot.services.ros_robot import service
from surefoot.services.ros_robot.service import RosRobot, RosRobotConfig
from surefoot.services.stability.config import StabilityConfig
from surefoot.services.stability.service import Stability
from tests.lab.bags.sway import MS, ORDER, PER_NEWTON, ROBOT, ZERO, messages, sway
from tests.lab.bags.test_bad_bags import log_of_rows
from tests.services.stage import Stage
from tests.surefoot.net import Net

NAMES = load_robot(ROBOT).joint_names
LAST_TICK = 150


@pytest.fixture(scope="module")
def net() -> Any:
    net = Net()
    yield net
    net.close()


def driver(net: Net, **more: Any) -> RosRobot:
    calibrated = {"foot_zero": (ZERO,) * 4, "foot_scale": (1.0 / PER_NEWTON,) * 4}
    config = {"robot": ROBOT, "router": net.address, "contacts": "/feet", "feet": ORDER, **calibrated, **more}
    return RosRobot(RosRobotConfig(contacts_type="sensor_msgs/msg/JointState", **config))


def ran(made: Any, out: Path, last_tick: int = LAST_TICK) -> Columns:
    """Return what the services recorded of the queued messages, in lockstep."""
    others = [
        EstimatorService(EstimatorConfig(robot=ROBOT)), Stability(StabilityConfig(robot=ROBOT)),
        Recorder(RecorderConfig(robot=ROBOT, path=str(out))),
    ]  # fmt: skip
    system = LocalSystem([made, *others])
    made.node.begin(tuple(each.name for each in others), "lockstep", 0.0, 1, "fail", 0)
    made.node.leader.end_tick = last_tick
    system.run_until(lambda: made.node.leader.state == "ended" and made.node.leader.all_done())
    system.close()
    return recorded_columns(out)[0]


def test_topics_that_come_twice_or_late_change_nothing(net: Net, tmp_path: Path) -> None:
    """Two publishers of each topic send the same walk, and the contacts begin 0.3 s after the others."""
    store, rows, found = types(), messages(sway(), types(), NAMES), []
    kinds = {"/imu/data": "imu", "/feet": "feet", "/joint_states": "joints"}
    queue = sorted((stamp, i, topic, m) for i, topic in enumerate(kinds) for stamp, m in rows[topic])
    begin = queue[0][0] + 300 * MS
    queue = [item for item in queue if item[2] != "/feet" or item[0] > begin]
    for times in (1, 2):
        made = driver(net, contact_on=20.0, contact_off=12.0)
        start = made.on_start
        made.on_start = lambda made=made, start=start, times=times: (  # type: ignore[method-assign]
            start(), [feed(made, kinds[t], m, store) for _, _, t, m in queue for _ in range(times)]
        )  # fmt: skip
        found.append(ran(made, tmp_path / f"{times}.mcap"))
    once, twice = found
    for key in ("published_velocity_imu", "published_position", "published_covariance", "touch", "joints"):
        np.testing.assert_array_equal(once[key], twice[key], err_msg=key)
    assert len(once["published_position"]) == LAST_TICK + 1
    assert {key: made.intake.refused[f"{key}_duplicate"] > 100 for key in ("imu", "joints")} == dict.fromkeys(
        ("imu", "joints"), True
    )


def test_messages_give_the_bits_of_the_bag(net: Net, tmp_path: Path) -> None:
    robot, store, made = load_robot(ROBOT), types(), driver(net, contact_on=20.0, contact_off=12.0)
    log = log_of_rows(sway())
    bag = fitted(log, robot)
    assert bag.contact is not None
    bag.contact = bag.contact._replace(zero=(ZERO,) * 4, scale=(1.0 / PER_NEWTON,) * 4, on=20.0, off=12.0)
    record(bag, ROBOT, tmp_path / "bag.mcap")
    rows = messages(sway(), store, NAMES)
    kinds = {"/imu/data": "imu", "/feet": "feet", "/joint_states": "joints"}
    queue = sorted((stamp, i, topic, m) for i, topic in enumerate(kinds) for stamp, m in rows[topic])
    made.on_start = lambda start=made.on_start: (start(), [feed(made, kinds[t], m, store) for _, _, t, m in queue])  # type: ignore[method-assign]
    live, recorded = ran(made, tmp_path / "live.mcap"), recorded_columns(tmp_path / "bag.mcap")[0]
    for key in ("published_velocity_imu", "published_position", "published_covariance", "touch", "joints"):
        np.testing.assert_array_equal(live[key], recorded[key][: len(live[key])], err_msg=key)
    assert len(live["published_position"]) == LAST_TICK + 1


def feed(made: RosRobot, kind: str, message: Any, store: Any) -> None:
    """Queue a message that has travelled as bytes."""
    name = message.__msgtype__
    made.take(kind, store.deserialize_cdr(store.serialize_cdr(message, name), name))


def test_bad_messages_are_counted_by_name(net: Net) -> None:
    made, store = driver(net), types()
    made.attach(Stage())
    made.on_start()
    rows = messages(sway().cut(slice(0, 20)), store, NAMES)
    imu, joints, feet = (rows[topic] for topic in ("/imu/data", "/joint_states", "/feet"))
    for kind, (_, m) in (("imu", imu[0]), ("joints", joints[0]), ("feet", feet[0]), ("imu", imu[0]), ("imu", imu[5])):
        made.take(kind, m)
    made.take("imu", imu[3][1])  # late
    imu[6][1].linear_acceleration.x = float("nan")
    made.take("imu", imu[6][1])
    joints[7][1].name[0] = "tail"
    made.take("joints", joints[7][1])
    feet[8][1].effort = np.zeros(3)
    made.take("feet", feet[8][1])
    imu[9][1].header.stamp.sec -= 3600
    made.take("imu", imu[9][1])
    made.take("broken", "/imu/data: 3 bytes are no sensor_msgs/msg/Imu")
    made.poll()
    made.on_stop()
    assert dict(made.intake.refused) == {
        "imu_duplicate": 1, "imu_late": 1, "imu_nonfinite": 1, "joints_invalid": 1, "feet_shape": 1, "clock": 1,
        "encoding": 1,
    }  # fmt: skip


@pytest.mark.parametrize(("kind", "value"), [("Float32", 1.0), ("Bool", True), ("String", "on")])
def test_contacts_that_are_one_number_or_text_are_refused(net: Net, kind: str, value: object) -> None:
    made, store = driver(net, contacts="/feet", feet=()), types()
    made.attach(Stage())
    made.on_start()
    made.take("feet", store.types[f"std_msgs/msg/{kind}"](data=value))
    made.poll()
    made.on_stop()
    assert sum(made.intake.refused.values()) == 1


def test_messages_before_the_run_are_bounded(net: Net, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(service, "MOST", 10)
    made = driver(net)
    made.attach(Stage())
    made.on_start()
    for k in range(100):
        made.take("broken", str(k))
    made.poll()
    made.on_stop()
    assert made.intake.refused == {"encoding": 10}


def test_a_foot_that_is_named_twice_is_refused(net: Net) -> None:
    with pytest.raises(SurefootError, match="more than once"):
        driver(net, feet=(*ORDER, ORDER[0])).on_start()


def test_commands_are_refused(net: Net) -> None:
    with pytest.raises(Refusal, match="sends no commands"):
        driver(net, command=True).on_start()
    assert MS > 0
