"""Configuration: who wins, and errors that name the source, the field, the value and what is allowed."""

from pathlib import Path
from typing import ClassVar, Literal

import pytest
from pydantic import Field, ValidationError

from surefoot.errors import ConfigError
from surefoot.lockstep.config import ServiceConfig, changed, config_hash, load_config
from tests.surefoot.expect import expect_error


class Example(ServiceConfig):
    """A configuration with one field of each kind."""

    live: ClassVar[tuple[str, ...]] = ("rate",)
    rate: float = Field(default=1.0, gt=0, le=10)
    mode: Literal["ekf", "best"] = "ekf"
    expect: tuple[str, ...] = ()
    path: str | None = None
    on: bool = True


@pytest.fixture
def file(tmp_path: Path) -> Path:
    path = tmp_path / "surefoot.toml"
    path.write_text('[example]\nrate = 2.0\nmode = "best"\n[walker]\nstride_m = 0.1\n')
    return path


def load(file: Path | None = None, environ: dict[str, str] | None = None, *overrides: str) -> Example:
    return load_config(Example, "example", file, environ, overrides)


def test_defaults_then_file_then_environment_then_command_line(file: Path) -> None:
    assert load().rate == 1.0
    assert load(file).rate == 2.0
    assert load(file, {"SUREFOOT_EXAMPLE_RATE": "3"}).rate == 3.0
    assert load(file, {"SUREFOOT_EXAMPLE_RATE": "3"}, "rate=4").rate == 4.0
    assert load(file).mode == "best"


def test_own_variable_beats_that_of_all_services() -> None:
    assert load(None, {"SUREFOOT_ROBOT": "messor"}).robot == "messor"
    assert load(None, {"SUREFOOT_ROBOT": "messor", "SUREFOOT_EXAMPLE_ROBOT": "ragno"}).robot == "ragno"


@pytest.mark.parametrize(
    ("override", "value"),
    [
        ("rate=2.5", 2.5),
        ("on=false", False),
        ('expect=["a","b"]', ("a", "b")),
        ("path=/tmp/x = y.mcap", "/tmp/x = y.mcap"),
        ("path=", ""),
        ('path="7"', "7"),
        ("path=" + "[" * 100_000, "[" * 100_000),
    ],
)
def test_values_are_read_as_toml_where_they_can_be(override: str, value: object) -> None:
    assert getattr(load(None, None, override), override.partition("=")[0]) == value


@pytest.mark.parametrize(
    ("environ", "overrides", "code", "field", "words"),
    [
        ({}, ["speed=1"], "unknown_key", "speed", ["speed", "command line", "mode", "rate"]),
        ({}, ["speed"], "invalid", None, ["'speed'", "field=value"]),
        ({}, ["rate=0"], "invalid", "rate", ["greater than 0", "got 0"]),
        ({}, ["rate=nan"], "invalid", "rate", ["finite", "nan"]),
        ({}, ["rate=fast"], "invalid", "rate", ["number", "'fast'"]),
        ({}, ["mode=ekff"], "invalid", "mode", ["'ekf'", "'best'", "'ekff'"]),
        ({"SUREFOOT_EXAMPLE_SPEED": "1"}, [], "unknown_key", "speed", ["SUREFOOT_EXAMPLE_SPEED", "rate"]),
        ({"SUREFOOT_EXAMPLE_ON": "maybe"}, [], "invalid", "on", ["'maybe'"]),
    ],
)
def test_errors_name_field_value_and_what_is_allowed(
    environ: dict[str, str], overrides: list[str], code: str, field: str | None, words: list[str]
) -> None:
    with expect_error(ConfigError, code, field=field, without="\n") as caught:
        load(None, environ, *overrides)
    for word in words:
        assert word in caught.value.message


@pytest.mark.parametrize(
    ("text", "code"),
    [
        ("[example]\nspeed = 1\n", "unknown_key"),
        ("[example]\nrate = 'x'\n", "invalid"),
        ("[example\n", "malformed"),
        ("example = 3\n", "invalid"),
    ],
)
def test_errors_of_a_file_name_it(tmp_path: Path, text: str, code: str) -> None:
    path = tmp_path / "c.toml"
    path.write_text(text)
    with expect_error(ConfigError, code, text="" if code == "invalid" else str(path)):
        load(path)


def test_a_file_that_cannot_be_read(tmp_path: Path) -> None:
    for path, content in ((tmp_path / "none.toml", None), (tmp_path, None), (tmp_path / "b.toml", b"\xff\xfe")):
        if content is not None:
            path.write_bytes(content)
        with expect_error(ConfigError, text=str(path)):
            load(path)


def test_hash_tells_effective_values_apart() -> None:
    assert config_hash(load()) == config_hash(load(None, None, "rate=1.0"))
    assert config_hash(load()) != config_hash(load(None, None, "rate=1.5"))


def test_hash_of_a_path_that_is_no_utf8() -> None:
    assert config_hash(load(None, {"SUREFOOT_ROBOT": "/r\udcff"})) != config_hash(load())


def test_variables_of_other_services_are_no_concern() -> None:
    assert load(None, {"SUREFOOT_WALKER_STRIDE_M": "0.1", "SUREFOOT_LISTEN": "tcp/x:1", "PATH": "/bin"}) == load()


def test_a_program_that_misspells_a_field_is_refused() -> None:
    with pytest.raises(ValidationError, match="speed"):
        Example.model_validate({"speed": 1})


def test_of_a_running_service_live_parameters_alone_are_changed() -> None:
    assert changed(load(), "example", {"rate": "3"}).rate == 3.0
    with expect_error(ConfigError, "not_live", field="mode", text="'mode'") as caught:
        changed(load(), "example", {"mode": "best"})
    assert "live are: rate" in caught.value.message
    with expect_error(ConfigError, "invalid", field="rate"):
        changed(load(), "example", {"rate": "11"})
    with expect_error(ConfigError, "unknown_key", field="speed"):
        changed(load(), "example", {"speed": "1"})
