"""Numbers of invented runs whose answers are known."""

import math

import pytest

from surefoot.lab.report.judge import METRICS, judge, measure, variants
from surefoot.lab.report.traces import Traces
from surefoot.services.supervisor.scenarios.limits import LIMITS


def test_a_straight_walk(invented):
    verdict = judge(invented.walk(601, 0.25), {"no_fall": 0.0, "min_distance_m": 1.4}, wall_s=0.5)
    assert verdict.ok
    assert verdict.value("distance_m") == pytest.approx(1.5)
    assert verdict.value("max_tilt_deg") == pytest.approx(math.degrees(0.08), rel=1e-3)
    assert verdict.value("odometry_error_m") == pytest.approx(math.hypot(0.03, 0.015), abs=0.01)
    assert verdict.value("min_margin_m") == pytest.approx(0.02, abs=1e-3)
    assert verdict.value("real_time_factor") == pytest.approx(12.0)
    assert verdict.value("ticks") == 601
    assert verdict.value("fell") == 0.0


def test_each_limit_can_fail(invented):
    traces = invented.walk(200)
    values = measure(traces, wall_s=1.0)
    for name, limit in LIMITS.items():
        value = values[limit.metric]
        beyond = -1.0 if limit.yes_no else value + (1.0 if limit.side == "least" else -1.0)
        verdict = judge(traces, {name: beyond}, wall_s=1.0)
        assert not verdict.ok, name
        assert [row.name for row in verdict.rows if row.ok is False] == [limit.metric]


def test_every_metric_is_measured_and_every_limit_has_one(invented):
    assert set(measure(invented.walk(200), wall_s=1.0)) == set(METRICS)
    assert {limit.metric for limit in LIMITS.values()} <= set(METRICS)


def test_goals_are_judged_by_the_truth(invented):
    traces = invented.walk(600)
    values = measure(traces)
    assert values["goals_missed"] == 0.0
    assert values["goal_error_m"] == pytest.approx(0.05, abs=0.005)
    assert values["goal_time_s"] == pytest.approx(5.9)
    assert values["recoveries"] == 1.0
    assert 0.5 < values["pose_nees"] < 1.2
    assert 93.0 < values["pose_inside"] <= 100.0
    assert len(traces.goals) == 1
    assert len(traces.choices) == 6


def test_a_failed_goal_is_missed(invented):
    traces = invented.walk(100)
    fresh = Traces()
    fresh.feed("sim/truth", invented.truth(0))
    fresh.feed("navigator/feedback", invented.feedback(0, 1.0))
    fresh.feed("navigator/feedback", invented.feedback(10, 1.0, done=True, error="lost"))
    assert measure(fresh)["goals_missed"] == 1.0
    assert "goal_error_m" not in measure(fresh)
    assert not judge(fresh, {"all_goals": 0.0}).ok
    assert judge(traces, {"all_goals": 0.0}).ok


def test_a_limit_on_something_unknown_is_not_met():
    verdict = judge(Traces(), {"min_margin_m": 0.0})
    assert not verdict.ok
    assert next(row.text for row in verdict.rows if row.name == "min_margin_m") == "-"


def test_a_problem_fails_a_run_whose_numbers_are_fine(invented):
    assert not judge(invented.walk(100), {}, problems=("walker died",)).ok


def test_slip_is_per_finished_stance(invented):
    traces = Traces()
    traces.feed("sim/truth", invented.truth(0))
    traces.feed("sim/truth", invented.truth(1, stances=(1, 0, 0, 0, 0, 0), sliding=(2e-3, 9.0, 0, 0, 0, 0)))
    traces.feed("sim/truth", invented.truth(2, stances=(1, 0, 0, 0, 0, 0), sliding=(2e-3, 9.0, 0, 0, 0, 0)))
    traces.feed("sim/truth", invented.truth(3, stances=(2, 1, 0, 0, 0, 0), sliding=(4e-3, 6e-3, 0, 0, 0, 0)))
    values = measure(traces)
    assert values["mean_slip_mm"] == pytest.approx(4.0)
    assert values["max_slip_mm"] == pytest.approx(6.0)


def test_twist_is_the_worst_of_either_sign_and_point_feet_have_none(invented):
    traces = Traces()
    traces.feed("sim/truth", invented.truth(0))
    traces.feed("sim/truth", invented.truth(1, stances=(1, 0, 0, 0, 0, 0), twist=(0.02, 9.0, 0, 0, 0, 0)))
    traces.feed("sim/truth", invented.truth(2, stances=(1, 1, 0, 0, 0, 0), twist=(9.0, -0.05, 0, 0, 0, 0)))
    assert measure(traces)["max_twist_deg"] == pytest.approx(math.degrees(0.05))
    assert judge(traces, {"min_twist_deg": 2.0, "max_twist_deg": 3.0}).ok
    assert not judge(traces, {"min_twist_deg": 3.0}).ok
    points = Traces()
    points.feed("sim/truth", invented.truth(0))
    points.feed("sim/truth", invented.truth(1, stances=(1, 0, 0, 0, 0, 0)))
    assert "max_twist_deg" not in measure(points)


def test_velocity_counts_once_initialised_and_by_stamp(invented):
    traces = Traces()
    for tick in range(10):
        traces.feed("sim/truth", invented.truth(tick, vx=0.1))
        if tick % 3 == 0:
            traces.feed("state/velocity", invented.velocity(tick, 0.4 if tick >= 6 else 9.0, initialised=tick >= 6))
    assert measure(traces)["velocity_rmse_mps"] == pytest.approx(0.3)


def test_odometry_is_compared_from_its_first_initialised_pose(invented):
    traces = Traces()
    for tick, x in enumerate((0.0, 0.5, 1.0)):
        traces.feed("sim/truth", invented.truth(tick, x))
        traces.feed("state/odometry", invented.odometry(tick, 5.0, 2.0 + x, math.pi / 2))
    values = measure(traces)
    assert values["odometry_error_m"] == pytest.approx(0.0, abs=1e-12)
    assert values["heading_error_deg"] == pytest.approx(0.0, abs=1e-9)


def test_a_fall_is_final(invented):
    traces = Traces()
    traces.feed("sim/truth", invented.truth(0, fallen=True))
    traces.feed("sim/truth", invented.truth(1))
    assert not judge(traces, {"no_fall": 0.0}).ok
    assert [event.text for event in traces.events] == ["falls"]


def test_touches_are_counted_as_often_as_they_begin_where_there_is_something_to_touch(invented):
    traces = Traces()
    for tick, touching in enumerate((False, True, True, False, True)):
        traces.feed("sim/truth", invented.truth(tick, touching=touching))
    assert measure(traces)["touches"] == 2.0
    bare = Traces()
    bare.feed("sim/truth", invented.truth(0, touching=None))
    assert "touches" not in measure(bare)


def test_a_new_epoch_begins_anew_and_an_old_one_is_ignored(invented):
    traces = invented.walk(50)
    traces.feed("sim/truth", invented.truth(0, epoch=2))
    traces.feed("sim/truth", invented.truth(7, 3.0, epoch=1))
    assert len(traces.series("sim/truth")) == 1
    assert not traces.stances
    assert not len(traces.series("state/gait"))


def test_variants_are_sorted_by_error(invented):
    found = variants(invented.walk(100))
    assert list(found.values()) == sorted(found.values())
    assert set(found) == {"imu", "kinematics", "kinematics_gyro", "ekf"}


def test_an_unknown_key_is_ignored(invented):
    traces = Traces()
    traces.feed("health/walker", invented.gait(0))
    assert traces.last_tick == -1


def test_one_sample_of_too_small_a_margin_fails_the_run(invented):
    traces = invented.walk(400)
    least = measure(traces)["min_margin_m"]
    assert judge(traces, {"min_margin_m": least - 1e-6}).ok
    traces.feed("state/stability", invented.stability(400, least - 0.001, 0.05))
    verdict = judge(traces, {"min_margin_m": least - 1e-6})
    assert [row.name for row in verdict.rows if row.ok is False] == ["min_margin_m"]


def test_margins_count_from_the_moment_the_walker_is_ready(invented):
    traces, found = Traces(), []
    for tick, state, margin in ((0, "waiting", -0.1), (2, "standing", 0.07), (4, "waiting", 0.06)):
        traces.feed("sim/truth", invented.truth(tick))
        traces.feed("state/gait", invented.gait(tick, state=state))
        traces.feed("state/stability", invented.stability(tick, margin, margin))
        found.append(measure(traces).get("min_margin_m"))
    assert found == [None, 0.07, 0.06]  # being lost later is no excuse


def test_a_value_without_a_limit_that_would_break_its_siblings_gets_a_sentence() -> None:
    traces = Traces()
    traces.rows["state/stability"] = [(0.0, 0.05, 0.028), (1.0, 0.06, 0.04)]
    verdict = judge(traces, {"min_margin_m": 0.03})
    limits, notes = {row.name: row.limit_text for row in verdict.rows}, verdict.notes
    assert limits["min_margin_m"] == ">= 0.03"
    assert set(limits.values()) == {">= 0.03", "none"}
    assert len(notes) == 1
    assert (
        "measured CoM: 0.0280 m, has no limit; that of the smallest static margin, planned CoM is >= 0.03" in notes[0]
    )
    assert judge(traces, {"min_margin_m": 0.02}).notes == ()
    assert judge(traces, {}).notes == ()
