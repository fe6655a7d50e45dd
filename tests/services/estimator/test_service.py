"""The service without a bus: samples in, messages out."""

from typing import Any

import numpy as np
import pytest

from surefoot.bus.codec import decode, encode
from surefoot.lockstep.join import TickInputs
from surefoot.robot.reader import load_robot
from surefoot.schemas.base import Message
from surefoot.schemas.hw import FootContacts, Imu, JointState, Tick
from surefoot.schemas.topics import HW_CONTACTS, HW_IMU, HW_JOINTS, STATE_ODOMETRY, STATE_VELOCITY
from surefoot.services.estimator.config import EstimatorConfig
from surefoot.services.estimator.paper.estimators import ESTIMATORS
from surefoot.services.estimator.service import LATE_TICK, SERVICE, VARIANTS
from tests.services.stage import Stage

ROBOT = load_robot("ragno")
TICK, PERIOD = 10_000_000, 33_000_000


class Desk(Stage):
    """Keeps messages as they come off the wire."""

    def publish(self, topic: Any, message: Message, stamp_ns: int | None) -> None:
        super().publish(topic, decode(type(message), encode(message)[0]), stamp_ns)


@pytest.fixture
def desk():
    return Desk()


@pytest.fixture
def service(desk):
    made = SERVICE(EstimatorConfig(start_x=0.5, start_yaw=0.2))
    made.attach(desk)
    made.on_start()
    made.on_reset()
    return made


def tick(number: int, **messages: Any) -> TickInputs:
    manifest = Tick(tick=number, roster=("estimator",), roster_version=1, due=(), mode="lockstep")
    return TickInputs(manifest, {key.replace("_", "/"): value for key, value in messages.items() if value is not None})


def stand(service, n: int, first: int = 1) -> None:
    rng = np.random.default_rng(0)
    for k in range(first, first + n):
        stamp, joints, contacts = k * TICK, None, None
        if stamp // PERIOD > (stamp - TICK) // PERIOD:
            at = stamp // PERIOD * PERIOD
            joints = JointState(stamp_ns=at, position=tuple(ROBOT.neutral))
            contacts = FootContacts(stamp_ns=at, touch=((True,),) * 6, normal_force_n=(None,) * 6)
        gyro, acc = 0.005 * rng.normal(size=3), [0.0, 0.0, 9.81] + 0.03 * rng.normal(size=3)
        imu = Imu(stamp_ns=stamp, gyro=tuple(gyro), acc=tuple(acc))
        service.on_tick(tick(k, hw_imu=imu, hw_joints=joints, hw_contacts=contacts))


def test_keys_of_the_test_are_those_of_the_table():
    assert [HW_IMU.key, HW_JOINTS.key, HW_CONTACTS.key] == ["hw/imu", "hw/joints", "hw/contacts"]


def test_every_estimator_has_a_topic():
    assert set(VARIANTS) == set(ESTIMATORS)
    assert all(topic.key == f"state/velocity/{name}" for name, topic in VARIANTS.items())


def test_publishes_what_it_owes(service, desk):
    stand(service, 100)
    assert len(desk.of(STATE_VELOCITY.key)) == len(desk.of(STATE_ODOMETRY.key)) == 100
    for name, topic in VARIANTS.items():
        assert [m.mode for m in desk.of(topic.key)] == [name] * 20
    flags = [m.initialised for m in desk.of(STATE_VELOCITY.key)]
    assert flags == [False] * 49 + [True] * 51
    last = desk.of(STATE_VELOCITY.key)[-1]
    assert last.mode == "best"
    assert last.standing
    assert last.inputs_ok
    assert last.filter_ok
    assert last.sensors_ok
    pose = desk.of(STATE_ODOMETRY.key)[-1]
    assert pose.initialised
    assert pose.position[0] == pytest.approx(0.5, abs=2e-3)
    assert pose.yaw == pytest.approx(0.2, abs=5e-3)


def test_best_alone_publishes_the_same_of_itself(service, desk):
    """Without the paper's estimators beside it, it costs a quarter less and gives the same numbers."""
    lone, other = SERVICE(EstimatorConfig(start_x=0.5, start_yaw=0.2, beside=False)), Desk()
    lone.attach(other)
    lone.on_start()
    lone.on_reset()
    stand(service, 100)
    stand(lone, 100)
    assert {key for key, _ in other.sent} == {STATE_VELOCITY.key, STATE_ODOMETRY.key}
    for key in (STATE_VELOCITY.key, STATE_ODOMETRY.key):
        assert other.of(key) == desk.of(key)


def test_another_mode_than_best_needs_the_estimators_beside_it():
    with pytest.raises(ValueError, match=r"beside\n +got false with mode 'ekf', which needs true"):
        EstimatorConfig(mode="ekf", beside=False)


def test_a_missing_input_is_no_crash(service, desk):
    stand(service, 60)
    service.on_tick(tick(61))
    assert len(desk.of(STATE_VELOCITY.key)) == 61


def test_a_silent_input_is_named(service, desk):
    stand(service, 60)
    inputs = tick(61)
    inputs.late["hw/imu"] = 0.15
    service.on_tick(inputs)
    last = desk.of(STATE_VELOCITY.key)[-1]
    assert not last.inputs_ok
    assert not last.sensors_ok
    assert "hw/imu is silent for 0.1 s" in last.reasons or "hw/imu is silent for 0.2 s" in last.reasons
    service.on_tick(tick(62))
    assert not any("silent" in reason for reason in desk.of(STATE_VELOCITY.key)[-1].reasons)


def test_a_refusal_is_logged_once_and_counted(service, desk):
    stand(service, 60)
    for k in range(61, 70):
        service.on_tick(tick(k, hw_imu=Imu(stamp_ns=60 * TICK, gyro=(0.0,) * 3, acc=(0.0, 0.0, 9.8))))
    assert desk.of(STATE_VELOCITY.key)[-1].refused == 9
    assert desk.logged == ["warning: imu refused: duplicate"]


def test_a_clipped_sample_is_not_used(service, desk):
    stand(service, 60)
    service.on_tick(tick(61, hw_imu=Imu(stamp_ns=61 * TICK, gyro=(5.0, 0.0, 0.0), acc=(0.0, 0.0, 9.8), saturated=True)))
    last = desk.of(STATE_VELOCITY.key)[-1]
    assert not last.sensors_ok
    assert abs(last.roll) < 0.01


def test_a_robot_with_other_joints_is_refused(service, desk):
    stand(service, 60)
    joints = JointState(stamp_ns=61 * TICK, position=(0.0,) * 12)
    contacts = FootContacts(stamp_ns=61 * TICK, touch=((True,),) * 4, normal_force_n=(None,) * 4)
    service.on_tick(tick(61, hw_joints=joints, hw_contacts=contacts))
    assert desk.logged == ["warning: kinematics refused: shape"]


def test_a_new_epoch_starts_anew(service, desk):
    stand(service, 60)
    service.on_reset()
    stand(service, 10)
    assert not desk.of(STATE_VELOCITY.key)[-1].initialised


def test_a_restart_in_mid_run_says_that_it_is_lost(service, desk):
    stand(service, 60)
    assert desk.of(STATE_ODOMETRY.key)[-1].covariance[0] < 1e-4
    service.on_reset()
    stand(service, 60, first=LATE_TICK + 1)
    last = desk.of(STATE_ODOMETRY.key)[-1]
    assert last.initialised
    assert last.covariance[0] > 0.5


def test_the_slip_of_a_stance_is_published_once_when_it_ends(service, desk):
    stand(service, 130)
    robot, number = ROBOT, 130

    def give(q: np.ndarray, touch: list[bool], ticks: int) -> None:
        nonlocal number
        for _ in range(ticks):
            number += 1
            stamp = number * TICK
            imu = Imu(stamp_ns=stamp, gyro=(0.0, 0.0, 0.0), acc=(0.0, 0.0, 9.81))
            fresh = stamp // PERIOD > (stamp - TICK) // PERIOD
            joints = JointState(stamp_ns=stamp, position=tuple(q)) if fresh else None
            switches = tuple((closed,) for closed in touch)
            contacts = FootContacts(stamp_ns=stamp, touch=switches, normal_force_n=(None,) * 6) if fresh else None
            service.on_tick(tick(number, hw_imu=imu, hw_joints=joints, hw_contacts=contacts))

    give(robot.neutral, [True] * 6, 20)
    slid = robot.neutral.copy()
    slid[0] += 0.08  # the first leg swings on the ground
    give(slid, [True] * 6, 20)
    lifted = slid.copy()
    lifted[1] += 0.5
    give(lifted, [False] + [True] * 5, 20)
    ended = [each for message in desk.of(STATE_ODOMETRY.key) for each in message.stances]
    assert [each.foot for each in ended] == [0]
    assert 0.005 < ended[0].slip < 0.02
