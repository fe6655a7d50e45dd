"""`surefoot train` and `surefoot evaluate`: a policy from parameters to figures, and refusals in one sentence."""

import json

import pytest


def test_a_planner_is_made_and_beats_the_paper_s_controller(answer, tmp_path):
    out = str(tmp_path / "p.npz")
    made = json.loads(answer("train", "navigator", "--params", "paper-blur", "--out", out, "--json"))
    words = ("--policy", out, "--params", "paper-blur", "--seeds", "0:200", "--against", "hand", "--json")
    found = json.loads(answer("evaluate", "navigator", *words))
    assert found["policy"]["sha256"] == made["sha256"]
    assert found["policy"]["provenance"]["model_sha256"] == found["model_sha256"]
    assert found["policy"]["episodes"] == 200
    assert found["paired"]["difference_ci95_percent"][1] < 0
    assert 0 < found["policy"]["success_at_least"] < found["policy"]["success"] <= 1


def test_sarsa_is_trained_twice_and_one_is_kept(answer, tmp_path):
    out = str(tmp_path / "s.npz")
    words = ("--policy", "sarsa", "--out", out, "--episodes", "100", "--runs", "2", "--seed", "7", "--json")
    made = json.loads(answer("train", "navigator", *words))
    assert [t["seed"] for t in made["trainings"]] == [7, 8]
    assert sum(t["kept"] for t in made["trainings"]) == 1
    assert [path.name for path in tmp_path.iterdir()] == ["s.npz"]


def test_the_limit_and_other_actions_can_be_compared(answer):
    words = ("--policy", "limit", "--actions", "arcs", "--seeds", "0:50", "--against", "tuned", "--json")
    found = json.loads(answer("evaluate", "navigator", *words, "--against-actions", "four"))
    assert found["paired"]["difference_percent"] < -10
    assert "tuned" in answer("evaluate", "navigator", "--policy", "tuned", "--seeds", "0:50")


@pytest.mark.parametrize(
    ("words", "needle"),
    [
        (("evaluate", "navigator", "--policy", "planr"), "did you mean 'planner'"),
        (("evaluate", "navigator", "--seeds", "9"), "A:B"),
        (("evaluate", "navigator", "--seeds", "9:3"), "A:B"),
        (("evaluate", "navigator", "--actions", "six"), "four, arcs"),
        (("evaluate", "navigator", "--params", "none"), "paper"),
        (("evaluate", "navigator", "--set", "reward.gamma=0.95"), "standing for ever"),
        (("evaluate", "navigator", "--policy", "absent.npz"), "absent.npz"),
        (("train", "navigator", "--out", "x.txt"), "*.npz"),
        (("train", "navigator", "--out", "x.npz", "--policy", "ppo"), "planner, sarsa"),
        (("train", "navigator", "--out", "no/such/x.npz"), "does not exist"),
    ],
)
def test_refusals_name_what_was_received_and_what_is_allowed(in_process, monkeypatch, tmp_path, words, needle):
    monkeypatch.chdir(tmp_path)
    code, _, err = in_process(*words)
    assert code != 0
    assert needle in err
    assert "internal error" not in err
    assert not list(tmp_path.iterdir())
