"""Faults: each kind has its effect, in its time and nowhere else, and continues from a checkpoint."""

import itertools
import json
from collections.abc import Callable

import numpy as np
import pytest

from surefoot.services.simulator.physics.faults import (
    CHANNELS,
    KINDS,
    SENSORS,
    STAMPED,
    Fault,
    FaultBank,
    FaultError,
)
from surefoot.services.simulator.physics.samples import Detection
from tests.services.refusals import refused

JOINTS = ("lf_coxa", "lf_femur", "rf_coxa", "rf_femur")
LEGS = ("lf", "rf")
FEET = np.array([0, 1])
WIDE = np.full(6, 1e9)
ON = range(5, 8)  # ticks


def bank(*faults: Fault) -> FaultBank:
    found = FaultBank(JOINTS, LEGS)
    for fault in faults:
        found.add(fault)
    return found


def fault(kind: str, target: str = "", value: float = 0.0, seed: int = 0) -> Fault:
    return Fault(kind, ON[0], 0.03, target, value, seed)


def imu(found: FaultBank, tick: int, limit: np.ndarray = WIDE) -> np.ndarray | None:
    return found.imu(tick, np.full(6, float(tick)), limit.copy())


def joints(found: FaultBank, tick: int) -> np.ndarray | None:
    table = found.joints(tick, np.full(4, 1.0 * tick), np.full(4, 2.0 * tick), np.full(4, 3.0 * tick))
    return None if table is None else np.array(table)


N = 200
LOOKS = np.random.default_rng(0).standard_normal((N, 3))


def see(found: FaultBank, tick: int) -> tuple[list[Detection], Detection | None]:
    """An image of all landmarks and the marker, all of them at a distance of the tick number, m."""
    marks = [Detection(float(tick), 0.1, LOOKS[i].copy(), i) for i in range(N)]
    return found.seen(tick, marks, Detection(float(tick), 0.0, np.zeros(3), -1), LOOKS)


def test_an_empty_bank_is_false() -> None:
    assert not bank()
    assert bank(fault("imu_drop"))


@pytest.mark.parametrize("kind", KINDS)
def test_nothing_happens_outside_its_time(kind: str) -> None:
    found = bank(fault(kind, value=2.0 if kind == "sensor_slow" else 0.5))
    for tick in (1, 4, 12, 13):
        for sensor in SENSORS:
            np.testing.assert_array_equal(found.fail(tick, sensor, np.full(3, float(tick))), np.full(3, float(tick)))
        np.testing.assert_array_equal(imu(found, tick), np.full(6, float(tick)))
        np.testing.assert_array_equal(joints(found, tick)[0], np.full(4, float(tick)))  # type: ignore[index]
        assert found.contacts(tick, np.array([True, False]), FEET).tolist() == [True, False]
        assert found.packet(tick, "imu", {"x": tick}) == {"x": tick}
        np.testing.assert_array_equal(found.servo_strength(tick), np.ones(4))
        assert found.echo(tick, 1.0, 0.25) == (1.0,)
        marks, goal = see(found, tick)
        assert [mark.landmark for mark in marks] == list(range(N))
        assert all(np.array_equal(mark.descriptor, LOOKS[mark.landmark]) for mark in marks)
        assert [mark.range for mark in marks] == [float(tick)] * N
        assert goal.range == tick


@pytest.mark.parametrize(("kind", "call"), [("imu_drop", imu), ("joints_drop", joints)])
def test_drop(kind: str, call: Callable[[FaultBank, int], object]) -> None:
    found = bank(fault(kind))
    assert [tick for tick in range(12) if call(found, tick) is None] == list(ON)


def test_contacts_drop_and_stuck() -> None:
    assert bank(fault("contacts_drop")).contacts(5, np.array([True, True]), FEET) is None
    assert bank(fault("foot_stuck_on", "rf")).contacts(5, np.array([False, False]), FEET).tolist() == [False, True]
    assert bank(fault("foot_stuck_off", "lf")).contacts(5, np.array([True, True]), FEET).tolist() == [False, True]


@pytest.mark.parametrize(("kind", "call"), [("imu_freeze", imu), ("joints_freeze", joints)])
def test_freeze_repeats_the_last_good_sample(kind: str, call: Callable[[FaultBank, int], np.ndarray]) -> None:
    found = bank(fault(kind))
    seen = [float(np.ravel(call(found, tick))[0]) for tick in range(3, 10)]
    assert seen == [3, 4, 4, 4, 4, 8, 9]


def test_encoder_stuck_holds_one_position_only() -> None:
    found = bank(fault("encoder_stuck", "lf_femur"))
    for tick in range(4, 7):
        table = joints(found, tick)
    assert (table[0].tolist(), table[1].tolist()) == ([6, 4, 6, 6], [12, 12, 12, 12])


def test_bias_and_saturation_of_single_axes_or_instruments() -> None:
    np.testing.assert_array_equal(imu(bank(fault("imu_bias", "gyro", 0.5)), 5), [5, 5, 5, 5.5, 5.5, 5.5])
    np.testing.assert_array_equal(imu(bank(fault("imu_bias", "acc_z", -1.0)), 5), [5, 5, 4, 5, 5, 5])
    limit = WIDE.copy()
    y = bank(fault("imu_saturate", "acc", 3.0)).imu(5, np.array([5.0, -5.0, 1.0, 9.0, 9.0, 9.0]), limit)
    np.testing.assert_array_equal(y, [3, -3, 1, 9, 9, 9])
    assert limit[:3].tolist() == [3, 3, 3]


def test_servos() -> None:
    found = bank(fault("servo_dead", "lf_coxa"), fault("servo_weak", "rf", 0.25))
    np.testing.assert_array_equal(found.servo_strength(5), [0.0, 1.0, 0.25, 0.25])
    assert [tick for tick in range(12) if found.changes_servos(tick)] == [5, 8]


def test_packet_delay_arrives_late_with_its_content() -> None:
    found = bank(fault("packet_delay", "imu", 2.0))
    seen = [found.packet(tick, "imu", {"sent": tick}) for tick in range(3, 11)]
    assert [None if c is None else c["sent"] for c in seen] == [3, 4, None, None, 5, 8, 9, 10]
    assert found.lost == 2  # 6 and 7 arrived together with later ones


def test_packet_loss_has_its_rate_and_its_seed() -> None:
    def lost(seed: int) -> list[int]:
        found = bank(Fault("packet_loss", 0, 20.0, "", 0.3, seed))
        return [tick for tick in range(2000) if found.packet(tick, "imu", {}) is None]

    assert lost(1) == lost(1) != lost(2)
    assert 0.25 < len(lost(1)) / 2000 < 0.35


def test_packet_reorder_lets_stamps_go_back() -> None:
    found = bank(Fault("packet_reorder", 0, 2.0, "imu", 5.0, 1))
    seen = [found.packet(tick, "imu", {"sent": tick}) for tick in range(200)]
    sent = [c["sent"] for c in seen if c is not None]
    assert any(b < a for a, b in itertools.pairwise(sent))
    assert len(sent) + found.lost <= 200


def test_false_landmarks_look_like_others_and_are_where_they_are() -> None:
    found = bank(fault("landmarks_false", value=0.3))
    false = 0
    for tick in ON:
        for mark in see(found, tick)[0]:
            looks_like = int(np.argmin(np.linalg.norm(LOOKS - mark.descriptor, axis=1)))
            assert np.linalg.norm(LOOKS[looks_like] - mark.descriptor) < 1e-9
            false += looks_like != mark.landmark
            assert (mark.range, mark.bearing) == (float(tick), 0.1)
    assert false / (N * len(ON)) == pytest.approx(0.3, abs=0.06)
    assert see(bank(fault("landmarks_false", value=0.0)), ON[0])[0][0].descriptor is not None


def test_a_share_of_the_landmarks_is_dropped_the_marker_is_not() -> None:
    marks, goal = see(bank(fault("landmarks_drop", value=0.75)), ON[0])
    assert len(marks) == pytest.approx(0.25 * N, abs=25)
    assert goal is not None
    assert see(bank(fault("landmarks_drop", value=1.0)), ON[0])[0] == []


def test_a_dark_camera_sees_nothing_and_a_frozen_one_what_it_saw() -> None:
    assert see(bank(fault("camera_dark")), ON[0]) == ([], None)
    found = bank(fault("camera_freeze"))
    ranges = [see(found, tick)[0][0].range for tick in range(3, 10)]
    assert ranges == [3, 4, 4, 4, 4, 8, 9]
    found = bank(fault("camera_freeze"))
    found.seen(4, [], None, LOOKS)
    assert see(found, 5) == ([], None)


def test_ultrasound_that_is_lost_or_stuck_at_its_shortest() -> None:
    lost, stuck = bank(fault("range_drop")), bank(fault("range_stuck"))
    assert [tick for tick in range(12) if lost.echo(tick, 1.0, 0.25) is None] == list(ON)
    assert [tick for tick in range(12) if stuck.echo(tick, None, 0.25) == (0.25,)] == list(ON)


def test_state_continues_to_the_bit() -> None:
    kinds = (
        ("imu_freeze", "", 0.0), ("packet_delay", "imu", 3.0), ("packet_loss", "joints", 0.5),
        ("landmarks_false", "", 0.5), ("landmarks_drop", "", 0.5), ("camera_freeze", "", 0.0),
    )  # fmt: skip
    found = bank(*(Fault(kind, 2, 1.0, target, value, 4) for kind, target, value in kinds))

    def ahead(faults: FaultBank, begin: int) -> list[object]:
        out: list[object] = []
        for tick in range(begin, begin + 20):
            out.append(np.ravel(imu(faults, tick)).tolist())
            out.append(str(see(faults, tick)))
            out += [faults.packet(tick, channel, {"n": tick}) for channel in ("imu", "joints")]
        return out

    ahead(found, 0)
    saved = json.loads(json.dumps(found.state()))
    again = bank()
    again.restore(saved)
    assert ahead(again, 20) == ahead(found, 20)


@pytest.mark.parametrize("sensor", SENSORS)
def test_each_sensor_fails_in_seven_ways(sensor: str) -> None:
    def seen(kind: str, value: float = 0.0) -> list[float | None]:
        found = bank(fault(f"sensor_{kind}", sensor, value))
        rows = [found.fail(tick, sensor, np.array([tick, 1.0, tick, 1.0, tick, 1.0])) for tick in range(3, 10)]
        return [None if row is None else float(row[0]) for row in rows]

    assert seen("off") == [3, 4, None, None, None, 8, 9]
    assert seen("stuck") == [3, 4, 4, 4, 4, 8, 9]
    assert seen("wrong", -1.0) == [3, 4, -5, -6, -7, 8, 9]
    assert seen("slow", 2.0) == [3, 4, 5, None, 7, 8, 9]
    assert seen("intermittent", 1.0) == seen("off")
    garbage = seen("garbage")
    assert garbage == seen("garbage")
    assert garbage[:2] == [3, 4]
    assert len({5.0, 6.0, 7.0, *garbage[2:5]}) == 6
    other = next(name for name in SENSORS if name != sensor)
    assert bank(fault("sensor_off", sensor)).fail(5, other, np.ones(1)) is not None


def test_a_delayed_sensor_keeps_its_stamps() -> None:
    found = bank(fault("sensor_delayed", "imu", 2.0))
    seen = [found.packet(tick, "imu", {"sent": tick}) for tick in range(3, 11)]
    assert [None if c is None else c["sent"] for c in seen] == [3, 4, None, None, 5, 8, 9, 10]


@pytest.mark.parametrize("kind", KINDS)
def test_only_packets_of_a_faults_own_channel_are_late_or_lost(kind: str) -> None:
    """Faults of a joint, leg or sensor leave the lines as they are, whatever their number in the lists of names."""
    lines = CHANNELS if kind.startswith("packet") else STAMPED if kind == "sensor_delayed" else ()
    for target in ("", *lines):
        for channel in CHANNELS:
            found = bank(fault(kind, target, 2.0 if kind == "sensor_slow" else 1.0))
            touched = channel in lines and target in ("", channel)
            assert found.packet(ON[0], channel, {"sent": 1}) == (None if touched else {"sent": 1})
            assert found.packet(ON[-1] + 3, channel, {"sent": 2}) == {"sent": 2}


@pytest.mark.parametrize("kind", [kind for kind in KINDS if not kind.startswith("sensor")])
def test_faults_of_other_kinds_let_no_sensor_fail(kind: str) -> None:
    for sensor in SENSORS:
        row = np.arange(6.0)
        assert bank(fault(kind, value=1.0)).fail(ON[0], sensor, row) is row


def test_a_sensor_that_a_robot_lacks_is_refused_with_those_that_it_has() -> None:
    found = FaultBank(JOINTS, LEGS, ("imu", "joints", "contacts"))
    with pytest.raises(FaultError, match="'landmarks', known are imu, joints, contacts"):
        found.add(Fault("sensor_off", 0, 1.0, "landmarks"))
    for kind in ("camera_dark", "camera_flip", "landmarks_drop", "range_drop"):
        with pytest.raises(FaultError, match=f"{kind} goes with"):
            found.add(Fault(kind, 0, 1.0))


@pytest.mark.parametrize(
    ("made", "field"),
    [
        (Fault("sensor_off", 0, 1.0, "gps"), "target"),
        (Fault("sensor_delayed", 0, 1.0, "landmarks", 2.0), "target"),
        (Fault("sensor_slow", 0, 1.0, "imu", 1.0), "value"),
        (Fault("meltdown", 0, 1.0), "kind"),
        (Fault("imu_drop", 0, 0.0), "duration"),
        (Fault("imu_drop", 0, float("nan")), "duration"),
        (Fault("imu_drop", 0, float("inf")), "duration"),
        (Fault("imu_drop", 0, 1.0, "left"), "target"),
        (Fault("servo_dead", 0, 1.0, "tail"), "target"),
        (Fault("servo_weak", 0, 1.0, "", 1.5), "value"),
        (Fault("packet_loss", 0, 1.0, "imu", float("nan")), "value"),
        (Fault("landmarks_false", 0, 1.0, "", 1.1), "value"),
        (Fault("camera_dark", 0, 1.0, "left"), "target"),
    ],
)
def test_refusals_name_the_field(made: Fault, field: str) -> None:
    with refused(FaultError, field=field):
        bank(made)


def test_an_unknown_kind_is_refused_with_the_known_ones() -> None:
    with pytest.raises(FaultError, match=f"got 'meltdown', known are {', '.join(KINDS)}"):
        bank(Fault("meltdown", 0, 1.0))
