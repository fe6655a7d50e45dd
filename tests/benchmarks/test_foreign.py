"""Measures on logs of others have closed answers on tracks of known error; absent logs and packages are skipped."""

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.foreign import chosen_of, readable
from benchmarks.foreign_changes import alarms, changes, planted, turned_starts
from benchmarks.foreign_scores import goals_of, gyro_alone, leave_one_out, scored, without_leg
from benchmarks.foreign_tables import plain
from surefoot.errors import SurefootError
from surefoot.lab.estimation.logs import FOREIGN
from surefoot.lab.estimation.peers.legs import inertial_velocity
from surefoot.lab.estimation.referees import run
from tests.lab.estimation.test_scores import exact
from tests.lab.estimation.walks import clean, noisy
from tests.surefoot.expect import expect_error


def turned(x: np.ndarray, angle: float) -> np.ndarray:
    c, s = np.cos(angle), np.sin(angle)
    return x @ np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]).T


def flagged(track):  # type: ignore[no-untyped-def]
    n = len(track.v)
    return replace(track, flags={"initialised": np.ones(n, dtype=bool), "filter_ok": np.ones(n, dtype=bool)})


def test_a_turned_and_moved_path_has_no_error() -> None:
    log = clean()
    true = exact(log)
    moved = replace(true, position=turned(true.position, 0.4) + np.array([1.0, -2.0, 3.0]), yaw=true.yaw + 0.4)
    found = scored(log, flagged(replace(moved, g=true.g)), 0.03)
    assert (found.rpe, found.height, found.ate) == pytest.approx((0.0, 0.0, 0.0), abs=1e-6)


def test_a_long_path_is_long_over_every_piece() -> None:
    log = clean()
    true = exact(log)
    longer = replace(true, position=true.position * [1.05, 1.05, 1.0])
    found = scored(log, flagged(longer), 0.03)
    assert 2.0 < found.rpe < 8.0
    assert found.height == pytest.approx(0.0, abs=1e-6)
    assert np.isnan(scored(log, flagged(true), 50.0).rpe)


def test_scores_of_the_truth_and_of_a_track_that_never_started() -> None:
    log = clean()
    best = scored(log, flagged(exact(log)), 0.03)
    assert max(best.v, best.smooth, best.rpe, best.heading) < 1e-6
    assert best.inside == 1.0
    idle = replace(
        flagged(exact(log)), flags={k: np.zeros(len(log.w), dtype=bool) for k in ("initialised", "filter_ok")}
    )
    assert np.isnan(scored(log, idle, 0.03).v)
    assert scored(log, idle, 0.03).cells()[0] == "-"


def test_a_perfect_gyro_keeps_the_heading() -> None:
    assert gyro_alone(clean())[0] == pytest.approx(0.0, abs=0.01)


def test_leaving_a_leg_out_of_a_perfect_walk_changes_little() -> None:
    found = leave_one_out(clean(), lambda log: run("inekf", log))
    assert found.difference < 1.0
    assert found.heights < 1.0
    assert np.isnan(found.made)
    assert not without_leg(clean(), 1).contact[:, 1].any()


@pytest.mark.parametrize("name", ["legs", "kinematics_gyro"])
def test_kinematics_integrate_their_own_velocity(name: str) -> None:
    log = clean()
    found = run(name, log)
    v = np.einsum("nij,nj->ni", log.rot, found.v)
    rows = np.flatnonzero(log.scored)
    way = np.sum(v[rows[1:]], axis=0) * 0.01
    np.testing.assert_allclose(found.position[rows[-1]] - found.position[rows[0]], way, atol=2e-3)


def test_every_log_has_goals_that_are_measured() -> None:
    measures = set(vars(scored(clean(), flagged(exact(clean())), 0.03)))
    for name, row in FOREIGN.items():
        if name not in {"spot_staircase", "go1_bag_a"}:  # without truth
            assert set(goals_of(name, row.way)) <= measures


def test_unknown_names_are_refused_and_absent_files_skipped(tmp_path, capsys: pytest.CaptureFixture[str]) -> None:  # type: ignore[no-untyped-def]
    with expect_error(SurefootError, "invalid", text="gtsam_lag"):
        chosen_of("bets")
    with expect_error(SurefootError, "invalid", text="casbot_walk_a"):
        list(readable(["go2"], tmp_path))
    assert list(readable(["go1_trot"], tmp_path)) == []
    assert "skipped" in capsys.readouterr().out


def test_changes_leave_the_log_they_start_from_alone() -> None:
    log = clean()
    found = list(changes("best", log, FOREIGN["icub_kindyn_walk"]))
    names = [change.name for change in found]
    assert len(set(names)) == len(names)
    assert {"sigma_w x 0.2", "sigma_point x 5", "legs x 0.95", "feet +20 ms"} <= set(names)
    scale = found[names.index("legs x 1.05")].log
    np.testing.assert_allclose(scale.foot_position, 1.05 * log.foot_position)
    late = found[names.index("feet +20 ms")].log
    assert late.foot_ns[0] - log.foot_ns[0] == 20_000_000
    assert late.foot_ns[-1] <= log.stamp_ns[-1]


def test_levels_of_force_change_contacts() -> None:
    log = clean()
    loaded = replace(log, force=np.where(log.contact, 200.0, 10.0))
    found = {c.name: c.log for c in changes("best", loaded, FOREIGN["icub_kindyn_walk"])}
    for factor in ("0.5", "2"):  # twice: 200 N are below the threshold, but the most loaded foot stands
        np.testing.assert_array_equal(found[f"contact forces x {factor}"].contact, log.contact)


def test_a_referee_does_not_care_how_the_unit_is_mounted() -> None:
    found = turned_starts("linear", noisy(), 0.1, 3)
    assert found.diverged == 0
    assert found.spread < 1e-3
    assert found.slowest == 0.0


def test_a_planted_fault_is_seen_and_a_clean_log_raises_no_alarm() -> None:
    log = noisy()
    whole = run("best", log)
    found = planted("legs swapped", log, whole, 0, "best", 10.0)
    assert found.right
    assert found.ratio < 1.1  # the legs are taken the other way round
    assert alarms(log, whole) == 0.0
    simple = planted("legs swapped", log, run("legs", log), 0, "legs", 10.0)
    assert simple.ratio > 2.0
    assert not simple.right


def test_scores_for_json_hold_no_nan() -> None:
    log = clean()
    kept = plain({"walk": {"best": scored(log, flagged(exact(log)), 50.0)}})
    assert kept["walk"]["best"]["rpe"] is None
    assert kept["walk"]["best"]["inside"] == 1.0


def test_a_perfect_inertial_unit_needs_no_feet() -> None:
    log = clean()
    v = inertial_velocity(log, 250)
    np.testing.assert_allclose(v, log.v_world[250:], atol=0.01)
