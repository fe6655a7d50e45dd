"""Parameters of a running service: read by anybody, changed by name between ticks, all or none."""

import json

import pytest
from pydantic import Field

from surefoot.errors import CallError, ConfigError
from surefoot.lockstep.config import ServiceConfig, changed
from surefoot.schemas.system import ConfigRequest, ConfigureRequest
from surefoot.schemas.topics import CONFIG_GET, CONFIGURE
from tests.surefoot.expect import expect_error
from tests.surefoot.lockstep.node_bench import Bench, Subject


class Tuned(ServiceConfig):
    live = ("gain", "half")
    gain: float = Field(default=1.0, ge=0, le=2, description="no unit")
    half: float | None = Field(default=None, description="no unit")
    legs: int = Field(default=4, description="fixed at the start")


class Tunable(Subject):
    Config = Tuned

    def __init__(self) -> None:
        super().__init__()
        self.config = Tuned(gain=0.5)
        self.renewed: list[float] = []

    def on_config(self) -> None:
        self.renewed.append(self.config.gain)


@pytest.fixture
def bench() -> Bench:
    found = Bench(Tunable())
    for query in (CONFIG_GET.of("estimator"), CONFIGURE.of("estimator")):
        found.bus.pump_with(query, found.node.pump)
    return found


def ask(bench, **values):
    return bench.bus.call(
        CONFIGURE.of("estimator"), ConfigureRequest(values={name: str(value) for name, value in values.items()})
    )


def shown(reply):
    return {row.name: json.loads(row.value) for row in reply.parameters}


def test_all_parameters_are_reported_with_defaults_and_whether_they_are_live(bench):
    reply = bench.bus.call(CONFIG_GET.of("estimator"), ConfigRequest())
    assert shown(reply) == {"robot": "ragno", "gain": 0.5, "half": None, "legs": 4}
    assert {row.name: row.live for row in reply.parameters} == {
        "robot": False, "gain": True, "half": True, "legs": False,
    }  # fmt: skip
    assert json.loads(reply.parameters[1].default) == 1.0
    assert reply.config_hash == bench.node.health().config_hash


def test_a_live_parameter_changes_between_ticks_and_the_service_is_called(bench):
    before = bench.node.health().config_hash
    reply = ask(bench, gain=1.5, half=0.25)
    assert shown(reply) == {"robot": "ragno", "gain": 1.5, "half": 0.25, "legs": 4}
    assert bench.service.renewed == [1.5]
    assert bench.node.health().config_hash == reply.config_hash != before
    assert any("gain" in line.text and "0.5 -> 1.5" in line.text for line in bench.out if hasattr(line, "text"))


@pytest.mark.parametrize(
    ("values", "code", "words"),
    [
        ({"gain": 2.5}, "invalid", ("gain", "2.5", "2")),
        ({"gain": "much"}, "invalid", ("gain", "much")),
        ({"gain": "{a = [1]}"}, "invalid", ("gain", "valid number", "{'a': [1]}")),
        ({"gain": "true"}, "invalid", ("gain", "True")),
        ({"gain": "nan"}, "invalid", ("gain", "nan")),
        ({"gain": 1.0, "legs": 6}, "not_live", ("legs", "gain, half")),
        ({"gian": 1.0}, "unknown_key", ("gian", "gain")),
    ],
)
def test_a_wrong_change_is_refused_by_name_and_nothing_changes(bench, values, code, words):
    before = bench.service.config
    with pytest.raises(CallError) as caught:
        ask(bench, **values)
    assert all(word in str(caught.value) for word in words), caught.value
    assert code in (caught.value.code, str(caught.value)) or code in str(caught.value)
    assert bench.service.config == before
    assert bench.service.renewed == []


def test_no_change_changes_nothing(bench):
    assert shown(ask(bench))["gain"] == 0.5


def test_a_value_that_was_set_at_the_start_stays_beside_a_change():
    config = changed(Tuned(gain=0.5, legs=6), "estimator", {"half": "1.0"})
    assert (config.gain, config.half, config.legs) == (0.5, 1.0, 6)
    with expect_error(ConfigError, "not_live", text="live are: none"):
        changed(ServiceConfig(), "estimator", {"robot": "nao"})
