"""Feet of logs without a robot: points, soles and lines, by options, by metadata, by assumption."""

from dataclasses import replace

import numpy as np
import pytest

from surefoot.errors import SurefootError
from surefoot.lab.estimation.contacts import by_force
from surefoot.lab.estimation.export import save_csv, save_npz
from surefoot.lab.estimation.feet import FeetOptions
from surefoot.lab.estimation.files import open_log
from surefoot.lab.estimation.logs import DATA
from surefoot.lab.estimation.scores import score
from surefoot.lab.estimation.track import track
from surefoot.papers.wawrzynski.synthetic import SOLE
from tests.lab.estimation.walks import noisy
from tests.surefoot.expect import expect_error


def opened(path, **stated):
    return open_log(path, feet=FeetOptions.of(stated))


@pytest.fixture(scope="module")
def log():
    return replace(noisy(), order=None, touch=None)


@pytest.fixture(scope="module")
def path(log, tmp_path_factory):
    return save_npz(log, tmp_path_factory.mktemp("feet") / "walk.npz")


def test_soles_of_a_biped_are_assumed_and_lie_across_gravity(path):
    found = open_log(path)
    assert any("taken as soles" in note for note in found.notes)
    assert any("size of the soles" in note for note in found.notes)
    assert found.log.points.shape == (2, 4, 3)
    assert found.log.radius is None
    np.testing.assert_allclose(found.log.points[:, :, 0], 0.0)  # x is up in these feet


def test_a_stated_sole_has_its_size_with_the_length_ahead(path):
    points = opened(path, feet="sole", sole_size=["0.09", "0.056"]).log.points
    np.testing.assert_allclose(np.ptp(points, axis=1), np.tile(np.ptp(SOLE, axis=0), (2, 1)), atol=1e-12)
    line = opened(path, feet="line", sole_size=0.09).log.points
    np.testing.assert_allclose(np.ptp(line, axis=1), np.tile([0.0, 0.0, 0.09], (2, 1)), atol=1e-12)


def test_a_point_foot_keeps_its_radius(path):
    found = opened(path, feet="point", foot_radius=0.02)
    assert found.log.points is None
    np.testing.assert_allclose(found.log.radius, [0.02, 0.02])
    assert not any("soles" in note for note in found.notes)
    assert open_log(path, feet=FeetOptions.of({"foot_radius": 0.02})).log.points is None


def test_shanks_are_no_soles(log, tmp_path):
    swing = 0.5 * np.sin(2.0 * np.pi * 1e-9 * log.foot_ns)
    c, s, one = np.cos(swing), np.sin(swing), np.ones_like(swing)
    pitch = np.moveaxis(np.array([[c, 0 * c, s], [0 * c, one, 0 * c], [-s, 0 * c, c]]), 2, 0)
    shanks = replace(log, foot_rot=log.foot_rot @ np.stack([pitch, np.swapaxes(pitch, 1, 2)], axis=1))
    assert open_log(save_npz(shanks, tmp_path / "shanks.npz")).log.points is None


@pytest.mark.parametrize("kind", ["point", "sole", "line"])
def test_every_kind_of_foot_is_estimated(path, kind):
    log = replace(opened(path, feet=kind, foot_radius=None).log, begin_s=2.5)
    assert score(log, track("best", log)).rmse < 0.03


def test_metadata_state_the_feet_and_options_count_more(log, path, tmp_path):
    columns = dict(np.load(path)) | {"feet": "point", "foot_radius": 0.03, "contact_on": 9.0}
    np.savez(tmp_path / "stated.npz", **columns)
    np.testing.assert_allclose(open_log(tmp_path / "stated.npz").log.radius, 0.03)
    assert opened(tmp_path / "stated.npz", feet="sole").log.points.shape == (2, 4, 3)
    table = save_csv(log, tmp_path / "walk.csv")
    table.write_text("# feet = sole\n# sole_size = 0.2, 0.1\n# by = somebody\n" + table.read_text())
    np.testing.assert_allclose(np.ptp(open_log(table).log.points, axis=1), [[0.0, 0.1, 0.2]] * 2, atol=1e-12)
    np.savez(tmp_path / "names.npz", **(dict(np.load(path)) | {"feet": np.array(["left", "right"])}))
    assert open_log(tmp_path / "names.npz").log.points is not None


def test_thresholds_of_contact_hold_for_forces_of_three_axes_too(log, path, tmp_path):
    size = np.where(log.contact, 12.0, 5.0)
    aslant = size[..., None] * np.array([0.6, 0.0, 0.8])
    columns = {key: value for key, value in np.load(path).items() if key != "contact"}
    np.savez(tmp_path / "forces.npz", **columns, force=aslant)
    found = opened(tmp_path / "forces.npz", contact_on=9.0)
    np.testing.assert_array_equal(found.log.contact, log.contact)
    np.testing.assert_allclose(found.log.force, size)
    held = opened(tmp_path / "forces.npz", contact_on=9.0, contact_off=4.0).log.contact
    assert held[np.argmax(log.contact[:, 0]) :, 0].all()
    np.savez(tmp_path / "both.npz", **columns, force=aslant, contact=np.zeros(size.shape))
    assert not open_log(tmp_path / "both.npz").log.contact.any()
    np.testing.assert_array_equal(opened(tmp_path / "both.npz", contact_on=9.0).log.contact, log.contact)


WRONG = {
    "kind": ({"feet": "soles"}, "feet", "'sole'"),
    "radius": ({"foot_radius": -0.1}, "foot_radius", "-0.1"),
    "size in mm": ({"sole_size": [200, 100]}, "sole_size", "200"),
    "three sizes": ({"sole_size": [0.2, 0.1, 0.1]}, "sole_size", "3 sizes"),
    "words": ({"sole_size": ["long", "wide"]}, "sole_size", "long"),
    "thresholds": ({"contact_on": 5.0, "contact_off": 6.0}, "contact_off", "5 N"),
}


@pytest.mark.parametrize("kind", WRONG)
def test_statements_that_cannot_be_are_refused(kind):
    stated, field, text = WRONG[kind]
    with expect_error(SurefootError, "invalid", field=field, text=text):
        FeetOptions.of(stated)


def test_statements_that_do_not_fit_the_log_are_refused(path, tmp_path):
    with expect_error(SurefootError, field="foot_radius", text="3 radii"):
        opened(path, foot_radius=[0.01, 0.01, 0.01])
    bare = {key: value for key, value in np.load(path).items() if key != "foot_rotation"}
    np.savez(tmp_path / "bare.npz", **bare)
    with expect_error(SurefootError, field="feet", text="foot_rotation"):
        opened(tmp_path / "bare.npz", feet="sole")


@pytest.mark.skipif(not (DATA / "icub3_gazebo_walk.npz").exists(), reason="no foreign logs in ../shared/data")
def test_soles_halve_the_error_of_a_foreign_walk():
    log = replace(opened(DATA / "icub3_gazebo_walk.npz", feet="sole").log, begin_s=16.2)
    found = score(log, track("best", log))
    assert found.rmse < 0.042
    assert found.smooth < 0.019


def test_the_most_loaded_foot_stands_however_high_the_thresholds_are():
    rng = np.random.default_rng(5)
    share = np.repeat(rng.uniform(0.0, 1.0, 40), 10)
    force = 300.0 * np.column_stack([share, 1.0 - share])
    force[100:150] = rng.normal(0.0, 3.0, (50, 2))  # in flight, or lifted: what the cells show is noise
    contact, saved = by_force(force, 400.0, 300.0)
    assert contact[:100].any(axis=1).all()
    assert contact[150:].any(axis=1).all()
    assert not contact[100:150].any()
    assert (force[contact] >= 300.0 * 0.6 / 1.6).all()
    assert saved == pytest.approx(350 / 400)
    assert by_force(force, 100.0, 60.0)[1] == 0.0


def test_feet_that_share_the_load_stand_together_without_chatter():
    rng = np.random.default_rng(6)
    contact, _ = by_force(150.0 + rng.normal(0.0, 3.0, (1000, 2)), 400.0, 290.0)
    assert (np.diff(contact.astype(int), axis=0) != 0).sum() <= 2
    assert contact[10:].all()


@pytest.mark.parametrize("factor", [0.1, 0.25, 0.5])
def test_low_thresholds_do_not_let_a_foot_stand_before_it_bears(factor):
    share = 0.5 + 0.5 * np.sin(np.linspace(0.0, 40.0, 4000))
    force = 500.0 * np.column_stack([share, 1.0 - share])
    contact, _ = by_force(force, factor * 240.0, factor * 180.0)
    assert contact.any(axis=1).all()
    assert (contact == by_force(force, 240.0, 180.0)[0]).mean() > 0.85
    assert (force[contact] >= 0.3 * 500.0 / 1.3 - 1e-9).all()


@pytest.mark.parametrize("on", [100.0, 20.0])
def test_feet_that_hang_all_the_time_do_not_stand(on):
    force = np.random.default_rng(7).normal(0.0, 1.0, (500, 4))
    assert not by_force(force, on, 0.6 * on)[0].any()


def test_one_wrong_number_does_not_change_what_feet_usually_carry():
    force = np.full((200, 2), 150.0)
    right, _ = by_force(force, 400.0, 300.0)
    force[50, 0] = 1e9
    wrong, _ = by_force(force, 400.0, 300.0)
    np.testing.assert_array_equal(np.delete(wrong, [50, 51], axis=0)[60:], np.delete(right, [50, 51], axis=0)[60:])
    assert wrong.any(axis=1).all()
    assert by_force(np.zeros((0, 2)), 20.0, 10.0)[0].shape == (0, 2)
    assert not by_force(np.zeros((3, 2)), 20.0, 10.0)[0].any()


def test_thresholds_above_all_forces_are_noted(path, tmp_path):
    columns = dict(np.load(path)) | {"contact_on": 9000.0}
    names = [name for name in columns if name.startswith("contact") and name != "contact_on"]
    kept = {key: value for key, value in columns.items() if key not in names}
    np.savez(tmp_path / "high.npz", **kept, force=np.where(columns["contact"] > 0.5, 5000.0, 0.0))
    found = opened(tmp_path / "high.npz")
    assert any("thresholds too high" in note for note in found.notes)
