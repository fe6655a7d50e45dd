"""`surefoot estimate`, and the example without a bus."""

import json
import runpy
import sys
from pathlib import Path

import numpy as np
import pytest

from surefoot.lab.cli.output import EXIT_USAGE
from surefoot.lab.estimation.export import save_csv, save_npz
from tests.lab.estimation.walks import noisy

EXAMPLE = Path(__file__).parents[3] / "examples" / "estimate" / "offline.py"


@pytest.fixture(scope="module")
def log(tmp_path_factory):
    return save_npz(noisy(), tmp_path_factory.mktemp("log") / "walk.npz")


@pytest.fixture(scope="module")
def beginning(tmp_path_factory):
    """The first 6 s of that log."""
    log = noisy()
    kept = log.stamp_ns[log.seconds < 6.0][-1]
    part = log.with_imu(log.stamp_ns <= kept).with_feet(log.foot_ns <= kept)
    return save_npz(part, tmp_path_factory.mktemp("beginning") / "walk.npz")


@pytest.fixture
def undrawn(monkeypatch):
    """No curves are drawn, which takes longer than the estimate."""

    def empty(result, path):
        path.write_text("<svg/>")
        return path

    monkeypatch.setattr("surefoot.lab.estimation.plots.draw", empty)


def test_json_and_files(answer, log, tmp_path):
    report = json.loads(answer("estimate", log, "--json", "-o", tmp_path / "out", "--csv"))
    assert report["errors"]["rmse"] < 0.03
    names = ["estimates.npz", "estimates.svg", "estimate.tum", "truth.tum", "estimates.csv", "summary.json"]
    assert [Path(path).name for path in report["files"]] == names
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == sorted(names)
    estimate, truth = (np.loadtxt(tmp_path / "out" / f"{name}.tum") for name in ("estimate", "truth"))
    assert estimate.shape == truth.shape == (report["rows"], 8)
    assert abs(estimate[-1, 1] - estimate[0, 1] - truth[-1, 1] + truth[0, 1]) < 0.05


def test_what_an_earlier_estimate_wrote_does_not_stay_beside_a_new_one(answer, log, tmp_path, undrawn):
    answer("estimate", log, "-o", tmp_path, "--csv")
    (tmp_path / "mine.txt").write_text("kept")
    assert (tmp_path / "estimates.csv").exists()
    answer("estimate", log, "-o", tmp_path)
    assert not (tmp_path / "estimates.csv").exists()
    assert (tmp_path / "truth.tum").exists()
    assert (tmp_path / "mine.txt").read_text() == "kept"
    (tmp_path / "summary.json").write_text('{"files": ["../mine.txt", "mine.txt"]}')
    answer("estimate", log, "-o", tmp_path)
    assert (tmp_path / "mine.txt").read_text() == "kept"


def test_a_smoothed_log_is_better_and_another_estimator_is_refused(answer, complaint, log, tmp_path, undrawn):
    both, ahead = (json.loads(answer("estimate", log, "--json", *more)) for more in (("--smooth", "-o", tmp_path), ()))
    assert both["smoothed"]
    assert both["errors"]["rmse"] < 0.85 * ahead["errors"]["rmse"]
    assert (tmp_path / "estimates.npz").exists()
    assert "--smooth goes with the estimator best, got 'ekf'" in complaint(
        "estimate", log, "--smooth", "--estimator", "ekf"
    )


def test_evo_reads_the_trajectories_and_measures_the_same(answer, log, tmp_path, undrawn):
    pytest.importorskip("evo", reason="evo is not installed: pip install evo")
    from evo.core import metrics
    from evo.tools import file_interface

    report = json.loads(answer("estimate", log, "--score-from", "0", "--json", "-o", tmp_path))["errors"]
    estimate, truth = (file_interface.read_tum_trajectory_file(tmp_path / f"{x}.tum") for x in ("estimate", "truth"))
    each = metrics.RPE(metrics.PoseRelation.translation_part, 100, metrics.Unit.frames, all_pairs=True)
    each.process_data((truth, estimate))
    assert report["rpe_1s"] == pytest.approx(each.get_statistic(metrics.StatisticsType.rmse), rel=0.02)
    estimate.align(truth)
    whole = metrics.APE(metrics.PoseRelation.translation_part)
    whole.process_data((truth, estimate))
    assert report["ate"] == pytest.approx(whole.get_statistic(metrics.StatisticsType.rmse), rel=0.2)


def test_two_outputs_are_compared(answer, complaint, log, tmp_path, undrawn):
    for name in ("best", "ekf"):
        answer("estimate", log, "--estimator", name, "-o", tmp_path / name, "--json")
    report = json.loads(answer("compare", tmp_path / "best", tmp_path / "ekf" / "estimates.npz", "--json"))
    assert set(report["differences"]) == {"velocity", "tilt", "position", "heading"}
    assert 1e-3 < report["differences"]["velocity"]["rms"] < 0.05
    assert report["a"]["errors"]["rmse"] < report["b"]["errors"]["rmse"]
    out = answer("compare", tmp_path / "best", tmp_path / "ekf")
    assert "velocity, cm/s" in out
    assert "rpe" in out
    same = json.loads(answer("compare", tmp_path / "ekf", tmp_path / "ekf", "--json"))
    assert all(part["largest"] < 1e-6 for part in same["differences"].values())
    assert "No such file" in complaint("compare", tmp_path / "best", tmp_path / "none")
    assert "initialised" in complaint("compare", tmp_path / "best", log)


@pytest.mark.parametrize("name", ["paper", "kinematics_gyro", "inekf", "linear"])
def test_table_of_each_estimator(answer, beginning, name):
    out = answer("estimate", beginning, "--estimator", name)
    assert "velocity, row by row" in out
    assert name in out


def test_csv_without_truth_has_no_errors(answer, tmp_path):
    assert "errors" not in json.loads(answer("estimate", save_csv(noisy(), tmp_path / "walk.csv"), "--json"))


def test_an_unknown_estimator_and_a_bad_log_are_one_sentence(complaint, in_process, log, tmp_path):
    assert "'ekf'" in complaint("estimate", log, "--estimator", "efk")
    (tmp_path / "bad.csv").write_text("t,gyro_x\n")
    code, out, _ = in_process("estimate", tmp_path / "bad.csv", "--json")
    assert code == EXIT_USAGE
    assert json.loads(out)["error"]["field"] == "gyro_y"
    assert not list(tmp_path.glob(".estimates-*"))


def test_the_example_runs_and_is_ten_lines(log, monkeypatch, capsys):
    code = EXAMPLE.read_text().split("\n\n")[-1]
    assert len(code.strip().splitlines()) <= 11
    monkeypatch.setattr(sys, "argv", [str(EXAMPLE), str(log)])
    runpy.run_path(str(EXAMPLE))
    shown = capsys.readouterr().out
    assert "tilt known: True" in shown
    assert np.isfinite([float(x) for x in shown.split("[")[1].split("]")[0].split()]).all()
