"""Plots of a run over time as data for the charts of the report page, which zoom together and follow the replay."""

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from surefoot.arrays import Array

from . import judge
from .consistency import consistency
from .drawing import BLUE, GREEN, GREY, INK, ORANGE, PURPLE, RED
from .moments import Moment, foot_name
from .traces import VARIANTS, Traces

COLOURS: dict[str, str] = dict(zip(VARIANTS, (PURPLE, ORANGE, GREEN, BLUE, RED), strict=True))
PALE = "#8fc0ea"
"""Colour of an estimated curve that is drawn underneath the curve of the truth, `#rrggbb`."""
FEET_COLOURS = (BLUE, ORANGE, GREEN, PURPLE, "#c2a100", "#008fa1", GREY, INK)
BINS = 700
"""Number of time bins of a curve; the page gets the smallest and the largest value of each, so that no peak is lost."""
UNSURE = 1.0
"""Standard deviation of an estimated velocity, m/s, from which on the velocity's chart shows no uncertainty band."""

Chart = dict[str, Any]


def charts(
    traces: Traces, feet: tuple[str, ...], limits: Mapping[str, float], worst: tuple[Moment, ...]
) -> list[Chart]:
    """Return every chart that the traces of a run have data for, as dicts that the page draws.

    `feet`: names of the legs in message order; `limits`: by key of `LIMITS`, drawn as lines; `worst`: moments to mark.
    """
    truth, velocity = traces.series("sim/truth"), traces.series("state/velocity")
    stability, odometry = traces.series("state/stability"), traces.series("state/odometry")
    found: list[Chart] = []
    if len(truth):
        tilt = [_series("true", BLUE, truth[:, 0], truth[:, 8] * judge.DEG)]
        found.append(
            _chart("Tilt of the trunk", "deg", tilt, worst, "tilt", zero=True) | _limits(limits, "max_tilt_deg", "deg")
        )
    if len(stability):
        found.append(_margin(stability, worst, limits))
    if len(velocity):
        found += [_velocity(truth, velocity, axis) for axis in range(3)]
        if len(truth):
            found.append(_errors(traces, truth, worst))
    if len(odometry) and len(truth):
        found.append(_odometry(truth, odometry))
    if traces.stances:
        found.append(_sliding(traces, feet, limits, worst))
    if len(sight := traces.series("state/landmarks")):
        found.append(
            _chart(
                "Features of an image",
                "",
                [
                    _series(name, colour, sight[:, 0], sight[:, i])
                    for i, (name, colour) in enumerate(
                        (("found", GREY), ("with a candidate in the gate", ORANGE), ("recognised", GREEN)), start=1
                    )
                ],
                zero=True,
            )
        )
    if len(velocity):
        found += _consistency(traces)
    return [chart for chart in found if any(len(series["t"]) for series in chart["series"])]


def _chart(
    title: str, unit: str, series: list[Chart], worst: tuple[Moment, ...] = (), plot: str = "", **more: Any
) -> Chart:
    marks = [{"t": m.time, "y": m.value, "text": m.text} for m in worst if m.plot == plot and plot]
    return {"title": f"{title}, {unit}" if unit else title, "unit": unit, "series": series, "marks": marks, **more}


def _series(name: str, colour: str, time: Array, values: Array, band: Array | None = None, **more: Any) -> Chart:
    """Return a curve of values (n,) over time (n,) s, thinned to its extremes.

    `band` (n,): half the width of a band about the curve, in the unit of `values`.
    """
    keep = _extremes(values)
    found: Chart = {"name": name, "colour": colour, "t": _numbers(time[keep]), "y": _numbers(values[keep]), **more}
    if band is not None:
        low, high = values[keep] - band[keep], values[keep] + band[keep]
        found |= {"lo": _numbers(low), "hi": _numbers(high)}
    return found


def _extremes(values: Array) -> NDArray[np.int64]:
    """Return the indices of the smallest and largest value of each bin of values (n,), in order."""
    size = max(1, math.ceil(len(values) / BINS))
    if size < 3:
        return np.arange(len(values))
    whole = len(values) // size * size
    bins = values[:whole].reshape(-1, size)
    begin = np.arange(0, whole, size)
    low, high = (
        begin + pick(np.where(np.isnan(bins), fill, bins), axis=1)
        for pick, fill in ((np.argmin, np.inf), (np.argmax, -np.inf))
    )
    return np.unique(np.concatenate((low, high, np.arange(whole, len(values)))))


def _numbers(values: Array) -> list[float | None]:
    return [None if not math.isfinite(v) else float(f"{v:.5g}") for v in values.tolist()]


def _limits(limits: Mapping[str, float], key: str, unit: str, factor: float = 1.0, text: str = "limit") -> Chart:
    if key not in limits:
        return {}
    value = factor * limits[key]
    return {"limits": [{"value": value, "text": f"{text} {value:g} {unit}"}]}


def _margin(stability: Array, worst: tuple[Moment, ...], limits: Mapping[str, float]) -> Chart:
    curves = [
        _series("measured CoM", ORANGE, stability[:, 0], 1000.0 * stability[:, 2], width=1.0),
        _series("planned CoM", GREEN, stability[:, 0], 1000.0 * stability[:, 1], width=1.8),
    ]
    chart = _chart("Static stability margin", "mm", curves, worst, "margin")
    chart |= _limits(limits, "min_margin_m", "mm", 1000.0, "limit of the planned CoM")
    chart.setdefault("limits", []).append({"value": 0.0, "text": "edge of the support region"})
    return chart


def _velocity(truth: Array, velocity: Array, axis: int) -> Chart:
    """Return the chart of the velocity of base_link along one of its axes; the truth is thin over the estimate.

    `truth`, `velocity`: rows of `Traces.series`.
    """
    sigma = velocity[:, 5 + axis]
    band = np.where(sigma < UNSURE, 2.0 * sigma, np.nan)
    curves = [
        _series(
            "estimated, 2 sigma",
            PALE,
            velocity[:, 0],
            np.where(velocity[:, 4] > 0.5, velocity[:, 1 + axis], np.nan),
            band,
            width=3.4,
        )
    ]
    if len(truth):
        curves.append(_series("true", INK, truth[:, 0], truth[:, 4 + axis], width=0.9))
    return _chart(f"Velocity {('forward', 'to the left', 'upward')[axis]}", "m/s", curves)


def _errors(traces: Traces, truth: Array, worst: tuple[Moment, ...]) -> Chart:
    """Return the chart of the velocity error's length over time, RMS over 0.5 s, of all estimators that were recorded.

    `truth`: rows of `Traces.series`; `worst`: moments to mark.
    """
    overall = judge.variants(traces)
    chosen = {name: (f"state/velocity/{name}", COLOURS[name]) for name in overall} or {"used": ("state/velocity", BLUE)}
    curves: list[Chart] = []
    for name, (key, colour) in chosen.items():
        error = judge.velocity_error(truth, traces.series(key))
        if len(error):
            title = f"{name}, RMS {judge.rms(error[:, 1:]):.3f}"
            curves.append(_series(title, colour, error[:, 0], _moving_rms(error)))
    marks = tuple(m for m in worst if m.plot == "velocity error")
    note = "RMS over 0.5 s; a logarithmic scale: an estimator without corrections drifts by metres per second"
    return _chart("Velocity error", "m/s", curves, marks, "velocity error", log=True, note=note)


def _moving_rms(error: Array, span_s: float = 0.5) -> Array:
    """Return the length of the error vectors (n, 1 + 3; first the time) as RMS over a moving window, (n,)."""
    period = float(np.median(np.diff(error[:, 0]))) if len(error) > 1 else span_s
    window = np.ones(min(len(error), max(1, round(span_s / max(period, 1e-6)))))
    power = np.convolve(np.square(error[:, 1:]).sum(axis=1), window, mode="same")
    return np.sqrt(power / np.convolve(np.ones(len(error)), window, mode="same")) + 1e-6


def _odometry(truth: Array, odometry: Array) -> Chart:
    drift, rows = judge.odometry_error(truth, odometry), odometry[odometry[:, 7] > 0.5]
    sigma = 200.0 * np.hypot(rows[:, 5], rows[:, 6])
    curves = [
        _series("2 sigma, its own", GREY, rows[:, 0], sigma, width=1.0, dash=[4, 3]),
        _series("horizontal error", ORANGE, drift[:, 0], 100.0 * drift[:, 1], width=1.8),
    ]
    return _chart("Odometry error", "cm", curves, zero=True)


def _sliding(traces: Traces, feet: tuple[str, ...], limits: Mapping[str, float], worst: tuple[Moment, ...]) -> Chart:
    curves: list[Chart] = []
    for foot in range(max(stance.foot for stance in traces.stances) + 1):
        own = np.array([(s.time, 1000.0 * s.sliding) for s in traces.stances if s.foot == foot]).reshape(-1, 2)
        name = foot_name(feet, foot)
        curves.append(_series(name, FEET_COLOURS[foot % 8], own[:, 0], own[:, 1], dots=True))
    mean = 1000.0 * float(np.mean([stance.sliding for stance in traces.stances]))
    chart = _chart("Sliding per stance", "mm", curves, worst, "slip", zero=True, note=f"mean {mean:.2f} mm")
    return chart | _limits(limits, "max_slip_mm", "mm")


def _consistency(traces: Traces) -> list[Chart]:
    """Return the charts of NEES and NIS over time, each with its 95 % bound for a consistent filter."""
    found: list[Chart] = []
    for test in consistency(traces):
        curve = _series(test.name, PURPLE, test.rows[:, 0], test.rows[:, 1], width=1.1)
        bound = {"value": test.bound, "text": f"95 % of a consistent filter's below {test.bound:.3g}"}
        found.append(_chart(test.name, "", [curve], limits=[bound], log=True, note=test.text))
    return found
