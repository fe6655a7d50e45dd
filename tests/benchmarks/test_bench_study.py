"""A study in several sittings: seeds that are kept are not run again, and the table is of all of them."""

from pathlib import Path
from typing import Any

import pytest

from benchmarks import bench_study
from surefoot.lab.report.judge import Row, RunVerdict
from surefoot.lab.runs.local import LocalRun


@pytest.mark.parametrize(("text", "seeds"), [("3", [0, 1, 2]), ("20:22", [20, 21]), ("5:5", [])])
def test_seeds(text: str, seeds: list[int]) -> None:
    assert list(bench_study.seeds_of(text)) == seeds


def test_a_rate_lies_within_its_interval() -> None:
    for k, n in ((0, 10), (10, 10), (95, 100)):
        low, high = bench_study.wilson(k, n)
        assert -1e-12 <= low <= k / n <= high <= 1.0 + 1e-12


def test_goes_on_where_it_stopped(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    ran: list[int] = []

    def study(name: str, seeds: Any, **_: Any) -> Any:
        for seed in seeds:
            ran.append(seed)
            rows = (Row("distance_m", 1.5 if seed != 2 else 0.2, ok=seed != 2), Row("min_margin_m", None))
            yield LocalRun(seed, RunVerdict(rows), "", 100, 1.0)

    monkeypatch.setattr(bench_study, "study", study)
    file = tmp_path / "study.jsonl"
    bench_study.run("flat", range(3), file)
    file.write_text(file.read_text() + '{"scenario": "flat", "se')  # a study that was ended while it wrote
    bench_study.run("flat", range(5), file)
    assert ran == [0, 1, 2, 3, 4]
    bench_study.run("flat", range(5), file)
    assert ran == [0, 1, 2, 3, 4]
    said = capsys.readouterr().out
    assert "flat seed 2: failed ['distance_m']" in said
    assert "flat: 4 of 5 passed" in said
    bench_study.run("stand", range(1), file)
    assert ran == [0, 1, 2, 3, 4, 0]
