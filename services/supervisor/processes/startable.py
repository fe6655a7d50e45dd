"""Checks of a system before anything is started: its programs, modules, services and their configuration."""

import importlib.util
import os
import shutil
from collections.abc import Mapping
from importlib.machinery import PathFinder
from pathlib import Path

from surefoot.errors import ConfigError
from surefoot.lockstep.config import PREFIX, load_config
from surefoot.lockstep.discover import own_service_names, service_class, service_names
from surefoot.nearest import did_you_mean
from surefoot.robot.reader import robot_place

from ..scenarios.scenario import Scenario, ScenarioError
from .compose import Compose, ComposeError, ComposeService, load_compose
from .system import SELF

PYTHONS = ("python", "python3")


def startable(
    system: str,
    scenario: Scenario | None = None,
    environ: Mapping[str, str] | None = None,
    robot: str | None = None,
) -> Compose:
    """Return the system of a name or path after a check that all of it can be started.

    Args:
        system: name or path of the compose file.
        scenario: scenario that is to run in it, None = none.
        environ: environment of the caller, which its services inherit; None = none.
        robot: name or folder of the robot; None = that of the compose file.

    Raises:
        ComposeError: there is no such system, its file cannot be used, or a command names a program or module that is
            missing.
        ScenarioError: the scenario kills or configures a service that the system does not have, or gives one a
            field or a value that it does not take.
        ConfigError: a service would refuse a variable of the environment.
        RobotError: there is no such robot.
    """
    compose = load_compose(system)
    if robot is not None:
        compose = compose.of_robot(robot_place(robot))
    if scenario is not None:
        _check_names(scenario, compose)
    for service in compose.services.values():
        if service.name != SELF:
            _check(service, compose, scenario, environ or {})
    return compose


def system_of(scenario: Scenario, environ: Mapping[str, str] | None = None) -> Compose:
    """Return the system that a scenario names; raise the errors of `startable` if it cannot carry out the scenario."""
    return startable(scenario.compose, scenario, environ, scenario.robot)


def _check_names(scenario: Scenario, compose: Compose) -> None:
    """Refuse a scenario that kills or configures a service that the system does not have."""
    known = [name for name in compose.services if name != SELF]
    named = [(f"step[{i}].service", step.service) for i, step in enumerate(scenario.steps) if step.do == "kill"]
    for field, name in (*named, *((f"config.{name}", name) for name in scenario.config)):
        if name not in known:
            text = f"got {name!r}{did_you_mean(name, known)}, {compose.name} has {', '.join(known)}"
            raise ScenarioError("unknown_name", field, text, scenario.name)


def _check(service: ComposeService, compose: Compose, scenario: Scenario | None, environ: Mapping[str, str]) -> None:
    """Refuse a service that could not be started, or that would refuse its configuration."""
    problem = _problem(service)
    if problem:
        raise ComposeError("unknown_name", f"services.{service.name}.command", problem, str(compose.path))
    program, *words = service.command
    if program != "surefoot-service":
        return  # another program: only it knows what it takes
    name = next(word for word in words if not word.startswith("-"))
    variables = {**environ, **(scenario.environment if scenario else {}), **service.environment}
    if not any(variable.startswith(f"{PREFIX}{name.upper()}_") for variable in variables):
        return
    try:
        load_config(service_class(name).Config, name, None, variables)
    except ConfigError as error:
        if scenario is None or error.field not in scenario.config.get(service.name, ()):
            raise
        code, field = "unknown_key" if error.code == "unknown_key" else "value", f"config.{service.name}.{error.field}"
        raise ScenarioError(code, field, error.message, scenario.name) from None


def _problem(service: ComposeService) -> str:
    """Return why the command of a service cannot be started; empty if it can."""
    program, *words = service.command
    if program == "surefoot-service":
        name = next((word for word in words if not word.startswith("-")), "")
        if name in own_service_names():  # without a look at what other packages bring
            return ""
        known = service_names()
        return "" if name in known else f"no service {name!r}{did_you_mean(name, known)}; there are {', '.join(known)}"
    if program in PYTHONS and words[:1] == ["-m"]:
        module = words[1] if len(words) > 1 else ""
        return "" if _findable(module, service) else f"no module {module!r}; looked in this folder and the installation"
    if program in PYTHONS:
        file = words[0] if words and not words[0].startswith("-") else None
        return "" if file is None or Path(file).is_file() else f"no file {file!r} in {Path.cwd()}"
    path = service.environment.get("PATH", os.environ.get("PATH"))
    return "" if program == "surefoot" or shutil.which(program, path=path) else f"no program {program!r}"


def _findable(module: str, service: ComposeService) -> bool:
    """Return True if `python -m` would find a module; nothing is imported."""
    first, *rest = module.split(".")
    more = service.environment.get("PYTHONPATH", "").split(os.pathsep)
    places = [os.getcwd(), *filter(None, more)]
    spec = PathFinder.find_spec(first, places) or (importlib.util.find_spec(first) if first else None)
    for name in rest:
        places = list(spec.submodule_search_locations or ()) if spec is not None else []
        spec = PathFinder.find_spec(name, places)
    return spec is not None
