"""Collect, learn, walk on another robot: the same commands with its name, no edit."""

import json
from pathlib import Path
from typing import Any

from surefoot.lab.footholds.campaign import read
from surefoot.lab.footholds.rules import model_rule
from surefoot.lab.footholds.walks import JoinedWalk, Setting
from surefoot.robot.reader import load_robot
from surefoot.services.footholds.models.files import load
from surefoot.services.footholds.select import SelectParams


def test_messor_learns_by_its_name_alone(tmp_path: Path, answer: Any) -> None:
    robot = load_robot("messor")
    samples, file = tmp_path / "s.jsonl", tmp_path / "m.json"
    short = ("--ground", "rough:0.04", "--profile", "exact", "--distance", "0.1", "--seeds", "1000:1002")
    answer("footholds", "collect", "--robot", "messor", "--out", samples, *short)
    stances, trials, bad = read(samples)
    assert (len(trials), bad) == (2, 0)
    assert {(each.robot, each.robot_hash, each.foot_radius) for each in stances} == {
        ("messor", robot.hash, robot.foot_radius)
    }
    shown = json.loads(answer("footholds", "learn", samples, "--out", file, "--folds", "2", "--json"))
    model = load(file)
    assert shown["model"] == model.name
    assert model.conditions.robot == "messor"

    asked: list[str] = []

    def rule(ground, robot, base, landings, step):  # type: ignore[no-untyped-def]
        asked.append(model.unfit(ground.surface.cell, ground.smooth, ground.foot_radius))
        return model_rule(model, SelectParams())(ground, robot, base, landings, step)

    joined = JoinedWalk(2, Setting("rough", 0.1, 0.04, 0.5, robot="messor", profile="exact"), rule)
    while joined.tick():
        pass
    done = joined.verdict()
    assert done.reached
    assert not done.fallen
    assert set(asked) == {""}
