"""The scenario reader: what it accepts, and that it names what it refuses."""

from pathlib import Path

import pytest

from surefoot.lockstep.config import load_config
from surefoot.schemas.cmd import WalkCommand
from surefoot.schemas.sim import PushRequest
from surefoot.services.navigator.config import NavigatorConfig
from surefoot.services.supervisor.scenarios.scenario import (
    ScenarioError,
    find_scenario,
    load_scenario,
    parse_scenario,
    scenario_of,
)
from tests.services.refusals import refused

HEAD = 'description = "x"\n'


def test_reads_every_part():
    scenario = parse_scenario(
        """
        name = "two-things"
        description = "walks and is pushed"
        compose = "ragno"
        seed = 7
        policy = "degrade"
        actuation_delay_ticks = 0
        max_duration_s = 12.5
        settle_s = 0.1

        [world]
        terrain = "hills"
        amplitude = 0.087
        map_profile = "exact"

        [[step]]
        when = "ready"
        after_s = 0.5
        do = "walk"
        distance = 1.5

        [[step]]
        at_tick = 400
        do = "push"
        force = [0, 5, 0]
        duration = 0.2

        [[step]]
        at_tick = 500
        do = "kill"
        service = "estimator"

        [config.navigator]
        params = "nao"
        set = ['conduct.looks=2', "conduct.look=1"]

        [limits]
        no_fall = true
        min_distance_m = 1.4
        """
    )
    assert load_config(NavigatorConfig, "navigator", None, scenario.environment).set == (
        "conduct.looks=2", "conduct.look=1",
    )  # fmt: skip
    assert (scenario.name, scenario.seed, scenario.policy, scenario.max_ticks) == ("two-things", 7, "degrade", 1250)
    assert (scenario.world.terrain, scenario.world.amplitude) == ("hills", 0.087)
    walk, push, kill = scenario.steps
    assert walk.request == WalkCommand(action="walk", distance=1.5)
    assert (walk.when, walk.after_s, walk.at_tick) == ("ready", 0.5, None)
    assert push.request == PushRequest(force=(0.0, 5.0, 0.0), duration=0.2)
    assert (kill.service, kill.request) == ("estimator", None)
    assert scenario.limits == {"no_fall": 0.0, "min_distance_m": 1.4}


def test_keys_make_the_scenario_of_their_file() -> None:
    keys = {"description": "x", "world": {"terrain": "hills"}, "step": [{"when": "ready", "do": "walk"}]}
    text = f"{HEAD}[world]\nterrain = 'hills'\n[[step]]\nwhen = 'ready'\ndo = 'walk'\n"
    assert scenario_of(keys) == parse_scenario(text)
    assert scenario_of({**keys, "name": "mine"}).name == "mine"


@pytest.mark.parametrize(
    ("text", "code", "field"),
    [
        ("", "missing", "description"),
        (HEAD + "sed = 1", "unknown_key", "sed"),
        (HEAD + "seed = -1", "value", "seed"),
        (HEAD + "seed = 'x'", "type", "seed"),
        (HEAD + 'name = "A b"', "value", "name"),
        (HEAD + 'policy = "wait"', "value", "policy"),
        (HEAD + "max_duration_s = nan", "value", "max_duration_s"),
        (HEAD + "[world]\nterain = 'flat'", "unknown_key", "world.terain"),
        (HEAD + "[world]\nfriction = -1.0", "value", "world.friction"),
        (HEAD + "[world]\nfriction = inf", "value", "world.friction"),
        (HEAD + "[config.navigator]\nset = [{}]", "type", "config.navigator.set"),
        (HEAD + "[limits]\nmin_distance = 1", "unknown_key", "limits.min_distance"),
        (HEAD + "[limits]\nno_fall = 1", "type", "limits.no_fall"),
        (HEAD + "[[step]]\ndo = 'walk'", "missing", "step[0].at_tick"),
        (HEAD + "[[step]]\ndo = 'walk'\nat_tick = 1\nwhen = 'ready'", "missing", "step[0].at_tick"),
        (HEAD + "[[step]]\ndo = 'wolk'\nat_tick = 1", "value", "step[0].do"),
        (HEAD + "[[step]]\ndo = 'walk'\nwhen = 'redy'", "value", "step[0].when"),
        (HEAD + "[[step]]\ndo = 'walk'\nat_tick = 1\nafter_s = 1.0", "value", "step[0].after_s"),
        (HEAD + "[[step]]\ndo = 'walk'\nat_tick = 1\ndistence = 1.0", "unknown_key", "step[0].distence"),
        (HEAD + "[[step]]\ndo = 'walk'\nat_tick = 1\naction = 'turn'", "unknown_key", "step[0].action"),
        (HEAD + "[[step]]\ndo = 'push'\nat_tick = 1\nforce = [1.0, 0.0]\nduration = 1.0", "missing", "step[0].force.2"),
        (HEAD + "[[step]]\ndo = 'fault'\nat_tick = 1\nkind = 'gremlin'", "value", "step[0].kind"),
        (HEAD + "[[step]]\ndo = 'kill'\nat_tick = 1", "missing", "step[0].service"),
        (HEAD + "seed = 2147483648", "value", "seed"),
        (HEAD + "actuation_delay_ticks = -1", "value", "actuation_delay_ticks"),
        (HEAD + "actuation_delay_ticks = 6", "value", "actuation_delay_ticks"),
        (HEAD + "max_duration_s = 1e9", "value", "max_duration_s"),
        (HEAD + "settle_s = -0.1", "value", "settle_s"),
        (HEAD + "settle_s = 60.1", "value", "settle_s"),
        (HEAD + "settle_s = inf", "value", "settle_s"),
        (HEAD + "[limits]\nmin_distance_m = nan", "value", "limits.min_distance_m"),
        (HEAD + "step = []", "type", "step"),
        (HEAD + "[[step]]\ndo = 'walk'\nat_tick = -1", "value", "step[0].at_tick"),
        (HEAD + "[[step]]\ndo = 'walk'\nat_tick = 1000000001", "value", "step[0].at_tick"),
        (HEAD + "[[step]]\ndo = 'walk'\nwhen = 'ready'\nafter_s = -0.1", "value", "step[0].after_s"),
        (HEAD + "[[step]]\ndo = 'walk'\nwhen = 'ready'\nafter_s = 1e9", "value", "step[0].after_s"),
        (HEAD + 2 * "[[step]]\ndo = 'push'\nat_tick = 1\nforce = [1.0, 0.0, 0.0]\nduration = 1.0\n", "value", "step"),
        ("description = ", "syntax", "file"),
    ],
)
def test_refuses_by_name(text, code, field):
    with refused(ScenarioError, code, field) as caught:
        parse_scenario(text, Path("some.toml"))
    assert str(caught.value).startswith("some.toml")


@pytest.mark.parametrize(
    ("text", "nearest"),
    [
        (HEAD + "[limits]\nmax_tilt = 1", "max_tilt_deg"),
        (HEAD + "[world]\nterain = 'flat'", "terrain"),
        (HEAD + "[world]\nobstacles = [{ centre = [1, 0], sped = 1 }]", "speed"),
    ],
)
def test_an_unknown_key_names_the_nearest(text, nearest):
    with pytest.raises(ScenarioError, match=f"did you mean '{nearest}'"):
        parse_scenario(text)


def test_an_unknown_scenario_names_the_ones_there_are():
    with pytest.raises(ScenarioError, match="did you mean 'rough-terrain'"):
        find_scenario("rough-terain")


def test_finds_by_name_and_by_path():
    path = find_scenario("flat")
    assert load_scenario(path) == load_scenario(find_scenario(str(path)))
