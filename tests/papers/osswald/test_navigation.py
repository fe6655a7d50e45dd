"""Section VI as `surefoot reproduce osswald` computes it."""

import json
from itertools import pairwise

import pytest

from surefoot.lab.cli import warming
from surefoot.lab.cli.output import state
from surefoot.lab.report.findings import Finding, Reproduction
from surefoot.lab.train.evaluation import EVALUATION, Seeds
from surefoot.lab.train.runs import SELECTION
from surefoot.papers.osswald import navigation
from surefoot.papers.osswald import study as osswald
from surefoot.services.navigator.policy.arrays import arrays
from surefoot.services.navigator.policy.decider import hand
from surefoot.services.navigator.policy.params import load


def test_the_entropy_threshold_is_the_fastest_of_those_that_always_arrive():
    found, chosen = osswald.tune(arrays(load("paper-blur", (osswald.THREE_STATES,))), Seeds(0, 150))
    assert set(found) == set(osswald.THRESHOLDS)
    assert found[chosen][1] == 1.0
    assert all(time >= found[chosen][0] for time, success in found.values() if success == 1.0)
    assert -4.0 < chosen < -1.0  # standing too often and never are both slower


def test_the_training_that_stands_for_the_paper_s_is_the_one_with_least_time():
    world = arrays(load("paper", (osswald.THREE_STATES,)))
    policies = [hand(world, turn_deg=deg) for deg in (60.0, 18.5, 35.0)]
    assert osswald.choose_of(world, policies) == 1


def test_choices_and_reports_share_no_episode():
    spans = (osswald.HAND_EPISODES, osswald.LEARNED_EPISODES, osswald.PAIRED_EPISODES)
    assert all(a.end <= b.first for a, b in pairwise(spans))
    training = {seed + 1 for seed in osswald.TRAININGS}
    assert len({EVALUATION, osswald.TUNING_STREAM, SELECTION} | training) == 3 + len(training)


def test_the_printed_real_runs_differ_from_17_runs_on():
    assert navigation._least_runs(93.16, 10.14, 86.53, 8.60) == 17
    assert navigation._least_runs(10.0, 1.0, 0.0, 1.0) == 2


@pytest.mark.parametrize(("words", "live"), [((), None), (("--live", "runs.jsonl"), "runs.jsonl")])
def test_command(monkeypatch, answer, words, live):
    asked = []

    def reproduce(folder, notify, live=None):
        asked.append((folder, live and str(live)))
        return Reproduction("Osswald", (Finding("VI-B", "gain, %", "9.0", "9.4", True),))

    monkeypatch.setattr(state, "json", False)
    monkeypatch.setattr(navigation, "reproduce", reproduce)
    monkeypatch.setattr(warming, "warm_if_cold", lambda *_: pytest.fail("compiles what is not needed"))
    out = answer("reproduce", "osswald", "--no-figures", "--json", *words)
    assert json.loads(out)["findings"][0]["ours"] == "9.4"
    assert asked == [(None, live)]


def test_live_runs_are_refused_where_there_are_none(monkeypatch, complaint):
    monkeypatch.setattr(state, "json", False)
    assert "osswald" in complaint("reproduce", "walas-stability", "--live", "runs.jsonl")


@pytest.mark.slow
def test_all_of_section_vi(tmp_path):
    found = navigation.reproduce(tmp_path / "figures")
    assert found.as_recorded
    assert {row.what for row in found.findings if row.ok is False} == {row.what for row in found.findings if row.known}
    assert sum(bool(row.known) for row in found.findings) == len(navigation.KNOWN)
    assert sum(row.ok is True for row in found.findings) >= 20
    assert all(row.ok in (True, False, None) and type(row.ok) in (bool, type(None)) for row in found.findings)
    json.dumps([vars(row) for row in found.findings])
    assert len(found.figures) == 4
    for path in found.figures:
        assert path.read_text(encoding="utf-8").lstrip().startswith("<?xml")
