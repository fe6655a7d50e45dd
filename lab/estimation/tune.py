"""Tuning of the noise parameters of an estimator for the least error on a set of logs, other than the scored ones."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from surefoot.services.estimator.params import EstimatorParams

from .log import Log
from .scores import score
from .track import track

Range = tuple[float, float, float]

FACTORS = (3.0, 1.5)
"""Step factors of the search, one pass each: each parameter is multiplied or divided by it while the error falls."""
SEARCHED: dict[str, dict[str, Range]] = {
    "inekf": {
        "sigma_c": (1e-3, 1e-5, 5e-2), "sigma_q": (0.035, 0.01, 5.0), "sigma_w": (0.0054, 0.002, 0.5),
        "sigma_p": (8e-4, 1e-4, 5e-3),
    },
    "linear": {
        "sigma_a": (0.5, 0.05, 20.0), "sigma_v": (0.03, 1e-3, 1.0), "sigma_c": (5e-3, 1e-5, 1.0),
        "kp": (0.02, 1e-3, 5.0),
    },
    "ekf": {"sigma_v": (0.015, 5e-4, 0.5), "sigma_q": (0.035, 0.01, 5.0), "sigma_w": (0.0054, 0.002, 0.5)},
    "paper": {"sigma_v": (0.015, 5e-4, 0.5), "sigma_q": (0.035, 0.01, 5.0), "sigma_w": (0.0054, 0.002, 0.5)},
}  # fmt: skip
"""Noise parameters that the tuning varies, by estimator and name: (initial value, minimum, maximum)."""
GRID: dict[str, tuple[dict[str, float], ...]] = {
    "inekf": tuple({"sigma_c": c, "sigma_q": s, "sigma_w": s} for c in (0.1, 1.0, 5.0) for s in (1.0, 4.0, 15.0)),
    "linear": tuple({"sigma_a": a, "kp": k} for a in (0.3, 1.0, 5.0) for k in (1.0, 10.0)),
    "ekf": tuple({"sigma_v": v, "sigma_q": s} for v in (0.3, 1.0) for s in (1.0, 4.0)),
    "paper": tuple({"sigma_v": v, "sigma_q": s} for v in (0.3, 1.0) for s in (1.0, 4.0)),
}
"""Factors on the initial noise parameters, by estimator; the combination of least error starts the search."""
PENALTY = 1e3  # m/s, of a track that is not finite


def start(name: str, log: Log) -> dict[str, Any]:
    """Return the noise parameters at which the search begins: those of the log's sensors if known, else defaults."""
    out: dict[str, Any] = {key: first for key, (first, _, _) in SEARCHED[name].items()}
    known: Mapping[str, Any] = log.sensors
    if log.robot is not None:
        p = EstimatorParams.from_robot(log.robot)
        known = {"sigma_w": p.sigma_w, "sigma_q": p.sigma_q}
        if name == "inekf":
            out["bias_a"] = p.acc_bias_sd
    return out | {key: value for key, value in known.items() if key in out}


def tune(name: str, logs: Sequence[Log], measure: str = "rmse") -> dict[str, Any]:
    """Return the noise parameters of an estimator that give the least mean error over some logs, found by search.

    Args:
        name: name of an estimator; for those without noise the result is empty.
        logs: logs to score; one configuration for all.
        measure: `rmse` or `smooth` of the score.

    Returns:
        Options by name. For `inekf` with or without the points of the soles, whichever is better.
    """
    if name not in SEARCHED:
        return {}
    if name != "inekf" or logs[0].points is None or logs[0].points.shape[1] == 1:
        return _search(name, logs, measure, {})[0]
    found = [_search(name, logs, measure, {"points": points}) for points in (False, True)]
    return min(found, key=lambda pair: pair[1])[0]


def _search(name: str, logs: Sequence[Log], measure: str, fixed: Mapping[str, Any]) -> tuple[dict[str, Any], float]:
    first = start(name, logs[0]) | dict(fixed)
    starts = [first | {key: first[key] * by for key, by in factors.items()} for factors in GRID[name]]
    costs = [_cost(name, logs, measure, options) for options in starts]
    least = min(costs)
    best = starts[costs.index(least)]
    for factor in FACTORS:
        for key, (_, low, high) in SEARCHED[name].items():
            for step in (factor, 1.0 / factor):
                moved = False
                while low <= best[key] * step <= high:
                    trial = best | {key: best[key] * step}
                    cost = _cost(name, logs, measure, trial)
                    if cost >= least:
                        break
                    best, least, moved = trial, cost, True
                if moved:
                    break
    return best, least


def _cost(name: str, logs: Sequence[Log], measure: str, options: Mapping[str, Any]) -> float:
    costs = [getattr(score(log, track(name, log, **options)), measure) for log in logs]
    cost = float(np.mean(costs))
    return cost if np.isfinite(cost) else PENALTY
