"""Durations of actions, s, and probabilities that a landmark in view is matched, with 95 % intervals."""

import math
from collections.abc import Sequence

import numpy as np
from scipy.optimize import brentq
from scipy.stats import binom
from scipy.stats import t as student

from surefoot.arrays import Array
from surefoot.services.navigator.policy.params import NavigationModel

from ..statistics import Z95
from .events import FRAME, Run
from .result import Fitted, Interval

FULL = 0.99
"""Largest share of the matches that fit into the camera frames, 0 to 1; a larger observed share is reduced to it."""


def twins(model: NavigationModel) -> list[tuple[str, ...]]:
    """Return the action names of a model in groups of an action and its mirror image, which share fitted values."""
    groups: dict[tuple[str, float, float], list[str]] = {}
    for name, action in model.actions.items():
        groups.setdefault((action.kind, action.forward, abs(action.turn_deg)), []).append(name)
    return [tuple(names) for names in groups.values()]


def durations(runs: Sequence[Run], model: NavigationModel, found: Fitted) -> None:
    """Add durations of actions, s, extra times of switching between kinds, s, and camera frames per action to a result.

    Args:
        runs: motions, sightings and times of each recording.
        model: navigation model, which names the actions.
        found: result, changed in place; actions that do not occur in the recordings get no values.
    """
    samples: dict[tuple[str, str], list[float]] = {}
    for run in runs:
        for pair, times in run.durations.items():
            samples.setdefault(pair, []).extend(times)
    occurred = {name for _, name in samples} | {name for run in runs for name, rows in run.frames.items() if rows}
    usual: dict[str, float] = {}
    for names in twins(model):
        times = [
            time for (before, name), part in samples.items()
            if name in names and before == model.actions[name].kind for time in part
        ]  # fmt: skip
        times = times or [
            time for (before, name), part in samples.items() if name in names and before != "stand" for time in part
        ]
        for name in names:
            if times:
                found.values[f"actions.{name}.duration"] = mean = _mean(times)
                usual[name] = mean.value
    extra: dict[tuple[str, str], list[float]] = {}
    for (before, name), times in samples.items():
        kind = model.actions[name].kind
        if before != kind and name in usual:
            extra.setdefault((before, kind), []).extend(time - usual[name] for time in times)
    for run in runs:
        for kind, times in run.halts.items():
            extra.setdefault((kind, "stand"), []).extend(times)
    for (before, kind), times in extra.items():
        mean = _mean(times)
        value, low, high = (max(0.0, end) for end in (mean.value, mean.low, mean.high))
        found.values[f"switching.{before}.{kind}"] = Interval(value, low, high, mean.count)
    _frames(runs, model, found, occurred, usual)


def _frames(
    runs: Sequence[Run], model: NavigationModel, found: Fitted, occurred: set[str], usual: dict[str, float]
) -> None:
    """Add the number of camera frames during each action to a result: duration divided by the median frame interval.

    `occurred`: names of the actions in the recordings; `usual`: duration of each, s.
    """
    gaps = np.concatenate([run.events[run.events[:, 0] == FRAME, 1][1:] for run in runs])
    if not len(gaps) or float(np.median(gaps)) <= 0.0:
        return
    period = float(np.median(gaps))
    for names in twins(model):
        for name in names:
            if occurred.intersection(names):
                count = min(64, max(1, round(usual.get(name, model.actions[name].duration) / period)))
                found.values[f"actions.{name}.frames"] = Interval(count, count, count, len(gaps))


def _mean(samples: Sequence[float]) -> Interval:
    x = np.array(samples)
    half = 0.0
    if len(x) > 1:
        half = float(student.ppf(0.975, len(x) - 1) * x.std(ddof=1) / math.sqrt(len(x)))
    return Interval(float(x.mean()), float(x.mean()) - half, float(x.mean()) + half, len(x))


def matches(runs: Sequence[Run], model: NavigationModel, found: Fitted) -> None:
    """Add the probability that a landmark in view is matched, by action, to a result; intervals are over recordings.

    Of images all matches count, and the density of map features, 1/m^2, is added, on which the probability depends.
    A frame of another camera holds at most `sight.most` landmarks, which limits the observed share. The probability p
    is the one for which the expected number of matches, the sum over frames of E min(Binomial(in view, p), most),
    equals the observed number.

    Args:
        runs: motions, sightings and times of each recording.
        model: navigation model, which names the actions.
        found: result, changed in place.
    """
    densities = [run.density for run in runs if run.density > 0.0]
    if densities:
        found.values["scene.landmarks_per_m2"] = _mean(densities)
    for names in twins(model):
        parts = [[row for name in names for row in run.frames.get(name, ())] for run in runs]
        rows = [np.array(part, dtype=np.float64) for part in parts if part]
        seen = np.array([part.sum(axis=0) for part in rows]).reshape(-1, 2)
        if not len(seen) or seen[:, 0].sum() == 0.0:
            continue
        in_view, total = float(seen[:, 0].sum()), float(seen[:, 1].sum())
        share = total / in_view
        half = math.sqrt(max(share * (1.0 - share), 0.25 / in_view) / in_view) * Z95
        if len(seen) > 1:  # ratio estimate: its variance from the differences between the runs
            rest = seen[:, 1] - share * seen[:, 0]
            sd = math.sqrt((rest**2).sum() * len(seen) / (len(seen) - 1)) / in_view
            half = max(half, sd * float(student.ppf(0.975, len(seen) - 1)))
        views = np.concatenate([part[:, 0] for part in rows])
        most = int(views.max()) if densities else model.sight.most
        room = FULL * float(np.minimum(views, most).sum())
        value = _probability(views, min(total, room), most)
        low, high = (_probability(views, min(total, room) + k * half * in_view, most) for k in (-1.0, 1.0))
        for name in names:
            found.values[f"actions.{name}.match"] = Interval(value, low, high, int(in_view))


def _probability(views: Array, total: float, most: int) -> float:
    """Return the match probability at which frames with `views` (n,) landmarks in view have `total` expected matches.

    The number of matches in a frame is min(Binomial(in view, p), `most`).
    """
    sizes, frames = np.unique(views.astype(int), return_counts=True)
    below = np.arange(most)

    def excess(p: float) -> float:
        held = binom.sf(below[None, :], sizes[:, None], p).sum(axis=1)  # E min(X, most) = sum over k < most of P(X > k)
        return float((frames * held).sum()) - total

    room = float((frames * np.minimum(sizes, most)).sum())
    if total <= 0.0 or total >= room:
        return 0.0 if total <= 0.0 else 1.0
    return float(brentq(excess, 0.0, 1.0))  # pyright: ignore[reportArgumentType]
