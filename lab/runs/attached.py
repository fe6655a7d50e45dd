"""Files besides the scenario that a run depends on (robot, models, maps), to be attached to its recording."""

import os
from collections.abc import Iterator, Mapping
from pathlib import Path

from surefoot.robot.reader import ROBOT_FILE, load_robot, robot_file
from surefoot.services.footholds.models.shipped import shipped
from surefoot.services.supervisor.processes.compose import Compose

LARGEST = 16 * 1024 * 1024
"""Largest size of a file that is attached to a recording, bytes; larger files are left out."""


def attached(compose: Compose, more: Mapping[str, str] | None = None) -> dict[str, str]:
    """Return the paths of the files of a run, by name in the recording: `robot.toml`, `<service>.<field><suffix>`.

    Args:
        compose: system that is run.
        more: further environment variables that configure services, e.g. of a scenario.
    """
    found = {ROBOT_FILE: robot_file(compose.robot)}
    for name, service in compose.services.items():
        found |= dict(_configured(name, {**service.environment, **(more or {})}))
    own = shipped(load_robot(compose.robot).name)
    if own is not None and "footholds" in compose.services:
        found.setdefault(f"footholds.slip_model{own.suffix}", own)
    return {name: str(path.resolve()) for name, path in found.items() if path.stat().st_size <= LARGEST}


def _configured(service: str, variables: Mapping[str, str]) -> Iterator[tuple[str, Path]]:
    """Yield (name in the recording, path) of each readable file that environment variables name for a service."""
    begin = f"SUREFOOT_{service.upper()}_"
    for name, value in variables.items():
        path = Path(value.strip('"'))
        if name.startswith(begin) and path.suffix and os.access(path, os.R_OK) and path.is_file():
            yield f"{service}.{name.removeprefix(begin).lower()}{path.suffix}", path
