"""Planted errors of legs, stamps and mounting are found, with intervals that hold; the rest is not observable."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from surefoot.geometry.rotations import matrix_from_rotvec
from surefoot.lab.estimation.calibrate import LegCalibration, calibrate, offset_note, proven
from surefoot.lab.estimation.legs import LegModel, lengths_alike, unknowns_of
from surefoot.lab.estimation.log import Log
from surefoot.lab.estimation.scores import score
from surefoot.lab.estimation.stances import StanceNoise, stance_windows
from surefoot.lab.estimation.track import track
from surefoot.lab.estimation.walks import walk
from surefoot.papers.wawrzynski.synthetic import KINDS, synthesize
from surefoot.robot.reader import load_robot
from surefoot.services.estimator.feet.mount import feet_in_imu, foot_mount
from tests.lab.estimation.walks import noisy

SEEDS = range(10)
SHORT = replace(KINDS["twist"], duration_s=12.0, encoders=False)


def found(calibration: LegCalibration) -> dict[str, tuple[float, float, bool]]:
    return {one.name: (one.value, one.half, one.observable) for one in calibration.found()}


def longer(log: Log, factor: float) -> Log:
    return replace(log, foot_position=log.foot_position * factor, joints=None)


def turned(log: Log, degrees: np.typing.ArrayLike) -> Log:
    rot = matrix_from_rotvec(np.radians(np.asarray(degrees, dtype=np.float64)))
    return replace(log, foot_position=log.foot_position @ rot.T, foot_rot=rot @ log.foot_rot)


@cache
def nao() -> Log:
    return walk("nao", 0).log


@cache
def nao_calibration() -> LegCalibration:
    return calibrate(nao())


@pytest.mark.parametrize("factor", [0.95, 1.05])
def test_the_length_of_legs_is_found(factor):
    seen = found(calibrate(longer(noisy(), factor)))
    for leg in range(2):
        value, half, observable = seen[f"length of leg {leg}"]
        assert observable
        assert half < 3.0
        assert value == pytest.approx(100.0 * (1.0 / factor - 1.0), abs=half)


def test_one_leg_alone_may_be_wrong():
    log = noisy()
    scaled = log.foot_position * np.array([1.0, 1.05])[:, None]
    seen = found(calibrate(replace(log, foot_position=scaled)))
    assert seen["length of leg 0"][0] == pytest.approx(0.0, abs=seen["length of leg 0"][1])
    assert seen["length of leg 1"][0] == pytest.approx(-4.76, abs=seen["length of leg 1"][1])


def test_legs_that_err_alike_are_corrected_by_one_length_and_others_by_their_own():
    log = noisy()
    assert [one.name for one in proven(calibrate(longer(log, 1.05))).found()] == ["length of all legs"]
    one = replace(log, foot_position=log.foot_position * np.array([1.0, 1.08])[:, None], joints=None)
    assert [one.name for one in proven(calibrate(one)).found()] == ["length of leg 1"]


@pytest.mark.parametrize("ms", [-20, 20])
def test_a_time_offset_is_found_to_3_ms_and_noted(ms):
    log = noisy()
    late = replace(log, foot_ns=log.foot_ns + ms * 1_000_000)
    value, half, observable = found(calibrate(late))["time offset of the feet"]
    assert observable
    assert value == pytest.approx(-ms, abs=min(half, 3.0))
    (note,) = offset_note(late)
    assert f"too {'late' if ms > 0 else 'early'}" in note
    assert not offset_note(log)


@pytest.mark.parametrize("axis", range(3))
def test_the_mounting_of_the_inertial_unit_is_found(axis):
    degrees = np.zeros(3)
    degrees[axis] = 3.0
    seen = found(calibrate(turned(noisy(), degrees)))
    for i, name in enumerate("xyz"):
        value, half, _ = seen[f"mounting about {name}"]
        assert value == pytest.approx(-degrees[i], abs=half + 0.1)  # turns about two axes do not commute
    assert seen[f"mounting about {'xyz'[axis]}"][2]


def test_intervals_of_95_percent_hold():
    inside = np.array(
        [
            [abs(value) <= half for value, half, _ in found(calibrate(synthesize(SHORT, seed))).values()]
            for seed in SEEDS
        ]
    )
    assert inside.mean() >= 0.9
    assert inside.mean(axis=0).min() >= 0.7


def test_a_log_that_only_stands_shows_nothing():
    log = noisy()
    rest = log.seconds < 2.0
    still = log.with_imu(rest).with_feet(log.foot_ns < log.stamp_ns[rest][-1])
    done = calibrate(still)
    seen = found(done)
    assert len(seen) == 9
    assert not any(observable for _, _, observable in seen.values())
    assert not proven(done).found()


def test_a_log_without_stances_shows_nothing():
    log = noisy()
    none = replace(log, contact=np.zeros_like(log.contact))
    done = calibrate(none)
    assert done.windows == 0
    assert not any(one.observable for one in done.found())
    assert not proven(done).found()
    assert not offset_note(none)


@pytest.mark.parametrize(("kind", "factor"), [("twist", 0.95), ("slip", 1.05)])
def test_a_corrected_log_is_as_good_as_the_right_one(kind, factor):
    log = noisy(kind, 3)
    as_it_was = score(log, track("best", log)).smooth
    mended = proven(calibrate(longer(log, factor))).apply()
    assert score(mended, track("best", mended)).smooth <= 1.2 * as_it_was


def test_what_is_right_is_left_alone():
    for seed in range(3):
        assert not proven(calibrate(noisy("twist", seed))).found()


def test_offsets_of_loads_and_one_window_prove_nothing():
    log = noisy()
    late = replace(log, foot_ns=log.foot_ns + 2_000_000)
    done = calibrate(late)
    value, _, observable = found(done)["time offset of the feet"]
    assert observable
    assert value == pytest.approx(-2.0, abs=1.0)
    assert not proven(done).found()
    later = calibrate(replace(log, foot_ns=log.foot_ns + 20_000_000))
    assert [one.name for one in proven(later).found()] == ["time offset of the feet"]
    part = (log.seconds > 6.0) & (log.seconds < 8.5)
    first, last = log.stamp_ns[part][[0, -1]]
    inside = (late.foot_ns >= first) & (late.foot_ns <= last)
    once = calibrate(replace(late, joints=None).with_imu(part).with_feet(inside))
    assert once.windows == 1
    assert not any(one.observable for one in once.found())


def test_apply_undoes_offset_and_turn():
    log = noisy()
    wrong = turned(replace(log, foot_ns=log.foot_ns + 20_000_000), (3.0, 0.0, 0.0))
    mended = proven(calibrate(wrong)).apply()
    np.testing.assert_allclose(mended.foot_ns, log.foot_ns, atol=3_000_000)
    assert np.abs(mended.foot_position - log.foot_position).max() < 0.004
    seen = np.einsum("ij,mfj->mfi", mended.rot_base_from_imu, mended.foot_position) + mended.imu_position
    there = np.einsum("ij,mfj->mfi", wrong.rot_base_from_imu, wrong.foot_position) + wrong.imu_position
    np.testing.assert_allclose(seen, there, atol=1e-9)  # legs stay where they are in the body: the unit has moved


def test_a_joint_zero_is_found_by_two_standing_feet():
    log, joint = nao(), load_robot("nao").joint_names.index("left_leg_hip_yaw_pitch")
    assert log.joints is not None
    planted = log.joints.copy()
    planted[:, joint] += np.radians(2.0)
    name = "zero of left_leg_hip_yaw_pitch"
    value, half, observable = found(calibrate(replace(log, joints=planted)))[name]
    assert observable
    assert value - found(nao_calibration())[name][0] == pytest.approx(-2.0, abs=half)


def test_links_of_a_robot_are_asked_for_by_name():
    names = [one.name for one in nao_calibration().found()]
    assert "length to left_leg_ankle_pitch" in names
    assert "zero of right_leg_knee_pitch" in names
    assert len(names) == len(set(names))


def test_one_length_for_all_legs_is_every_single_one():
    log = nao()
    single = [u for u in unknowns_of(log) if u.kind == "length"]
    rows = np.arange(0, len(log.foot_ns), 50)
    alike, _ = LegModel(log, lengths_alike(single)).feet(np.array([0.05]), rows)
    each, _ = LegModel(log, single).feet(np.full(len(single), 0.05), rows)
    np.testing.assert_allclose(alike, each, atol=1e-12)


def test_the_likelihood_is_that_of_the_whitened_residuals():
    noise, rng = StanceNoise(2e-3, 1e-3, 5e-3, 1e-3), np.random.default_rng(0)
    for window in stance_windows(noisy())[:3]:
        y = rng.normal(size=(2, len(window.s), 3))
        whole = [0.5 * np.sum((window.whitener(noise) @ each) ** 2) for each in y]
        ours = [window.misfit(noise, each) for each in y]
        assert ours[1] - ours[0] == pytest.approx(whole[1] - whole[0], rel=1e-6)
        wider = window.misfit(StanceNoise(*(2.0 * x for x in noise)), y[0])  # the covariance 4 times as large
        free = len(window.s) - len(window.whitener(noise))
        grown = 3.0 * (len(window.s) - free) * np.log(2.0)
        assert wider - ours[0] == pytest.approx(grown - 0.75 * whole[0], rel=1e-6)


def test_feet_of_many_rows_are_those_of_each():
    log, rows = nao(), np.arange(0, 400, 40)
    assert log.joints is not None
    position, rot = LegModel(log, []).feet(np.zeros(0), rows)
    each = [feet_in_imu(foot_mount(load_robot("nao")), q) for q in log.joints[rows]]
    np.testing.assert_allclose(position, [p for p, _ in each], atol=1e-12)
    np.testing.assert_allclose(rot, [r for _, r in each], atol=1e-12)


def test_a_gap_and_missing_numbers_are_left_out():
    log = noisy()
    feet, gyro = log.foot_position.copy(), log.w.copy()
    feet[100:110, 0] = np.nan
    gyro[900] = np.nan
    holed = replace(log, foot_position=feet, w=gyro).with_imu(np.abs(log.seconds - 15.0) > 0.5)
    for value, half, _ in found(calibrate(holed)).values():
        assert np.isfinite([value, half]).all()
        assert abs(value) < 2.0 * half + 0.1
