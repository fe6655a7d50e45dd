"""Motions that no walk of ours makes: swaying against the roll, hopping, running, being carried."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from surefoot.errors import SurefootError
from surefoot.estimation import estimator
from surefoot.geometry.constants import GRAVITY
from surefoot.lab.estimation.log import Log
from surefoot.lab.estimation.track import LogRunner, track
from surefoot.lab.estimation.units import check_units, turned_by_feet
from surefoot.robot.reader import load_robot
from surefoot.services.estimator.output import OdometryPose
from surefoot.services.estimator.params import EstimatorParams, at_rate
from tests.lab.estimation.rigid import CORNERS, HEIGHT, all_closed, columns, logged, smooth, standing


def swaying(way: float) -> Log:
    """A trunk that rolls by 0.03 rad at 1.2 Hz and sways by `way`, m, so that its acceleration shows the other side."""
    wave = 2.0 * np.pi * 1.2

    def sway(t: np.ndarray) -> np.ndarray:
        return columns(0.0, way * np.sin(wave * t), HEIGHT)

    return logged(12.0, sway, lambda t: columns(0.03 * np.sin(wave * t), 0.0, 0.0), standing, all_closed)


@pytest.mark.parametrize("way", [-0.02, 0.0, 0.006, 0.02])
def test_a_trunk_that_sways_against_its_roll_is_no_gyro_of_the_other_sign(way: float) -> None:
    log = swaying(way)
    assert turned_by_feet(log) > 0.9
    check_units(log)
    with pytest.raises(SurefootError, match=r"gravity turns against gyro: multiply by -1"):
        check_units(replace(log, w=-log.w))


def test_feet_that_never_stand_together_decide_nothing() -> None:
    log = swaying(0.0)
    assert turned_by_feet(replace(log, contact=np.zeros_like(log.contact))) == 0.0
    alone = np.zeros_like(log.contact)
    alone[:, 2] = True
    assert turned_by_feet(replace(log, contact=alone)) == 0.0


def test_one_sole_decides_by_its_own_axes() -> None:
    log, wave = swaying(0.02), 2.0 * np.pi * 1.2
    roll = 0.03 * np.sin(wave * 1e-9 * log.foot_ns)
    rot = Rotation.from_rotvec(columns(roll, 0.0, 0.0)).inv().as_matrix()
    alone = np.zeros_like(log.contact)
    alone[:, 1] = True
    sole = replace(log, contact=alone, foot_rot=np.repeat(rot[:, None], 4, axis=1))
    assert turned_by_feet(sole) > 0.9
    assert turned_by_feet(replace(sole, w=-sole.w)) < -0.9


FLIGHT_S, STAND_S = 0.3, 0.2


def hopping(t: np.ndarray) -> np.ndarray:
    """Height of a trunk that hops on the spot after 1 s: it flies for 0.3 s, and its legs catch it in 0.2 s."""
    phase = np.mod(np.maximum(t - 1.0, 0.0), FLIGHT_S + STAND_S)
    up = 0.5 * GRAVITY * phase * (FLIGHT_S - phase)
    part = np.pi * (phase - FLIGHT_S) / STAND_S
    down = -0.5 * GRAVITY * FLIGHT_S * STAND_S / np.pi * np.sin(np.clip(part, 0.0, np.pi))
    return columns(0.0, 0.0, HEIGHT + np.where(phase < FLIGHT_S, up, down) * (t > 1.0))


def hops(t: np.ndarray) -> np.ndarray:
    """Contacts of four feet that hop."""
    flies = (np.mod(np.maximum(t - 1.0, 0.0), FLIGHT_S + STAND_S) < FLIGHT_S) & (t > 1.0)
    return np.broadcast_to(~flies[:, None], (len(t), 4))


def lifted(t: np.ndarray) -> np.ndarray:
    """Places of these feet: on the ground, or hanging below the trunk."""
    return np.where(hops(t)[:, :, None], standing(t), np.nan)


def test_a_robot_that_hops_has_an_accelerometer_in_the_right_unit() -> None:
    log = logged(12.0, hopping, lambda t: columns(0.02 * np.sin(3.0 * t), 0.0, 0.1 * t), lifted, hops)
    assert np.median(np.linalg.norm(log.q, axis=1)) < 0.5 * GRAVITY  # most of the time it flies
    check_units(log)
    found = track("best", log)
    assert not found.refused.get("imu_unit")
    with pytest.raises(SurefootError, match=r"acc is .* wanted is about 9.81"):
        check_units(replace(log, q=log.q / GRAVITY))


STEP_S = 0.25


def test_a_robot_that_runs_is_followed_at_its_speed() -> None:
    most = 3.5

    def ahead(t: np.ndarray) -> np.ndarray:
        ramp = np.clip(t - 2.0, 0.0, None)
        return np.where(ramp < most, 0.5 * ramp**2, most * (ramp - 0.5 * most))

    def lands(t: np.ndarray) -> np.ndarray:  # diagonal pairs take turns, each lands where its trunk is half a step on
        places = np.empty((len(t), 4, 3))
        for f, corner in enumerate(CORNERS):
            first = 2.0 * STEP_S * np.floor((t - STEP_S * (f in (1, 2))) / (2.0 * STEP_S)) + STEP_S * (f in (1, 2))
            places[:, f] = corner + columns(ahead(first + 0.5 * STEP_S), 0.0, 0.0)
        return np.where(pairs(t)[:, :, None], places, np.nan)

    def pairs(t: np.ndarray) -> np.ndarray:
        second = np.mod(np.floor(t / STEP_S), 2) == 1
        own = np.stack([~second, second, second, ~second], axis=1)
        return own | (t < 2.0)[:, None]

    def stands_first(t: np.ndarray) -> np.ndarray:
        return np.where((t < 2.0)[:, None, None], standing(t), lands(t))

    log = logged(
        8.0, lambda t: columns(ahead(t), 0.0, HEIGHT), lambda t: columns(0.01 * np.sin(9.0 * t), 0.0, 0.0),
        stands_first, pairs,
    )  # fmt: skip
    found, fast = track("best", log), log.seconds > 6.0
    assert np.linalg.norm(found.v_odom[fast] - [most, 0.0, 0.0], axis=1).max() < 0.1
    assert found.flags["filter_ok"][log.seconds > 1.0].all()


CARRIED = (4.0, 12.0)


@pytest.mark.parametrize("turn", [0.8, -2.5])
def test_a_robot_that_is_carried_keeps_its_heading_and_does_not_stand(turn: float) -> None:
    """It hangs with still legs and open switches; switches that never close are another thing, see `test_switches`."""
    up, down = CARRIED

    def way(t: np.ndarray) -> np.ndarray:
        part = smooth((t - up) / (down - up))
        return columns(1.5 * part, 0.0, HEIGHT + 0.4 * smooth(t - up) * smooth(down - t))

    def hangs(t: np.ndarray) -> np.ndarray:
        return np.broadcast_to(((t <= up) | (t >= down))[:, None], (len(t), 4))

    def places(t: np.ndarray) -> np.ndarray:
        after = Rotation.from_rotvec([0.0, 0.0, turn]).apply(CORNERS) + np.array((1.5, 0.0, 0.0))
        ground = np.where((t >= down)[:, None, None], after, standing(t))
        return np.where(hangs(t)[:, :, None], ground, np.nan)

    def turned(t: np.ndarray) -> np.ndarray:
        swing = 0.05 * smooth(t - up) * smooth(down - t) * np.sin(2.0 * t)
        return columns(swing, 0.0, turn * smooth((t - up) / (down - up)))

    log = logged(16.0, way, turned, places, hangs)
    found, t = track("best", log), log.seconds
    held = (t > up + 2.0) & (t < down - 0.02)
    assert not found.flags["standing"][held].any()
    assert not found.flags["filter_ok"][held].any()
    assert np.degrees(found.yaw[-1] - turn) == pytest.approx(0.0, abs=3.0)
    assert found.gyro_bias is not None
    assert found.gyro_bias[-1] == pytest.approx([0.01, -0.006, 0.004], abs=0.003)
    assert found.flags["filter_ok"][-1]
    assert found.flags["sensors_ok"][-1]


def tilts(t: np.ndarray) -> np.ndarray:
    """Rotation vector of a trunk that rolls and pitches while it trots, rad."""
    wave = np.pi / STEP_S
    return columns(0.03 * smooth(t - 3.0) * np.sin(wave * t), 0.02 * smooth(t - 3.0) * np.sin(2.0 * wave * t), 0.0)


def trotted(speed: float, t: np.ndarray) -> np.ndarray:
    """Way of a trot that begins after 3 s and speeds up over 3 s, m."""
    t = np.clip(t - 3.0, 0.0, None)
    part = np.minimum(t / 3.0, 1.0)
    return speed * (3.0 * (part**3 - 0.5 * part**4) + np.maximum(t - 3.0, 0.0))


def trotting(speed: float, seconds: float, sink: float = 0.0, slope: float = 0.0) -> Log:
    """A trot in diagonal pairs that begins after 3 s: feet rise by 5 cm, swing, land at rest and sink by `sink`, m.

    The ground rises by `slope` metres a metre along x; the trunk keeps its height over it and does not pitch with it.
    """

    def ahead(t: np.ndarray) -> np.ndarray:
        return trotted(speed, t)

    def steps(t: np.ndarray, f: int) -> tuple[np.ndarray, np.ndarray]:  # begin of its latest step, and what is over
        late = STEP_S * (f in (1, 2))
        begin = late + 2.0 * STEP_S * np.floor((t - late) / (2.0 * STEP_S))
        return begin, t - begin

    def stands(t: np.ndarray) -> np.ndarray:
        return np.stack([(steps(t, f)[1] < STEP_S) | (t < 3.0) for f in range(4)], axis=1)

    def places(t: np.ndarray) -> np.ndarray:
        out = np.empty((len(t), 4, 3))
        for f, corner in enumerate(CORNERS):
            begin, since = steps(t, f)
            now, then = ahead(begin + 0.5 * STEP_S), ahead(begin + 2.5 * STEP_S)
            part, walks = np.clip(since / STEP_S - 1.0, 0.0, 1.0) * (t >= 3.0), begin + 0.5 * STEP_S > 3.0
            low = sink * walks * (1.0 - np.exp(-np.minimum(since, STEP_S) / 0.1)) * (1.0 - smooth(part))
            high = 0.05 * np.sin(np.pi * part) ** 2 - low
            out[:, f] = corner + columns(now + (then - now) * smooth(part), 0.0, high)
        out[:, :, 2] += slope * out[:, :, 0]
        return out

    return logged(seconds, lambda t: columns(ahead(t), 0.0, HEIGHT + slope * ahead(t)), tilts, places, stands)


@pytest.mark.parametrize("speed", [0.5, 1.8])
def test_switches_of_a_fast_trot_are_not_wrong(speed: float) -> None:
    """Level motion of a swing still counts after a foot has landed, so that it is limited beside the vertical."""
    log = trotting(speed, 16.0)
    found, walks = track("best", log), log.seconds > 3.0
    assert found.flags["sensors_ok"][walks].mean() > 0.95
    assert np.linalg.norm(found.v_odom[-400:] - [speed, 0.0, 0.0], axis=1).max() < 0.1


@pytest.mark.parametrize("sink", [0.005, 0.01, 0.015])
def test_feet_that_sink_do_not_lift_the_robot(sink: float) -> None:
    log, runner = trotting(0.5, 20.0, sink), LogRunner("best", trotting(0.5, 20.0, sink), {})
    found, late = track("best", log), log.seconds > 8.0
    assert abs(found.position[-1, 2] - found.position[log.seconds < 2.0, 2][-1]) < 0.03
    off = found.v_odom[late] - [0.5, 0.0, 0.0]
    assert 100.0 * np.sqrt((off**2).sum(1).mean()) < 1.5
    up = found.g[late] / GRAVITY
    rolls = Rotation.from_rotvec(columns(*tilts(log.seconds[late]).T)).inv().apply([0.0, 0.0, 1.0])
    assert np.degrees(np.sqrt(((up - rolls) ** 2).sum(1).mean())) < 0.6
    n = len(log.stamp_ns)
    for at in log.arrival():
        if at < n:
            runner.imu(int(log.stamp_ns[at]), log.w[at], log.q[at])
        else:
            row = at - n
            runner.feet(int(log.foot_ns[row]), log.foot_position[row], log.foot_rot[row], log.contact[row])
    assert any(reason.startswith("feet sink by") for reason in runner.estimate().reasons)


def turned_slowly() -> Log:
    """Four feet that stand while the trunk turns by 0.32 rad in 8 s; 1000 inertial samples a second."""

    def turns(t: np.ndarray) -> np.ndarray:  # 0.04 rad/s: the feet move by 0.5 mm in 50 samples
        return columns(0.0, 0.0, 0.04 * np.clip(t - 2.0, 0.0, 8.0))

    return logged(12.0, lambda t: columns(0.0 * t, 0.0, HEIGHT), turns, standing, all_closed, period_s=0.001)


def test_a_robot_that_turns_slowly_is_not_at_rest_for_a_fast_inertial_unit() -> None:
    log = turned_slowly()
    found = track("best", replace(log, sensors={"imu_period_ns": 1_000_000, "kinematics_period_ns": 2_000_000}))
    assert found.pose is not None
    assert found.yaw[-1] == pytest.approx(0.32, abs=3.0 * np.sqrt(found.pose[-1, 5, 5]))
    assert found.yaw[-1] == pytest.approx(0.32, abs=0.01)


def fed(log: Log, asked_every: int) -> OdometryPose:
    """The pose by an estimator that is fed sample by sample and asked for its pose every so many and at the end."""
    live = estimator(feet=4, imu_hz=1000.0)
    feet = iter(zip(log.foot_ns.tolist(), log.foot_position, log.foot_rot, log.contact, strict=True))
    for i, (stamp, w, q) in enumerate(zip(log.stamp_ns.tolist(), log.w, log.q, strict=True)):
        live.imu(stamp, w, q)
        if stamp % 2_000_000 == 0:
            live.feet(*next(feet))
        if i % asked_every == asked_every - 1:
            live.pose()
    return live.pose()


def test_an_estimator_that_is_not_asked_loses_no_sample() -> None:
    log = turned_slowly()
    pose, often = fed(log, 10**9), fed(log, 100)
    assert pose.yaw == often.yaw == pytest.approx(0.32, abs=0.01)
    assert (pose.position == often.position).all()


def test_parameters_of_another_rate_have_the_same_noise_density() -> None:
    params = EstimatorParams.from_robot(load_robot("ragno"))
    assert at_rate(params, 100.0) == params
    assert at_rate(params, 400.0).sigma_w == pytest.approx(2.0 * params.sigma_w)
    with pytest.raises(SurefootError, match="imu_hz: got 0"):
        estimator(feet=4, imu_hz=0.0)
