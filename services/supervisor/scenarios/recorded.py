"""Facts on a run in its recording: the scenario as run, the system, and versions of the software.

They are sent to the recorder as one JSON text (`RecorderConfig.about`); each table becomes metadata of the file.
"""

import json
import platform
from collections.abc import Iterable, Mapping
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from surefoot.errors import SurefootError
from surefoot.robot.reader import load_robot
from surefoot.schemas.sim import ResetRequest
from surefoot.schemas.topics import CMD_WALK
from surefoot.tables import validated
from surefoot.version import numbers

from .limits import LIMITS
from .scenario import COMMANDS, Scenario, ScenarioError

RUN, SCENARIO, VERSIONS, FILES = "run", "scenario", "versions", "files"
"""Names of the metadata tables of a recording: facts on the run, scenario, versions of the software, attached files;
the files that `FILES` lists, path by name, are attached to the recording instead of stored as metadata."""
LARGEST = 96 * 1024
"""Largest scenario that is recorded, bytes; an environment variable holds no more than 128 kB."""
_COMPUTING = ("numpy", "numba", "mujoco", "clarabel", "pydantic")


def about_run(
    robot: str,
    system: str,
    services: Iterable[str],
    request: ResetRequest,
    scenario: Scenario | None = None,
    files: Mapping[str, str] | None = None,
) -> str:
    """Return the facts on a run as JSON text for the recorder (`RecorderConfig.about`).

    Args:
        robot: name or folder of the robot.
        system: name of the system.
        services: names of its services.
        request: request by which the run begins.
        scenario: scenario that is run; None = none.
        files: paths of the files to attach, by name.
    """
    run = {
        "system": system, "services": " ".join(services), "robot_hash": load_robot(robot).hash, "mode": request.mode,
        "actuation_delay_ticks": str(request.actuation_delay_ticks),
        "world": request.world.model_dump_json(exclude_none=True),
    }  # fmt: skip
    tables: dict[str, dict[str, str]] = {RUN: run, VERSIONS: present_versions(), FILES: dict(files or {})}
    if scenario is not None:
        run["scenario"] = scenario.name
        text = json.dumps(scenario_table(scenario))
        if len(text) <= LARGEST:
            tables[SCENARIO] = {"json": text}
    return json.dumps(tables)


def scenario_table(scenario: Scenario) -> dict[str, Any]:
    """Return a scenario as the content of a scenario file; such a file gives an equal scenario when read."""
    plain = ("name", "description", "compose", "seed", "actuation_delay_ticks", "policy", "max_duration_s", "settle_s")
    steps: list[dict[str, Any]] = []
    for step in scenario.steps:
        table: dict[str, Any] = {"do": step.do}
        table |= {"at_tick": step.at_tick} if step.when is None else {"when": step.when, "after_s": step.after_s}
        if step.request is None:
            table["service"] = step.service
        else:
            own = {"at_tick"} | ({"action"} if COMMANDS[step.do][0] is CMD_WALK else set())
            table |= step.request.model_dump(mode="json", exclude_unset=True, exclude=own)
        steps.append(table)
    return {
        **{name: getattr(scenario, name) for name in plain},
        "world": scenario.world.model_dump(mode="json", exclude_none=True),
        "config": {service: dict(fields) for service, fields in scenario.config.items()},
        "step": steps,
        "limits": {name: True if LIMITS[name].yes_no else value for name, value in scenario.limits.items()},
    }


def recorded_scenario(metadata: dict[str, dict[str, str]], path: Path) -> Scenario:
    """Return the scenario that a recording carries.

    Raises:
        SurefootError: the recording has no scenario.
        ScenarioError: the scenario does not fit this version.
    """
    text = metadata.get(SCENARIO, {}).get("json")
    if text is None:
        why = "it was not made by `surefoot run`" if "scenario" not in metadata.get(RUN, {}) else "it was too long"
        raise SurefootError("invalid", f"{path} carries no scenario: {why}", "recording")
    try:
        return validated(Scenario, json.loads(text), ScenarioError)
    except json.JSONDecodeError as error:
        raise ScenarioError("syntax", "scenario", f"is not JSON: {error}", str(path)) from None


def present_versions() -> dict[str, str]:
    """Return the versions of interpreter, machine and libraries that compute here, by name."""
    found = {"python": platform.python_version(), "machine": platform.machine(), "numbers": numbers()}
    for name in _COMPUTING:
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            continue
    return found
