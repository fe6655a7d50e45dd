"""Poses, headings and velocities from elsewhere as inputs of `best`, with a simulated camera."""

from dataclasses import replace

import numpy as np
import pytest

from surefoot.errors import SurefootError
from surefoot.geometry.rotations import wrap_angle
from surefoot.lab.estimation.export import save_csv, save_npz
from surefoot.lab.estimation.files import open_log
from surefoot.lab.estimation.log import Log
from surefoot.lab.estimation.scores import score
from surefoot.lab.estimation.smooth import smooth
from surefoot.lab.estimation.track import Track, track
from tests.lab.estimation.cameras import Camera
from tests.lab.estimation.walks import noisy
from tests.surefoot.expect import expect_error


def seen(log: Log, camera: Camera) -> Track:
    return track("best", replace(log, external=camera.seen(log)))


def drift(log: Log, found: Track) -> float:
    """Error of the way of the last five seconds, m."""
    first, last = len(log.stamp_ns) - 501, len(log.stamp_ns) - 1
    turn = np.arctan2(log.rot[first, 1, 0], log.rot[first, 0, 0]) - found.yaw[first]
    c, s = np.cos(turn), np.sin(turn)
    way = found.position[last] - found.position[first]
    way = np.array([c * way[0] - s * way[1], s * way[0] + c * way[1], way[2]])
    return float(np.linalg.norm(way - log.position[last] + log.position[first]))


@pytest.mark.parametrize("seed", range(3))
def test_a_late_camera_holds_position_and_heading(seed):
    log = noisy("edges", seed)
    found, alone = seen(log, Camera()), track("best", log)
    assert found.externals is not None
    assert found.externals.frames == 1
    assert found.externals.left_out <= 2
    assert found.externals.used > 150
    assert found.externals.yaw == pytest.approx(2.0 + _turn(log, found), abs=0.02)
    with_it, without = score(log, found), score(log, alone)
    assert with_it.ate < max(0.7 * without.ate, 4e-3)
    assert with_it.smooth < 1.05 * without.smooth
    assert with_it.heading_rms_deg < 0.15


def _turn(log: Log, found: Track) -> float:
    """Turn of the world against odom, rad."""
    return float(wrap_angle(np.arctan2(log.rot[-1, 1, 0], log.rot[-1, 0, 0]) - found.yaw[-1]))


def test_the_delay_is_put_right():
    log, camera = noisy("turn", 1), Camera(sd=1e-4, yaw_sd=1e-3)
    good = seen(log, camera)
    external = camera.seen(log)
    late = track("best", replace(log, external=external._replace(stamp_ns=external.arrival_ns)))
    assert good.externals is not None
    assert late.externals is not None
    assert good.externals.left_out == 0
    assert late.externals.left_out > 50  # the robot turns: what is 80 ms old does not fit
    assert score(log, good).average < 0.3 * score(log, late).average
    early = track("best", replace(log, external=external._replace(arrival_ns=external.stamp_ns)))
    rows = np.isin(log.stamp_ns, external.arrival_ns)  # the future of a row differs, its past does not
    np.testing.assert_array_equal(good.v[-1], early.v[-1])
    assert rows.any()


def test_outliers_are_left_out_and_counted():
    log = noisy("slip", 2)
    found = seen(log, Camera(wrong=0.2))
    assert found.externals is not None
    assert 20 < found.externals.left_out < 60
    assert found.externals.frames == 1
    assert score(log, found).ate < 1.3 * max(score(log, seen(log, Camera())).ate, 2e-3)


def test_a_frame_that_jumps_is_found_again_and_moves_nothing():
    log = noisy("slip", 2)
    found = seen(log, Camera(jump_s=10.0))
    assert found.externals is not None
    assert found.externals.frames == 2
    assert 10 <= found.externals.left_out <= 12
    assert found.externals.yaw == pytest.approx(2.5 + _turn(log, found), abs=0.02)
    started = np.flatnonzero(found.flags["initialised"])[1:]
    assert np.abs(np.diff(found.position[started], axis=0)).max() < 0.02
    assert score(log, found).ate < 0.01


@pytest.mark.parametrize("parts", [("yaw",), ("velocity",)])
def test_a_heading_or_a_velocity_alone(parts):
    log = noisy("edges", 0)
    found, alone = (score(log, one) for one in (seen(log, Camera(parts=parts, sd=0.002, every=2)), track("best", log)))
    if parts == ("yaw",):
        assert found.heading_rms_deg < max(0.7 * alone.heading_rms_deg, 0.15)
    else:
        assert found.smooth < 0.7 * alone.smooth


def test_covariance_of_the_pose_does_not_grow_with_a_camera():
    log = noisy()
    with_it = smooth("best", replace(log, external=Camera().seen(log)))
    assert score(log, with_it).rmse < score(log, track("best", log)).rmse
    assert drift(log, seen(log, Camera())) < 5e-3


def test_others_than_best_do_not_see_it():
    log = noisy()
    for name in ("ekf", "inekf"):
        a, b = track(name, log), track(name, replace(log, external=Camera().seen(log)))
        np.testing.assert_array_equal(a.v, b.v)


def columns(log: Log, **changes):
    """Columns of a camera, those of `changes` replaced or left out (None)."""
    found = Camera().seen(log)
    known = {
        "external_stamp_ns": found.arrival_ns, "external_position": found.rows[:, :3], "external_yaw": found.rows[:, 3],
        "external_position_sd": 0.005, "external_yaw_sd": 0.01, "external_delay": 0.08,
    }  # fmt: skip
    return {key: value for key, value in (known | changes).items() if value is not None}


def saved(log: Log, path, **changes):
    save_npz(log, path)
    with np.load(path) as file:
        own = dict(file)
    np.savez(path, **own, **columns(log, **changes))
    return path


def test_columns_of_a_file_are_the_samples(tmp_path):
    log = noisy()
    opened = open_log(saved(log, tmp_path / "camera.npz"))
    assert any("80 ms late" in note for note in opened.notes)
    found, wanted = opened.log.external, Camera().seen(log)
    assert found is not None
    np.testing.assert_array_equal(found.stamp_ns, wanted.stamp_ns)
    np.testing.assert_array_equal(found.arrival_ns, wanted.arrival_ns)
    np.testing.assert_allclose(found.rows, wanted.rows)
    assert score(log, track("best", opened.log)).ate < 0.01


def test_a_csv_has_them_in_its_rows(tmp_path):
    log = noisy()
    path = save_csv(log, tmp_path / "walk.csv")
    header, *lines = path.read_text().splitlines()
    names = "external_x,external_y,external_z,external_yaw"
    filled = [line + (f",{i},2,3,0.5" if i % 10 == 0 else ",,,,") for i, line in enumerate(lines)]
    only = ["20.5" + "," * header.count(",") + ",7,8,9,0.25"]
    text = "\n".join(["# external_position_sd = 0.01", "# external_yaw_sd = 0.02", f"{header},{names}", *filled, *only])
    path.write_text(text + "\n")
    plain = open_log(save_csv(log, tmp_path / "plain.csv")).log
    opened = open_log(path).log
    assert len(opened.stamp_ns) == len(plain.stamp_ns)
    assert len(opened.foot_ns) == len(plain.foot_ns)
    assert opened.external is not None
    np.testing.assert_allclose(opened.external.rows[-1, :4], [7, 8, 9, 0.25])
    assert len(opened.external.rows) == len(range(0, len(lines), 10)) + 1
    assert opened.external.rows[0, 16] == pytest.approx(4e-4)


def test_an_empty_source_changes_nothing(tmp_path):
    log = noisy()
    opened = open_log(saved(log, tmp_path / "no.npz", external_stamp_ns=np.empty(0, np.int64),
                            external_position=np.empty((0, 3)), external_yaw=np.empty(0)))  # fmt: skip
    assert opened.log.external is None
    assert any("external_t is empty" in note for note in opened.notes)


@pytest.mark.parametrize(
    ("changes", "text"),
    [
        ({"external_yaw": None}, "nothing else shows how its frame is turned"),
        ({"external_position_sd": None}, "external_position_sd or external_position_covariance"),
        ({"external_yaw_sd": -1.0}, "external_yaw_sd is [-1.0]; wanted is a number above 0"),
        ({"external_delay": 0.9}, "external_delay is 0.9 s; 0 to 0.4 s"),
        ({"external_stamp_ns": None}, "external_t"),
        ({"external_position": np.zeros((4, 3))}, "external"),
    ],
)
def test_what_is_refused(changes, text, tmp_path):
    with expect_error(SurefootError, "invalid", text=text):
        open_log(saved(noisy(), tmp_path / "bad.npz", **changes))
