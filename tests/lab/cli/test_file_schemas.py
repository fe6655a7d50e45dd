"""JSON Schemas of hand-written files: every file of the package fits the schema of its kind, a wrong one does not."""

import json
import tomllib
from pathlib import Path

import jsonschema
import pytest
import yaml

from surefoot.lab.cli.schema import FILES, file_schema

ROOT = Path(__file__).parents[3]
PLACES = {
    "robot": "surefoot/robots/*/robot.toml",
    "scenario": "scenarios/*.toml",
    "system": "compose/*.yaml",
    "imu": "surefoot/robots/sensors/*.toml",
    "camera": "surefoot/robots/cameras/*.toml",
    "depth-camera": "surefoot/robots/depth_cameras/*.toml",
    "ranger": "surefoot/robots/rangers/*.toml",
}


def content(path):
    text = path.read_text(encoding="utf-8")
    return yaml.safe_load(text) if path.suffix == ".yaml" else tomllib.loads(text)


@pytest.mark.parametrize("kind", FILES)
def test_every_file_fits_its_schema(kind):
    validator = jsonschema.Draft202012Validator(file_schema(kind))
    validator.check_schema(validator.schema)
    paths = list(ROOT.glob(PLACES[kind]))
    assert paths
    for path in paths:
        assert not list(validator.iter_errors(content(path))), path
        assert list(validator.iter_errors({**content(path), "zzz": 1})), path


@pytest.mark.parametrize("step", [{"do": "walk", "at_tick": 1, "distence": 1.0}, {"do": "fly", "at_tick": 1}])
def test_a_wrong_step_does_not_fit(step):
    with pytest.raises(jsonschema.ValidationError):
        jsonschema.validate({"description": "x", "step": [step]}, file_schema("scenario"))


def test_the_command_prints_it(answer, complaint):
    assert json.loads(answer("schema", "file", "robot")) == file_schema("robot")
    assert "did you mean 'robot'" in complaint("schema", "file", "robt")
