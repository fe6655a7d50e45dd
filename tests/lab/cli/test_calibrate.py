"""`surefoot estimate --calibrate` and `--calibrated`."""

import json
from dataclasses import replace

import pytest

from surefoot.lab.estimation.export import save_npz
from tests.lab.estimation.walks import noisy


@pytest.fixture(scope="module")
def wrong(tmp_path_factory):
    """A log with legs 5 % too long, and feet 20 ms late."""
    log = noisy()
    log = replace(log, foot_position=1.05 * log.foot_position, foot_ns=log.foot_ns + 20_000_000)
    return save_npz(log, tmp_path_factory.mktemp("log") / "wrong.npz")


def test_the_report_as_json_names_what_is_wrong(answer, wrong):
    report = json.loads(answer("estimate", wrong, "--calibrate", "--json"))
    assert [one["name"] for one in report["corrections"]] == ["length of all legs", "time offset of the feet"]
    assert report["corrections"][0]["value"] == pytest.approx(-4.76, abs=report["corrections"][0]["half"])
    assert report["corrections"][1]["value"] == pytest.approx(-20.0, abs=3.0)
    assert {"mounting about x", "lever along z"} <= {one["name"] for one in report["parameters"]}


def test_the_report_as_a_table(answer, wrong):
    out = answer("estimate", wrong, "--calibrate")
    assert "observable" in out
    assert "length of leg 0" in out


def test_a_late_foot_is_noted_and_corrected(answer, wrong):
    before = json.loads(answer("estimate", wrong, "--json"))
    after = json.loads(answer("estimate", wrong, "--calibrated", "--json"))
    assert any("too late" in note for note in before["notes"])
    assert not any("too late" in note for note in after["notes"])
    assert any(note.startswith("corrected") for note in after["notes"])
    assert after["errors"]["rmse"] < 0.4 * before["errors"]["rmse"]
