"""Closed-loop walks of the simulated robots, recorded once and kept as columns in the user's cache."""

import hashlib
import os
import tempfile
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from surefoot.errors import SurefootError
from surefoot.record.columns import Columns, recorded_columns
from surefoot.robot.reader import load_robot
from surefoot.services.supervisor.scenarios.scenario import Scenario, find_scenario, load_scenario
from surefoot.state import user_home

from ..runs.local import run_local
from .log import Log
from .recorded import log_of_columns, published
from .track import Track

SCENARIOS = {"bioloid": "bioloid-walk", "nao": "nao-walk", "ragno-flat": "flat", "ragno-rough": "rough-terrain"}
"""Name of the simulator scenario of each recorded walk, by name of the walk."""
VARIANTS: dict[str, tuple[str, dict[str, Any]]] = {
    "bioloid-ice": ("bioloid", {"friction": 0.2}), "ragno-ice": ("ragno-flat", {"friction": 0.2}),
    "bioloid-adis16350": ("bioloid", {"imu_profile": "adis16350"}),
    "ragno-adis16350": ("ragno-flat", {"imu_profile": "adis16350"}),
}  # fmt: skip
"""Variants of simulated walks by name: (name of the walk, changed simulator options); estimators are not given the
change."""


@dataclass(frozen=True, eq=False)
class RecordedWalk:
    """Log of one simulated walk, with the estimates that the estimator service published in it."""

    log: Log
    published: Track
    ok: bool  # the scenario's verdict


def cache_folder() -> Path:
    """Return the folder of recorded walks in the user's cache; all of them can be made again."""
    base = os.environ.get("XDG_CACHE_HOME", "")
    return (Path(base) if os.path.isabs(base) else user_home() / ".cache") / "surefoot" / "estimation"


def walk(name: str, seed: int, fresh: bool = False) -> RecordedWalk:
    """Return a recorded walk of a simulated robot, from the cache if it is there.

    Args:
        name: name of the walk: bioloid, nao, ragno-flat, ragno-rough, or a variant of one.
        seed: seed of the scenario.
        fresh: run the scenario again, so that the published estimates are those of the present code.

    Raises:
        SurefootError: there is no such walk.
    """
    plain, changes = VARIANTS.get(name, (name, {}))
    if plain not in SCENARIOS:
        known = ", ".join((*SCENARIOS, *VARIANTS))
        raise SurefootError("invalid", f"got {name!r}; known are {known}", "walk")
    path = find_scenario(SCENARIOS[plain])
    key = hashlib.sha256(path.read_bytes() + str(changes or "").encode()).hexdigest()[:8]
    kept = cache_folder() / f"{name}-{seed}-{key}.npz"
    if fresh or not kept.exists():
        scenario = load_scenario(path)
        scenario = replace(scenario, world=scenario.world.model_copy(update=changes)) if changes else scenario
        columns, robot, ok = run_walk(scenario, seed)
        kept.parent.mkdir(parents=True, exist_ok=True)
        part = kept.with_suffix(f".{os.getpid()}.part.npz")
        np.savez_compressed(part, robot=robot, ok=ok, **columns)  # type: ignore[arg-type]
        part.replace(kept)
    with np.load(kept) as file:
        columns: Columns = {key: file[key] for key in file.files if key not in ("robot", "ok")}
        robot, ok = str(file["robot"]), bool(file["ok"])
    description = load_robot(robot)
    return RecordedWalk(log_of_columns(f"{name} {seed}", columns, description), published(columns, description), ok)


def run_walk(scenario: Scenario, seed: int) -> tuple[Columns, str, bool]:
    """Run a scenario in this process; return the columns of its recording, its robot, and True if its verdict is ok."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "walk.mcap"
        run = run_local(scenario, seed, recording=file)
        columns, robot = recorded_columns(file)
    return columns, robot, run.verdict.ok
