"""Whether a system can be started at all, told before anything is: its programs, modules, services."""

import importlib.util
import os
import shutil
from importlib.machinery import PathFinder
from pathlib import Path

from surefoot.errors import ConfigError
from surefoot.files import find
from surefoot.lockstep.config import load_config
from surefoot.lockstep.discover import service_class, service_names
from surefoot.nearest import did_you_mean

from ..scenarios.scenario import Scenario, ScenarioError
from .compose import Compose, ComposeError, ComposeService, load_compose
from .system import SELF

PYTHONS = ("python", "python3")


def startable(system: str) -> Compose:
    """Return the system of that name or path.

    Raises:
        ComposeError: there is none, its file cannot be used, or a command names what is not there.
    """
    compose = load_compose(find("compose", system, ".yaml", ComposeError))
    for service in compose.services:
        if service.name != SELF:
            _check(service, compose)
    return compose


def system_of(scenario: Scenario) -> Compose:
    """Return the system of a scenario.

    Raises:
        ComposeError: the system cannot be started.
        ScenarioError: the scenario kills or configures a service that the system does not have, or gives one a
            field or a value that it does not take.
    """
    compose = startable(scenario.compose)
    known = [name for name in compose.service_names if name != SELF]
    named = [(f"step[{i}].service", step.service) for i, step in enumerate(scenario.steps) if step.do == "kill"]
    for field, name in (*named, *((f"config.{name}", name) for name in scenario.config)):
        if name not in known:
            message = f"got {name!r}{did_you_mean(name, known)}, {compose.name} has {', '.join(known)}"
            raise _refused(scenario, "unknown_name", field, message)
    for name in scenario.config:
        _check_config(scenario, compose.service(name))
    return compose


def _check_config(scenario: Scenario, service: ComposeService) -> None:
    """Raise ScenarioError where a service would refuse the configuration of a scenario at its start."""
    program, *words = service.command
    own = next((word for word in words if not word.startswith("-")), "")
    if program != "surefoot-service":
        return  # another program: only it knows what it takes
    kind = service_class(own)
    try:
        load_config(kind.Config, own, None, {**service.environment, **scenario.environment})
    except ConfigError as error:
        field = ".".join(filter(None, ("config", service.name, error.field)))
        code = "unknown_key" if error.code == "unknown_key" else "value"
        raise _refused(scenario, code, field, error.message) from None


def _refused(scenario: Scenario, code: str, field: str, message: str) -> ScenarioError:
    error = ScenarioError(code, field, message)
    error.file = scenario.name
    return error


def _check(service: ComposeService, compose: Compose) -> None:
    problem = _problem(service)
    if problem:
        error = ComposeError("unknown_name", f"services.{service.name}.command", problem)
        error.file = str(compose.path)
        raise error


def _problem(service: ComposeService) -> str:
    """What is wrong with a command, empty when nothing is."""
    program, *words = service.command
    if program == "surefoot-service":
        known = service_names()
        name = next((word for word in words if not word.startswith("-")), "")
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
    """Tell whether `python -m` would find a module, without importing anything."""
    first, *rest = module.split(".")
    more = service.environment.get("PYTHONPATH", "").split(os.pathsep)
    places = [os.getcwd(), *filter(None, more)]
    spec = PathFinder.find_spec(first, places) or (importlib.util.find_spec(first) if first else None)
    for name in rest:
        places = list(spec.submodule_search_locations or ()) if spec is not None else []
        spec = PathFinder.find_spec(name, places)
    return spec is not None
