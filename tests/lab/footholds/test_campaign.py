"""Campaigns: what a trial holds, that they resume, and that a worker that dies costs and counts nothing twice."""

import math
import os
from concurrent.futures.process import BrokenProcessPool
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from surefoot.errors import SurefootError
from surefoot.lab.footholds import campaign
from surefoot.lab.footholds.campaign import Trial, append, collect, planned, read, walked
from surefoot.lab.footholds.walks import JoinedWalk, Setting
from surefoot.services.footholds.learning.samples import PATCH, StanceSample, line_of
from tests.services.footholds.learning.made import samples
from tests.services.footholds.numpy_features import map_features_numpy
from tests.surefoot.expect import expect_error

SHORT = Setting("rough", 0.3, 0.04, 0.5, profile="noise")


def made(trial: Trial) -> list[StanceSample]:
    return [replace(each, trial=trial.name) for each in samples(5, seed=trial.seed)]


@pytest.fixture(scope="module")
def stances() -> list[StanceSample]:
    return walked(Trial(3, SHORT))


def test_a_walk_gives_the_stances_of_its_choices(stances: list[StanceSample]) -> None:
    assert len(stances) > 15
    assert len({(each.leg, each.step) for each in stances}) == len(stances)
    assert {each.leg for each in stances} == set(range(6))
    assert all(each.problem in ("", "no_stroke") for each in stances)
    assert all(each.friction == 0.5 and each.robot == "ragno" and each.smooth for each in stances)
    loads = [each.load for each in stances]
    assert 3.0 < float(np.mean(loads)) < 15.0  # six legs carry 25 N, three at a time
    assert max(each.k4 for each in stances) > 0.02  # drawn in the whole window
    for each in stances[::5]:  # the kept heights give the kept coefficients
        z = np.array(each.heights_um, dtype=np.float64).reshape(PATCH, PATCH) * 1e-6
        middle = slice(PATCH // 2 - 1, PATCH // 2 + 2)
        found = map_features_numpy(z[middle, middle], np.array(each.stroke), each.cell)
        assert float(found.k1[1, 1]) == pytest.approx(each.k1, abs=1e-5)
        assert float(found.k2[1, 1]) == pytest.approx(each.k2, abs=1e-5)


def test_outcomes_are_the_judges(stances: list[StanceSample]) -> None:
    joined = JoinedWalk(3, SHORT, campaign.random_rule(3))
    while joined.tick():
        pass
    slid = sorted(joined.stances.sliding)
    assert {each.sliding for each in stances} <= set(slid)
    assert sum(each.sliding for each in stances) <= sum(slid) + 1e-12


def test_a_campaign_goes_on_where_it_was_ended(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    walks: list[str] = []

    def walk(trial: Trial) -> list[StanceSample]:
        walks.append(trial.name)
        return made(trial)

    monkeypatch.setattr(campaign, "walked", walk)
    out = tmp_path / "s.jsonl"
    trials = planned([SHORT, replace(SHORT, terrain="mixed", amplitude=None)], ("exact", "noise"), range(3))
    assert len({trial.name for trial in trials}) == 12
    assert collect(trials[:5], out) == 5
    with out.open("a") as stream:  # killed while it wrote
        stream.write(line_of(made(trials[5])[0]) + "\n" + line_of(made(trials[5])[1])[:40])
    assert collect(trials, out) == 7
    assert walks == [trial.name for trial in trials]
    found, numbers, bad = read(out)
    assert len(found) == 60
    assert set(numbers) == {trial.name for trial in trials}
    assert bad == 1
    assert collect(trials, out) == 0


def _dies_once(trial: Trial) -> list[StanceSample]:
    flag = Path(trial.model)
    if trial.seed == 2 and not flag.exists():
        flag.touch()
        os._exit(9)
    return made(trial)


def test_a_worker_that_dies_costs_no_trial(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(campaign, "walked", _dies_once)
    trials = planned([SHORT], ("exact",), range(6), model=str(tmp_path / "died"))
    collect(trials, tmp_path / "two.jsonl", jobs=2)
    assert (tmp_path / "died").exists()
    collect(trials, tmp_path / "one.jsonl", jobs=1)
    a, b = (sorted(line_of(s) for s in read(tmp_path / name)[0]) for name in ("one.jsonl", "two.jsonl"))
    assert a == b
    assert len(a) == 30


def test_pools_that_always_break_end_the_campaign(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    class Broken:
        def __init__(self, jobs: int) -> None: ...

        def __enter__(self) -> "Broken":
            raise BrokenProcessPool

        def __exit__(self, *what: object) -> None: ...

    monkeypatch.setattr(campaign, "worker_processes", Broken)
    with expect_error(SurefootError, "worker_died"):
        collect(planned([SHORT], ("exact",), range(2)), tmp_path / "s.jsonl", jobs=2)


def test_a_file_that_cannot_be_written_is_told_before_the_first_walk(tmp_path: Path) -> None:
    with expect_error(SurefootError, "unwritable"):
        collect(planned([SHORT], ("exact",), range(1)), tmp_path / "none" / "s.jsonl")
    with pytest.raises(SurefootError):
        read(tmp_path / "none.jsonl")
    append(tmp_path / "new.jsonl")
    assert read(tmp_path / "new.jsonl") == ([], {}, 0)
    assert math.isnan(samples(1)[0].friction) is False
