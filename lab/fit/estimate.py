"""Numbers of a robot from recordings, each with an interval: the likeliest noises, times, and match probabilities."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize
from scipy.stats import t as student

from surefoot.errors import SurefootError
from surefoot.lab.fit import likelihood as lk
from surefoot.lab.fit.events import Run
from surefoot.services.navigator.policies import errors_of
from surefoot.services.navigator.policy.params import NavigationModel

Array = NDArray[np.float64]

Z95 = 1.959964
LEAST = 1e-5
"""A standard deviation is taken to be at least this (m or rad)."""
IMPOSSIBLE = 1e12
"""Of noises under which the filter breaks down."""
STEP = 1e-3
"""Of the differences that make gradient and curvature."""


@dataclass(frozen=True)
class Interval:
    """A number and its 95 % interval."""

    value: float
    low: float
    high: float
    count: int = 0
    """Samples it comes from; 0 where all recordings together decide."""


@dataclass
class Fitted:
    """What recordings say about a robot.

    Attributes:
        values: by dotted key of the model.
        runs: recordings used.
        sightings: landmarks matched in all.
        improvement: nats by which the recordings became likelier against the model to begin with.
    """

    values: dict[str, Interval] = field(default_factory=dict[str, Interval])
    runs: int = 0
    sightings: int = 0
    improvement: float = 0.0


@dataclass(frozen=True)
class Wanted:
    """One parameter of the likelihood."""

    index: int
    log: bool
    """Its logarithm is fitted: it is positive."""
    keys: tuple[str, ...]
    """Of the model, with {action} for all walks or turns."""
    factor: float = 1.0
    """From SI to the unit of the model."""


DEG = math.degrees(1.0)


def fit(runs: Sequence[Run], model: NavigationModel, show: Callable[[str], None] = lambda text: None) -> Fitted:
    """Return the numbers of the robot that made the recordings.

    Args:
        runs: recordings, see `events.read_run`.
        model: where the search begins, and what is not fitted.
        show: is called with progress.

    Raises:
        SurefootError: no recordings.
    """
    if not runs:
        raise SurefootError("unusable", "no recordings were given", "recordings")
    found = Fitted(runs=len(runs), sightings=int(sum((run.events[:, 0] == 2.0).sum() for run in runs)))
    _noises(runs, model, found, show)
    _durations(runs, model, found)
    _matches(runs, model, found)
    return found


def _begin(model: NavigationModel) -> Array:
    walk = next(action for action in model.used if action.kind == "walk")
    turn = next(action for action in model.used if action.kind == "turn")
    s, theta = model.sight, np.ones(lk.PARAMETERS)
    theta[[lk.ALONG, lk.ACROSS]] = walk.along_sd, walk.across_sd
    theta[lk.HEADING] = walk.heading_sd_deg / DEG
    theta[[lk.TURN_PLACE, lk.TURN_HEADING]] = turn.along_sd, turn.heading_sd_deg / DEG
    theta[[lk.RANGE, lk.SHARE, lk.BEARING]] = s.range_sd, s.range_sd_share, s.bearing_sd_deg / DEG
    theta[[lk.STANDING, lk.TILT]] = s.standing_share, s.tilt_sd_deg / DEG
    theta[lk.SWAY] = s.sway_sd
    theta[lk.PITCH] = s.pitch_deg / DEG
    theta[lk.DRIFT] = 10.0 * model.drift.known_sd_deg / DEG
    theta[lk.WANDER] = 10.0 * walk.drift_walk_deg / DEG
    positive = np.arange(lk.PARAMETERS) != lk.PITCH
    return np.where(positive, np.maximum(theta, LEAST), theta)


def _free(model: NavigationModel, runs: Sequence[Run]) -> tuple[Wanted, ...]:
    stood = any((run.events[run.events[:, 0] == 2.0, 5] > 0.0).any() for run in runs)
    kinds = {name.kind for name in model.used}
    turned = "turn" in kinds and any(_acted(run, model, "turn") for run in runs)
    spread = "sight.range_sd" if model.sight.range_sd > 0.0 else "sight.range_sd_share"
    walk, turn = "actions.{walk}.", "actions.{turn}."
    wanted = [
        Wanted(lk.ALONG, True, (walk + "along_sd",)),
        Wanted(lk.ACROSS, True, (walk + "across_sd",)),
        Wanted(lk.HEADING, True, (walk + "heading_sd_deg",), DEG),
        Wanted(lk.RANGE if spread == "sight.range_sd" else lk.SHARE, True, (spread,)),
        Wanted(lk.BEARING, True, ("sight.bearing_sd_deg",), DEG),
        Wanted(lk.DRIFT, True, ("drift.known_sd_deg",), 0.1 * DEG),
        Wanted(lk.FORWARD, False, (walk + "forward",)),
    ]
    if turned:
        wanted += [
            Wanted(lk.TURN_PLACE, True, (turn + "along_sd", turn + "across_sd")),
            Wanted(lk.TURN_HEADING, True, (turn + "heading_sd_deg",), DEG),
            Wanted(lk.TURNED, False, (turn + "turn_deg",)),
        ]
    if stood:
        wanted.append(Wanted(lk.STANDING, True, ("sight.standing_share",)))
    if model.sight.sway_sd > 0.0:
        wanted.append(Wanted(lk.SWAY, True, ("sight.sway_sd",)))
    if model.sight.tilt_sd_deg > 0.0:
        wanted.append(Wanted(lk.TILT, True, ("sight.tilt_sd_deg",), DEG))
        wanted.append(Wanted(lk.PITCH, False, ("sight.pitch_deg",), DEG))
    return tuple(wanted)


def _acted(run: Run, model: NavigationModel, kind: str) -> bool:
    names = list(model.actions)
    moves = run.events[run.events[:, 0] == 0.0, 1].astype(int)
    return any(model.actions[names[i]].kind == kind for i in np.unique(moves))


def _noises(runs: Sequence[Run], model: NavigationModel, found: Fitted, show: Callable[[str], None]) -> None:
    theta, wanted = _begin(model), _free(model, runs)
    if model.sight.tilt_sd_deg == 0.0:
        theta[lk.TILT] = 0.0
    if model.sight.sway_sd == 0.0:
        theta[lk.SWAY] = 0.0
    if model.sight.range_sd == 0.0 or model.sight.range_sd_share == 0.0:
        theta[lk.RANGE if model.sight.range_sd == 0.0 else lk.SHARE] = 0.0
    table = np.array([(a.forward, math.radians(a.turn_deg), float(a.kind == "walk")) for a in model.actions.values()])
    sd = np.array([max(model.filter.position_sd, 1e-3), max(math.radians(model.filter.heading_sd_deg), 1e-3)])
    starts = [np.array(run.start) for run in runs]
    shared = errors_of(model, sway=True)
    fades = np.array([min(shared.tilt_fade, 1e6), shared.sway_fade])

    def at(x: Array) -> Array:
        full = theta.copy()
        for value, item in zip(x, wanted, strict=True):
            full[item.index] = math.exp(min(max(value, -20.0), 5.0)) if item.log else value
        return full

    def cost(x: Array) -> float:
        full = at(x)
        total = sum(
            lk.minus_log_likelihood(run.events, table, start, sd, full, model.sight.camera_height, fades)
            for run, start in zip(runs, starts, strict=True)
        )
        return total if math.isfinite(total) else IMPOSSIBLE

    def slope(x: Array) -> Array:
        steps = STEP * np.eye(len(x))
        return np.array([(cost(x + step) - cost(x - step)) / (2.0 * STEP) for step in steps])

    first = np.array([math.log(theta[i.index]) if i.log else theta[i.index] for i in wanted])
    before = cost(first)
    show(f"{len(runs)} recordings, {found.sightings} sightings, {len(wanted)} noises to fit")
    bounds = [(math.log(LEAST), 3.0) if i.log else (-0.3, 0.3) if i.index == lk.PITCH else (0.3, 3.0) for i in wanted]
    size = max(1, found.sightings)  # of the order of 1 a sighting: the line search takes sensible steps
    result: Any = minimize(
        lambda x: cost(x) / size, first, jac=lambda x: slope(x) / size, method="L-BFGS-B", bounds=bounds,
        options={"maxiter": 200, "ftol": 1e-12, "gtol": 1e-6},
    )  # fmt: skip
    best: Array = result.x
    found.improvement = before - cost(best)
    curvature = np.array([(slope(best + s) - slope(best - s)) / (2.0 * STEP) for s in STEP * np.eye(len(best))])
    spread = _deviations(0.5 * (curvature + curvature.T))
    for value, sigma, item in zip(best, spread, wanted, strict=True):
        for key in item.keys:
            _put(found, model, key, item, float(value), float(sigma))


def _deviations(curvature: Array) -> Array:
    """Return the standard deviations from the curvature of -ln L; directions that nothing is known of get 5."""
    values, vectors = np.linalg.eigh(curvature)
    return np.sqrt((vectors**2 / np.maximum(values, 0.04)).sum(axis=1))


def _put(found: Fitted, model: NavigationModel, key: str, item: Wanted, value: float, sigma: float) -> None:
    kind = key.partition("{")[2].partition("}")[0]
    names = [name for name, action in model.actions.items() if action.kind == kind] if kind else [""]
    for name in names:
        where = key.replace("{" + kind + "}", name) if kind else key
        if item.log:
            base = item.factor * math.exp(value)
            found.values[where] = Interval(base, base * math.exp(-Z95 * sigma), base * math.exp(Z95 * sigma))
            continue
        if not kind:
            found.values[where] = Interval(
                item.factor * value, item.factor * (value - Z95 * sigma), item.factor * (value + Z95 * sigma)
            )
            continue
        nominal = model.actions[name].forward if key.endswith("forward") else model.actions[name].turn_deg
        ends = sorted((nominal * (value - Z95 * sigma), nominal * (value + Z95 * sigma)))
        found.values[where] = Interval(nominal * value, ends[0], ends[1])


def _durations(runs: Sequence[Run], model: NavigationModel, found: Fitted) -> None:
    """Times of actions in a chain, and what switching from one kind to another adds."""
    samples: dict[tuple[str, str], list[float]] = {}
    for run in runs:
        for pair, times in run.durations.items():
            samples.setdefault(pair, []).extend(times)
    chained: dict[str, list[float]] = {}
    for (before, name), times in samples.items():
        if before == model.actions[name].kind:
            chained.setdefault(name, []).extend(times)
    for name, times in chained.items():
        found.values[f"actions.{name}.duration"] = _mean(times)
    extra: dict[tuple[str, str], list[float]] = {}
    for (before, name), times in samples.items():
        kind = model.actions[name].kind
        if before != kind and name in chained:
            usual = float(np.mean(chained[name]))
            extra.setdefault((before, kind), []).extend(time - usual for time in times)
    for (before, kind), times in extra.items():
        interval = _mean(times)
        found.values[f"switching.{before}.{kind}"] = Interval(
            max(0.0, interval.value), max(0.0, interval.low), max(0.0, interval.high), interval.count
        )


def _mean(samples: Sequence[float]) -> Interval:
    x = np.array(samples)
    half = 0.0
    if len(x) > 1:
        half = float(student.ppf(0.975, len(x) - 1) * x.std(ddof=1) / math.sqrt(len(x)))
    return Interval(float(x.mean()), float(x.mean()) - half, float(x.mean()) + half, len(x))


def _matches(runs: Sequence[Run], model: NavigationModel, found: Fitted) -> None:
    """Share of the landmarks in view that were matched, by action; the interval counts runs, not landmarks."""
    for name in model.actions:
        rows = [np.array(run.frames[name]) for run in runs if name in run.frames]
        seen = np.array([part.sum(axis=0) for part in rows], dtype=np.float64).reshape(-1, 2)
        if not len(seen) or seen[:, 0].sum() == 0.0:
            continue
        share = float(seen[:, 1].sum() / seen[:, 0].sum())
        half = math.sqrt(max(share * (1.0 - share), 1e-9) / seen[:, 0].sum())
        if len(seen) > 1:  # ratio estimate: its variance from the differences between the runs
            rest = seen[:, 1] - share * seen[:, 0]
            half = max(half, math.sqrt((rest**2).sum() * len(seen) / (len(seen) - 1)) / float(seen[:, 0].sum()))
        half *= float(student.ppf(0.975, max(1, len(seen) - 1))) if len(seen) > 1 else Z95
        value = min(share, 1.0)
        found.values[f"actions.{name}.match"] = Interval(
            value, max(0.0, value - half), min(1.0, value + half), int(seen[:, 0].sum())
        )
        found.values[f"actions.{name}.frames"] = _exactly(round(_frames(rows, runs, name)), len(rows))


def _frames(rows: Sequence[Array], runs: Sequence[Run], name: str) -> float:
    """Return the frames of one action in the mean."""
    times = sum(len(t) for run in runs for (_, action), t in run.durations.items() if action == name)
    return max(1.0, sum(len(part) for part in rows) / times) if times else 1.0


def _exactly(value: float, count: int) -> Interval:
    return Interval(value, value, value, count)
