"""Measures on logs of others have closed answers on tracks of known error; absent logs and packages are skipped."""

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.foreign import chosen_of, readable
from benchmarks.foreign_scores import absolute, goals_of, gyro_alone, leave_one_out, relative, scored, without_leg
from surefoot.errors import SurefootError
from surefoot.lab.estimation.logs import FOREIGN
from surefoot.lab.estimation.referees import run
from tests.lab.estimation.test_scores import exact
from tests.lab.estimation.walks import clean
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
    assert relative(log, moved, 0.03) == pytest.approx((0.0, 0.0), abs=1e-9)
    assert absolute(log, moved) == pytest.approx(0.0, abs=1e-9)


def test_a_long_path_is_long_over_every_piece() -> None:
    log = clean()
    true = exact(log)
    longer = replace(true, position=true.position * [1.05, 1.05, 1.0])
    rpe, height = relative(log, longer, 0.03)
    assert 0.02 < rpe < 0.08
    assert height == pytest.approx(0.0, abs=1e-9)
    assert np.isnan(relative(log, true, 50.0)[0])


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
        if row.window:
            assert set(goals_of(name, row.way)) <= measures


def test_unknown_names_are_refused_and_absent_files_skipped(tmp_path, capsys: pytest.CaptureFixture[str]) -> None:  # type: ignore[no-untyped-def]
    with expect_error(SurefootError, "invalid", text="gtsam_lag"):
        chosen_of("bets")
    with expect_error(SurefootError, "invalid", text="casbot_walk_a"):
        list(readable(["go2"], tmp_path))
    assert list(readable(["go1_trot"], tmp_path)) == []
    assert "skipped" in capsys.readouterr().out
