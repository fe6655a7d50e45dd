"""`surefoot bridge ros2`: names of topics come from a file, options are stronger; wrong ones are refused by name."""

from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest

from surefoot.lab.cli import running
from surefoot.lockstep import launch
from surefoot.lockstep.config import load_config
from surefoot.services.ros2.service import Ros2Bridge, Ros2Config

FILE = '[ros2]\nodom = "/from_file"\nbase_state_type = "BaseStateMsg"\njoint_states = ""\n'


@pytest.fixture
def started(monkeypatch: pytest.MonkeyPatch) -> list[list[str]]:
    """Arguments of each service that a command starts."""
    found: list[list[str]] = []

    def take(service: Any, words: list[str]) -> None:
        assert service is Ros2Bridge
        found.append(words)

    monkeypatch.setattr(launch, "main", take)
    system = running.RunningSystem("lupo", "tcp/127.0.0.1:7447", "surefoot/lupo")
    monkeypatch.setattr(running, "systems", lambda *_: (system,))
    return found


def config_of(words: list[str]) -> Ros2Config:
    file = Path(words[words.index("--config") + 1]) if "--config" in words else None
    fields = [value for word, value in pairwise(words) if word == "--set"]
    return load_config(Ros2Config, "ros2", file, {}, fields)


def test_names_of_a_file_and_of_options(started: list[list[str]], answer: Any, tmp_path: Path) -> None:
    names = tmp_path / "names.toml"
    names.write_text(FILE)
    answer("bridge", "ros2", "--names", names, "--odom", "/odometry/filtered", "--base-state", "/base_state")
    (words,) = started
    assert words[:4] == ["--connect", "tcp/127.0.0.1:7447", "--namespace", "surefoot/lupo"]
    config = config_of(words)
    assert (config.odom, config.base_state, config.base_state_type) == (
        "/odometry/filtered", "/base_state", "BaseStateMsg",
    )  # fmt: skip
    assert (config.robot, config.joint_states, config.tf) == ("lupo", "", "/tf")


def test_a_field_that_is_none(started: list[list[str]], answer: Any) -> None:
    answer("bridge", "ros2", "--set", "odometry=/odom")
    with pytest.raises(Exception, match="unknown field 'odometry'"):
        config_of(started[0])
