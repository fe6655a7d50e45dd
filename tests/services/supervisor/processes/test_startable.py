"""Unknown names in a compose file or a scenario are refused by name, before any process is started."""

from dataclasses import replace
from pathlib import Path

import pytest

from surefoot.files import names
from surefoot.lab.cli.output import near
from surefoot.lab.runs.local import run_local
from surefoot.robot.description import RobotError
from surefoot.robot.profiles import ROBOTS
from surefoot.services.supervisor.processes.reconcile import Observed, plan, wanted_from
from surefoot.services.supervisor.processes.startable import startable, system_of
from surefoot.services.supervisor.processes.system import SELF
from surefoot.services.supervisor.scenarios.scenario import find_scenario, load_scenario, parse_scenario
from surefoot.tables import TableError
from tests.services.refusals import refused

FILE = """
services:
  supervisor: {{command: surefoot supervise x --no-spawn}}
  legs: {{command: {command}}}
"""
HEALTHY = Observed(phase="running", healthy=True, healthy_since=0.0)
KILL = """
description = "ends a service"
compose = "ragno"
[[step]]
at_tick = 10
do = "kill"
service = "{service}"
"""


def system(folder: Path, command: str) -> str:
    file = folder / "some.yaml"
    file.write_text(FILE.format(command=command), encoding="utf-8")
    return str(file)


@pytest.mark.parametrize(
    ("command", "told"),
    [
        ("surefoot-service wlaker", ("'wlaker'", "did you mean 'walker'?", "estimator")),
        ("surefoot-service", ("no service ''", "walker")),
        ("python -m services.wlaker", ("no module 'services.wlaker'",)),
        ("python -m no_such_package.driver", ("no module 'no_such_package.driver'",)),
        ("python -m", ("no module ''",)),
        ("python my_driver.py", ("no file 'my_driver.py'",)),
        ("./no-such-program", ("no program './no-such-program'",)),
    ],
)
def test_a_command_that_cannot_be_started_is_refused_by_name(
    tmp_path: Path, command: str, told: tuple[str, ...]
) -> None:
    with refused(TableError, field="services.legs.command") as caught:
        startable(system(tmp_path, command))
    for words in told:
        assert words in str(caught.value)


def test_what_is_there_is_found_without_being_imported(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "__init__.py").write_text("raise RuntimeError('imported')\n", encoding="utf-8")
    (tmp_path / "mine" / "driver.py").write_text("", encoding="utf-8")
    for command in ("python -m mine.driver", "python mine/driver.py", "surefoot-service walker", "sh -c true"):
        assert tuple(startable(system(tmp_path, command)).services) == ("supervisor", "legs")


def test_everything_that_comes_with_the_project_can_be_started() -> None:
    assert {startable(name).name for name in names("compose", ".yaml")}
    assert {system_of(load_scenario(find_scenario(name))).name for name in names("scenarios", ".toml")}


def test_a_system_takes_another_robot_a_name_or_a_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder = tmp_path / "mine"
    folder.mkdir()
    (folder / "robot.toml").write_text((ROBOTS / "lupo" / "robot.toml").read_text())
    monkeypatch.chdir(tmp_path)
    for given, place in (("lupo", "lupo"), ("./mine", str(folder)), ("mine", str(folder))):
        compose = startable("ragno", robot=given)
        assert {service.environment["SUREFOOT_ROBOT"] for service in compose.services.values()} == {place}
        assert compose.robot == place
        assert compose.name == Path(place).name
        assert system_of(replace(load_scenario("stand"), robot=given)) == compose
    with pytest.raises(RobotError, match="known are"):
        startable("ragno", robot="other")


def test_a_scenario_kills_only_what_its_system_has() -> None:
    assert system_of(parse_scenario(KILL.format(service="walker"))).name == "ragno"
    for nobody in ("wlaker", "supervisor"):
        with refused(TableError, field="step[0].service") as caught:
            system_of(parse_scenario(KILL.format(service=nobody)))
        assert repr(nobody) in str(caught.value)


def test_a_scenario_configures_only_what_its_system_has() -> None:
    text = 'description = "x"\n[config.{service}]\nask_footholds = false\n'
    assert system_of(parse_scenario(text.format(service="walker"))).name == "ragno"
    with refused(TableError, field="config.navigator") as caught:
        system_of(parse_scenario(text.format(service="navigator")))
    assert "footholds" in str(caught.value)


@pytest.mark.parametrize(
    ("line", "code", "field"),
    [
        ("ask_foothold = false", "unknown_key", "config.walker.ask_foothold"),
        ('ask_footholds = "soon"', "value", "config.walker.ask_footholds"),
    ],
)
def test_a_scenario_gives_a_service_only_what_it_takes(line: str, code: str, field: str) -> None:
    scenario = parse_scenario(f'description = "x"\n[config.walker]\n{line}\n')
    for use in (system_of, run_local):
        with refused(TableError, code, field):
            use(scenario)


def test_nothing_is_started_for_a_wrong_name(surefoot, place, tmp_path: Path) -> None:
    file = system(tmp_path, "surefoot-service wlaker")
    scenario = tmp_path / "some.toml"
    scenario.write_text(f'description = "x"\ncompose = "{file}"\n', encoding="utf-8")
    for words in (("up", file), ("run", scenario)):
        done = surefoot(*words)
        assert (done.returncode, len(done.stderr.splitlines())) == (2, 1), done.stderr
        assert "did you mean 'walker'?" in done.stderr
    assert not (place[0] / "state").exists()
    assert not (place[0] / "runs").exists()


def test_paths_are_printed_as_one_would_type_them_here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    assert near(tmp_path / "runs" / "run.mcap") == near(Path("runs/run.mcap")) == "runs/run.mcap"
    assert near(tmp_path.parent / "x.html") == near(Path("../x.html")) == str(tmp_path.parent / "x.html")


@pytest.mark.parametrize("name", names("compose", ".yaml"))
@pytest.mark.parametrize("code", [0, 1, -9])
def test_a_service_of_ours_that_somebody_else_ended_is_started_again(name: str, code: int) -> None:
    wanted = [wanted_from(service) for service in startable(name).services.values()]
    ended = Observed(phase="exited", since=0.0, exit_code=code, failures=1)
    for one in (service.name for service in wanted if service.name != SELF):
        observed = {**{other.name: HEALTHY for other in wanted}, one: ended}
        actions = plan(wanted, observed, 100.0)
        assert [(action.verb, action.service) for action in actions] == [("start", one)]
