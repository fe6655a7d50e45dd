"""Inputs of the fuzzer: drawn the same from a seed, taken or refused in one sentence."""

import zlib
from pathlib import Path
from random import Random

import jsonschema
import pytest

from benchmarks import fuzz
from benchmarks.fuzz_files import damaged_files, formats
from benchmarks.fuzz_inputs import Drawer, Tally, attempt
from benchmarks.fuzz_models import judged
from surefoot.bus.codec import json_schema
from surefoot.errors import SurefootError
from surefoot.schemas.hw import Imu
from surefoot.schemas.state import GaitState


@pytest.mark.parametrize("model", [Imu, GaitState])
def test_values_are_of_their_schema_but_at_its_limits(model: type) -> None:
    schema = json_schema(model)
    draw = [Drawer(schema, Random(seed)).value() for seed in range(50)]
    assert draw == [Drawer(schema, Random(seed)).value() for seed in range(50)]
    good = sum(jsonschema.Draft202012Validator(schema).is_valid(value) for value in draw)
    assert good > 10


def test_what_is_no_typed_error_is_a_finding() -> None:
    def fail(error: Exception) -> None:
        raise error

    tally = Tally()
    for error in (SurefootError("x", "one sentence"), zlib.error("raw"), SurefootError("x", "Traceback of some call")):
        attempt(tally, "it", b"data", lambda error=error: fail(error))
    attempt(tally, "it", b"data", lambda: None)
    assert (tally.inputs, tally.taken, tally.refused, len(tally.findings)) == (4, 1, 2, 2)


def test_no_message_or_frame_of_a_seed_is_a_finding() -> None:
    tally = Tally()
    for name, model in fuzz.models().items():
        fuzz.messages(tally, name, model, 15, seed=1)
    fuzz.frames(tally, 150, seed=1)
    assert tally.findings == []
    assert tally.taken > 100
    assert tally.refused > 300


@pytest.mark.parametrize("kind", ["height map", "floor map", "landmarks", "scenario", "walk memory", "log"])
def test_no_file_of_a_seed_is_a_finding(kind: str, tmp_path: Path) -> None:
    tally = Tally()
    for each in formats(tmp_path):
        if each.name == kind:
            damaged_files(tally, each, 30, tmp_path, seed=3)
    assert tally.findings == []


def test_changed_models_and_policies_are_refused_or_decide_no_worse(tmp_path: Path) -> None:
    for what, tally, _ in judged(60, 2, tmp_path):
        assert tally.findings == [], what
        assert tally.inputs == tally.taken + tally.refused == 60
        assert tally.taken > 0
