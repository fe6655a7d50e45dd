"""The sets of logs on which estimators are compared, each with seeds of its own for tuning."""

import hashlib
import json
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

from surefoot.lab.estimation import tune as tuning
from surefoot.lab.estimation.log import Log
from surefoot.lab.estimation.logs import DATA, HUMANOIDS, humanoid
from surefoot.lab.estimation.track import PEERS
from surefoot.lab.estimation.tune import SEARCHED, tune
from surefoot.lab.estimation.walks import SCENARIOS, cache_folder, walk
from surefoot.services.estimator import stream as service

from .synthetic import KINDS, synthesize

TUNING_SEEDS = range(100, 106)
"""Seeds of the logs on which referees are tuned; no score uses them."""
REFERENCES = ("inekf", "linear", "ekf", "paper", "kinematics", "kinematics_gyro")
"""Names of the reference estimators (referees) with which an estimator is compared."""
PAPER_SOURCES = ("params.py", "feet/mount.py", "paper/*.py")
"""Files of the estimator service that the filters of Wawrzynski et al. consist of; a change makes their tuned noise
stale."""


@dataclass(frozen=True)
class LogSet:
    """Set of logs of one kind, made by seed; a set recorded by others is a single log.

    Referees (estimators of others) are tuned on that log as well, which favours them.
    """

    name: str
    make: Callable[[int], Log]
    drawn: bool = True  # by seed

    def logs(self, seeds: Iterable[int]) -> list[Log]:
        """Return the logs of the set that are made with these seeds, one for each."""
        return [self.make(seed) for seed in seeds] if self.drawn else [self.make(0)]


@cache
def _synthetic(kind: str, seed: int) -> Log:
    return synthesize(KINDS[kind], seed)


@cache
def _walk(name: str, seed: int) -> Log:
    return walk(name, seed).log


@cache
def _humanoid(name: str, seed: int) -> Log:
    return humanoid(name)


def _bound(make: Callable[[str, int], Log], name: str) -> Callable[[int], Log]:
    return lambda seed: make(name, seed)


def synthetic_sets(kinds: Iterable[str] = ("twist", "turn", "slip", "edges", "false")) -> list[LogSet]:
    """Return sets of synthetic walks of a biped, one for each kind of disturbance."""
    return [LogSet(kind, _bound(_synthetic, kind)) for kind in kinds]


def walk_sets(names: Iterable[str] = tuple(SCENARIOS)) -> list[LogSet]:
    """Return sets of closed-loop walks of the simulated robots, one for each name in `SCENARIOS`."""
    return [LogSet(name, _bound(_walk, name)) for name in names]


def humanoid_sets() -> list[LogSet]:
    """Return sets of logs of real and simulated humanoids by others, as far as they are on this machine."""
    return [LogSet(name, _bound(_humanoid, name), drawn=False) for name in HUMANOIDS if (DATA / f"{name}.npz").exists()]


def tuned(chosen: LogSet, name: str, measure: str = "rmse", fresh: bool = False) -> dict[str, Any]:
    """Return the noise parameters with which a referee fits a set of logs best, searched for once and kept in a file.

    Args:
        chosen: the set of logs.
        name: name of the referee; estimators without tuned noise give an empty table.
        measure: error of the score that is to be least, `rmse` or `smooth`.
        fresh: search again, though nothing of logs and code has changed.
    """
    if name not in SEARCHED:
        return {}
    logs = chosen.logs(TUNING_SEEDS)
    digest = hashlib.sha256(b"".join(path.read_bytes() for path in _sources(name)))
    for log in logs:
        for part in (log.w, log.q, log.foot_position, log.contact):
            digest.update(part.tobytes())
    kept = cache_folder() / f"noise-{chosen.name}-{name}-{measure}-{digest.hexdigest()[:12]}.json"
    if kept.exists() and not fresh:
        return json.loads(kept.read_text())
    found = tune(name, logs, measure)
    kept.parent.mkdir(parents=True, exist_ok=True)
    kept.write_text(json.dumps(found))
    return found


def _sources(name: str) -> list[Path]:
    """Return the files on which the tuned noise of a reference estimator depends."""
    room = Path(str(tuning.__file__)).parent
    files = [room / f"{module}.py" for module in ("tune", "scores", "log")]
    if name in PEERS:
        return [*files, *sorted((room / "peers").glob("*.py"))]
    service_room = Path(str(service.__file__)).parent
    return [*files, *(path for pattern in PAPER_SOURCES for path in sorted(service_room.glob(pattern)))]
