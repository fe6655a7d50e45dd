"""Fitted models as files, and the command that writes them."""

import json
import tomllib

import pytest

from surefoot.errors import ConfigError, SurefootError
from surefoot.lab.fit.estimate import fit
from surefoot.lab.fit.events import read_run
from surefoot.lab.fit.output import check_out, fitted_toml, write_model
from surefoot.lab.fit.result import Fitted, Interval
from surefoot.services.navigator.policy.params import load
from tests.lab.fit.recordings import tour
from tests.surefoot.expect import expect_error


def found():
    values = {
        "sight.range_sd": Interval(0.0512, 0.05, 0.06),
        "actions.left.turn_deg": Interval(24.0, 23.0, 25.0),
        "actions.right.turn_deg": Interval(-24.0, -25.0, -23.0),
        "actions.walk.frames": Interval(18, 18, 18, 5),
        "switching.walk.stand": Interval(0.9, 0.8, 1.0, 4),
        "switching.turn.walk": Interval(1e-16, 0.0, 1e-15, 4),
    }
    return Fitted(values=values, runs=2, sightings=70)


def test_what_is_written_is_the_model_with_the_numbers(tmp_path):
    model = write_model(found(), "nao-paper", ["a.mcap", "b.mcap"], tmp_path / "fitted.toml")
    assert load(tmp_path / "fitted.toml") == model
    assert (model.sight.range_sd, model.actions["right"].turn_deg, model.actions["walk"].frames) == (0.0512, -24.0, 18)
    assert model.sight.bearing_sd_deg == load("nao-paper").sight.bearing_sd_deg
    assert [path.name for path in tmp_path.iterdir()] == ["fitted.toml"]


def test_intervals_stand_beside_the_numbers():
    text = fitted_toml(found(), "nao-paper", ["a.mcap", "b.mcap"])
    assert "Fitted to 2 recordings (70 sightings)" in text
    assert "stand = 0.9  # 0.8 to 1, 4 samples" in text
    assert "walk = 0\n" in text  # rounding errors of times are no times
    assert tomllib.loads(text)["extends"] == "nao-paper"


def test_a_model_in_another_folder_is_found_from_the_new_one(tmp_path):
    (tmp_path / "models").mkdir()
    (tmp_path / "fits").mkdir()
    base = tmp_path / "models" / "own.toml"
    base.write_text('extends = "nao-paper"\ndecision_delay = 0.1\n')
    model = write_model(found(), str(base), [], tmp_path / "fits" / "fitted.toml")
    assert model.decision_delay == 0.1
    assert str(tmp_path) not in (tmp_path / "fits" / "fitted.toml").read_text()


def test_numbers_that_make_no_model_leave_the_file_as_it_was(tmp_path):
    out, wrong = tmp_path / "fitted.toml", found()
    out.write_text("old")
    del wrong.values["actions.right.turn_deg"]  # left no longer mirrors it
    with pytest.raises(ConfigError):
        write_model(wrong, "nao-paper", [], out)
    assert out.read_text() == "old"
    assert [path.name for path in tmp_path.iterdir()] == ["fitted.toml"]


@pytest.mark.parametrize("name", ["fitted", "own.toml"])
def test_files_that_could_not_be_loaded_are_refused(tmp_path, name):
    with expect_error(SurefootError, "invalid", field="out"):
        check_out(tmp_path / name, str(tmp_path / "own.toml"))


def test_from_a_recording_to_a_model_by_command(in_process, tmp_path):
    recording, out = tour(tmp_path / "tour.mcap", frame=20), tmp_path / "fitted.toml"
    code, text, _ = in_process("fit", "navigator", recording, "--params", "nao-paper", "--out", out, "--json")
    answer = json.loads(text)
    assert (code, answer["runs"], answer["out"]) == (0, 1, str(out))
    assert answer["improvement"] > 0.0
    assert not set(answer["undecided"]) & set(answer["values"])
    assert load(out).sight.range_sd == pytest.approx(answer["values"]["sight.range_sd"]["value"], rel=1e-5)
    assert load(out).switching["stand"]["walk"] == pytest.approx(1.0, abs=0.02)


@pytest.mark.parametrize("params", ["nao", "paper"])
def test_models_with_other_errors_are_fitted_too(tmp_path, params):
    """`nao` has noise in proportion to the range, `paper` neither tilt nor sway."""
    base = load(params, ["actions.walk.match=0.3"])
    numbers = fit([read_run(tour(tmp_path / "tour.mcap", frame=20), base)], base)
    model = write_model(numbers, params, ["tour.mcap"], tmp_path / "fitted.toml")
    assert model.sight.bearing_sd_deg < 2.0  # the recording has 1.1 deg
    assert (model.sight.tilt_sd_deg > 0.0) == (params == "nao")
    assert ("sight.range_sd_share" in numbers.values) == (params == "nao")


@pytest.mark.parametrize("key", ["navigator/order", "hw/landmarks", "terrain/landmarks"])
def test_recordings_without_what_is_needed_end_with_2_and_write_nothing(complaint, tmp_path, key):
    recording = tour(tmp_path / "less.mcap", skip=(key,))
    err = complaint("fit", "navigator", recording, "--out", tmp_path / "fitted.toml")
    assert key in err
    assert not (tmp_path / "fitted.toml").exists()


def test_files_that_are_no_recordings_end_with_2_and_write_nothing(complaint, tmp_path):
    (tmp_path / "text.mcap").write_text("not a recording, but some text")
    err = complaint("fit", "navigator", tmp_path / "text.mcap", "--out", tmp_path / "fitted.toml")
    assert "not an MCAP file" in err
    assert not (tmp_path / "fitted.toml").exists()


def test_a_file_that_is_no_toml_is_refused_before_the_work(complaint, tmp_path):
    (tmp_path / "text.mcap").write_text("not a recording, but some text")
    err = complaint("fit", "navigator", tmp_path / "text.mcap", "--out", tmp_path / "fitted")
    assert "*.toml" in err
