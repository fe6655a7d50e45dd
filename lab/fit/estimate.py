"""Fit of a navigation model to recordings of a robot: noises, durations, match probabilities, with 95 % intervals."""

import math
from collections.abc import Callable, Sequence

import numpy as np

from surefoot.arrays import Array
from surefoot.errors import SurefootError
from surefoot.services.navigator.catalogue import errors_of
from surefoot.services.navigator.policy.params import ActionModel, NavigationModel

from . import likelihood as lk
from .counts import durations, matches
from .events import Run
from .result import Fitted, Interval
from .search import FittedParameter, Likelihood, Parameter, estimate

LEAST = 1e-3
"""Smallest initial standard deviation of the search, m or rad; smaller ones are raised to it (zero: no gradient)."""
DEG = math.degrees(1.0)
LEAN = 0.3
"""Largest absolute value that the search tries for the mean pitch error of the camera, rad."""


def fit(
    runs: Sequence[Run], model: NavigationModel, progress: Callable[[float, str], None] = lambda share, step: None
) -> Fitted:
    """Return parameters of a navigation model fitted to the recordings of a robot, with 95 % intervals.

    Left out are noises that the recordings do not determine within a factor of 10, and distances and turns whose
    interval includes the commanded value. An action and its mirror image share their values, as the model requires.

    Args:
        runs: events and times of each recording.
        model: initial values of the search; values that are not fitted are not returned.
        progress: called with the share that is done, 0 to 1, and the present step in words.

    Raises:
        SurefootError: `runs` is empty.
    """
    if not runs:
        raise SurefootError("invalid", "got 0 recordings, allowed are 1 or more", "recordings")
    found = Fitted(runs=len(runs), sightings=int(sum((run.events[:, 0] == 2.0).sum() for run in runs)))
    _noises(runs, model, found, progress)
    durations(runs, model, found)
    matches(runs, model, found)
    return found


def group_of(action: ActionModel) -> int:
    """Return the noise group of an action: 0 on the spot (turn, stand), 1 straight walk, 2 arc."""
    if action.kind != "walk":
        return lk.ON_THE_SPOT
    return lk.STRAIGHT if action.turn_deg == 0.0 else lk.ARC


def _occurring(runs: Sequence[Run], model: NavigationModel) -> set[int]:
    """Return the noise groups (0 on the spot, 1 straight, 2 arc) of the actions that occur in the recordings."""
    actions = list(model.actions.values())
    moves = [np.unique(run.events[run.events[:, 0] == 0.0, 1].astype(int)) for run in runs]
    return {group_of(actions[index]) for part in moves for index in part}


def _begin(model: NavigationModel) -> Array:
    """Return the initial parameter vector of the likelihood from the values of a model, (21,), SI units."""
    found = {group_of(action): action for action in reversed(model.actions.values()) if action.kind != "stand"}
    walk, turn = found.get(lk.STRAIGHT) or found[lk.ARC], found[lk.ON_THE_SPOT]
    arc = found.get(lk.ARC, walk)
    s, theta = model.sight, np.ones(lk.PARAMETERS)
    for action, first in ((walk, lk.ALONG), (arc, lk.ARC_ALONG)):
        theta[first : first + 3] = action.along_sd, action.across_sd, action.heading_sd_deg / DEG
    theta[[lk.TURN_PLACE, lk.TURN_HEADING]] = turn.along_sd, turn.heading_sd_deg / DEG
    theta[[lk.RANGE, lk.SHARE, lk.BEARING]] = s.range_sd, s.range_sd_share, s.bearing_sd_deg / DEG
    theta[[lk.STANDING, lk.TILT]] = s.standing_share, s.tilt_sd_deg / DEG
    theta[[lk.SWAY, lk.PITCH]] = s.sway_sd, s.pitch_deg / DEG
    theta[lk.DRIFT] = 10.0 * model.drift.known_sd_deg / DEG
    theta[lk.WANDER] = 10.0 * walk.drift_walk_deg / DEG
    return theta


def _parameters(runs: Sequence[Run], model: NavigationModel) -> list[Parameter]:
    """Return the parameters to fit: those that the recordings contain information on."""
    groups = _occurring(runs, model)
    stood = any((run.events[run.events[:, 0] == 2.0, 5] > 0.0).any() for run in runs)
    of = {g: [n for n, a in model.actions.items() if a.kind != "stand" and group_of(a) == g] for g in range(3)}
    straight = of[lk.STRAIGHT] + ([] if lk.ARC in groups else of[lk.ARC])
    spread, which = ("range_sd", lk.RANGE) if model.sight.range_sd > 0.0 else ("range_sd_share", lk.SHARE)

    def keys(names: Sequence[str], *fields: str) -> tuple[str, ...]:
        return tuple(f"actions.{name}.{field}" for name in names for field in fields)

    wanted = [
        Parameter(which, (f"sight.{spread}",)),
        Parameter(lk.BEARING, ("sight.bearing_sd_deg",), DEG),
        Parameter(lk.DRIFT, ("drift.per_10cm_deg", "drift.known_sd_deg"), 0.1 * DEG),
    ]
    for group, names, first, factor in ((lk.STRAIGHT, straight, lk.ALONG, lk.FORWARD),
                                        (lk.ARC, of[lk.ARC], lk.ARC_ALONG, lk.ARC_FORWARD)):  # fmt: skip
        if group in groups:
            wanted += [
                Parameter(first, keys(names, "along_sd")),
                Parameter(first + 1, keys(names, "across_sd")),
                Parameter(first + 2, keys(names, "heading_sd_deg"), DEG),
                Parameter(factor, keys(names, "forward"), bounds=(0.3, 3.0), as_commanded=1.0),
            ]
    if lk.ARC in groups:
        wanted.append(Parameter(lk.ARC_TURNED, keys(of[lk.ARC], "turn_deg"), bounds=(0.3, 3.0), as_commanded=1.0))
    if lk.ON_THE_SPOT in groups:
        names = of[lk.ON_THE_SPOT]
        wanted += [
            Parameter(lk.TURN_PLACE, keys(names, "along_sd", "across_sd")),
            Parameter(lk.TURN_HEADING, keys(names, "heading_sd_deg"), DEG),
            Parameter(lk.TURNED, keys(names, "turn_deg"), bounds=(0.3, 3.0), as_commanded=1.0),
        ]
    if stood:
        wanted.append(Parameter(lk.STANDING, ("sight.standing_share",)))
    if model.sight.sway_sd > 0.0:
        wanted.append(Parameter(lk.SWAY, ("sight.sway_sd",)))
    if model.sight.tilt_sd_deg > 0.0:
        wanted.append(Parameter(lk.TILT, ("sight.tilt_sd_deg",), DEG))
        wanted.append(Parameter(lk.PITCH, ("sight.pitch_deg",), DEG, bounds=(-LEAN, LEAN)))
    return wanted


def _noises(runs: Sequence[Run], model: NavigationModel, found: Fitted, progress: Callable[[float, str], None]) -> None:
    theta, wanted = _begin(model), _parameters(runs, model)
    table = np.array([(a.forward, math.radians(a.turn_deg), float(group_of(a))) for a in model.actions.values()])
    sd = np.array([max(model.filter.position_sd, LEAST), max(math.radians(model.filter.heading_sd_deg), LEAST)])
    shared = errors_of(model, sway=True)
    fades = np.minimum([shared.tilt_fade, shared.sway_fade], 1e6)
    for item in wanted:
        theta[item.index] = max(theta[item.index], LEAST) if item.positive else theta[item.index]
    step = f"{found.sightings} sightings, {len(wanted)} parameters"
    with Likelihood(runs, table, sd, model.sight.camera_height, fades) as likelihood:
        best, found.improvement = estimate(
            likelihood, theta, wanted, found.sightings, lambda share: progress(share, step)
        )
    for item in wanted:
        if item.index not in best:
            found.undecided += item.keys
            continue
        for key in item.keys:
            found.values[key] = _number(model, key, item, best[item.index])


def _number(model: NavigationModel, key: str, item: Parameter, value: FittedParameter) -> Interval:
    """Return a fitted parameter in the unit of its model key; distance and turn in those of the action."""
    _, _, rest = key.partition("actions.")
    name, _, field = rest.partition(".")
    factor = item.factor
    if field in ("forward", "turn_deg"):
        factor = model.actions[name].forward if field == "forward" else model.actions[name].turn_deg
    low, high = sorted((factor * value.low, factor * value.high))
    return Interval(factor * value.value, low, high)
