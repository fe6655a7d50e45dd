"""Plots of a run, other than its charts over time, as SVG texts for one HTML page."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from surefoot.arrays import Array

from . import navigation_plots
from .drawing import BLUE, GREEN, INK, ORANGE, PAPER, STYLE, page_figure, svg_of, thinned
from .sights import figure_of
from .traces import Traces


@dataclass(frozen=True)
class Timing:
    """Computing time of a service per control tick: median and 99th percentile, us."""

    p50_us: float
    p99_us: float


def draw(traces: Traces, timings: Mapping[str, Timing]) -> dict[str, str]:
    """Return the plots that the traces have data for, SVG text by title; those over time are in `charts`."""
    truth = traces.series("sim/truth")
    plots: dict[str, Callable[[], Figure] | None] = {
        "Way over the ground": (lambda: _top_view(traces)) if len(truth) else None,
        "Way by the odometry": (
            (lambda: _own_way(traces)) if not len(truth) and len(traces.series("state/odometry")) else None
        ),
        "Where it was and thought it was": (
            (lambda: navigation_plots.top_view(traces)) if len(traces.series("state/pose")) else None
        ),
        "What it decided": (lambda: navigation_plots.decisions(traces)) if traces.choices else None,
        "What it saw": (lambda: figure_of(traces.sights.by_action)) if traces.sights.by_action else None,
        "Height along the way": (lambda: _profile(traces)) if len(truth) else None,
        "Time in a tick": (lambda: _timing(timings)) if timings else None,
    }
    with mpl.rc_context(STYLE):
        return {
            title: svg_of(figure(), f"plot{i}") for i, (title, figure) in enumerate(plots.items()) if figure is not None
        }


def _figure(height: float = 2.6) -> tuple[Figure, Axes]:
    figure = page_figure(height)
    return figure, figure.add_subplot(facecolor=PAPER)


def _legend(axes: Axes) -> None:
    axes.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=5, borderaxespad=0.1, handlelength=1.4)


def _top_view(traces: Traces) -> Figure:
    """Return a top view of true path, odometry and footfalls over the elevation map that the robot was given."""
    figure, axes = _figure(3.4)
    truth = thinned(traces.series("sim/truth"))
    x0, x1 = truth[:, 1].min() - 0.35, truth[:, 1].max() + 0.35
    y0, y1 = truth[:, 2].min() - 0.35, truth[:, 2].max() + 0.35
    if traces.ground is not None:
        z, cell, (ox, oy) = traces.ground
        cols = slice(max(0, int((x0 - ox) / cell)), max(1, int((x1 - ox) / cell) + 2))
        rows = slice(max(0, int((y0 - oy) / cell)), max(1, int((y1 - oy) / cell) + 2))
        part = 100.0 * z[rows, cols]
        if part.size:
            left, low = ox + (cols.start - 0.5) * cell, oy + (rows.start - 0.5) * cell
            image = axes.imshow(
                part,
                origin="lower",
                extent=(left, left + part.shape[1] * cell, low, low + part.shape[0] * cell),
                cmap="terrain",
                vmin=-8.0,
                vmax=max(12.0, float(np.nanmax(part, initial=0.0)) + 2.0),
                interpolation="nearest",
                alpha=0.85,
            )
            figure.colorbar(image, ax=axes, label="height, cm", shrink=0.8, pad=0.01)
    places = np.array([stance.place for stance in traces.stances]).reshape(-1, 2)
    axes.plot(places[:, 0], places[:, 1], "o", color=INK, markersize=2.2, alpha=0.7, label="footfalls")
    odometry = _placed(traces)
    if len(odometry):
        axes.plot(odometry[:, 0], odometry[:, 1], color=ORANGE, label="odometry")
    axes.plot(truth[:, 1], truth[:, 2], color=BLUE, linewidth=1.8, label="trunk, true")
    axes.plot(*truth[0, 1:3], "s", color=BLUE, markersize=5)
    axes.plot(*truth[-1, 1:3], ">", color=BLUE, markersize=6)
    axes.set(xlim=(x0, x1), ylim=(y0, y1), xlabel="x, m", ylabel="y, m", aspect="equal")
    axes.grid(visible=False)
    _legend(axes)
    return figure


def _own_way(traces: Traces) -> Figure:
    """Return a top view of odometry and stances by the robot's own measurements, for runs without truth."""
    figure, axes = _figure(3.4)
    odometry = traces.series("state/odometry")
    way = thinned(odometry[odometry[:, 7] > 0.5])
    places = np.array([stance.place for stance in traces.stances]).reshape(-1, 2)
    axes.plot(places[:, 0], places[:, 1], "o", color=INK, markersize=2.2, alpha=0.7, label="footfalls")
    axes.plot(way[:, 1], way[:, 2], color=ORANGE, label="odometry")
    axes.set(xlabel="x, m", ylabel="y, m", aspect="equal")
    axes.set_adjustable("datalim")
    _legend(axes)
    return figure


def _placed(traces: Traces) -> Array:
    """Return the path by odometry in the world, (n, 2) m, aligned with the truth's start and initial heading."""
    odometry, truth = traces.series("state/odometry"), traces.series("sim/truth")
    if not len(odometry):
        return np.empty((0, 2))
    valid = odometry[odometry[:, 7] > 0.5]
    if not len(valid):
        return np.empty((0, 2))
    first = truth[np.abs(truth[:, 0] - valid[0, 0]).argmin()]
    turn = first[7] - valid[0, 4]
    rot = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    return thinned(first[1:3] + (valid[:, 1:3] - valid[0, 1:3]) @ rot.T)


def _profile(traces: Traces) -> Figure:
    """Return a side view of the true path: heights of ground, trunk and centre of mass over x in the world."""
    figure, axes = _figure()
    truth = thinned(traces.series("sim/truth"))
    if traces.ground is not None:
        z, cell, (ox, oy) = traces.ground
        col = np.clip(np.round((truth[:, 1] - ox) / cell).astype(int), 0, z.shape[1] - 1)
        row = np.clip(np.round((truth[:, 2] - oy) / cell).astype(int), 0, z.shape[0] - 1)
        ground = 100.0 * z[row, col]
        base = min(0.0, float(np.nanmin(ground, initial=0.0))) - 1.0
        axes.fill_between(truth[:, 1], base, ground, color="#cdbfa8", linewidth=0, label="ground (map)")
    axes.plot(truth[:, 1], 100.0 * truth[:, 3], color=BLUE, label="trunk")
    axes.plot(truth[:, 1], 100.0 * truth[:, 11], color=GREEN, label="centre of mass")
    axes.set(xlabel="x, m", ylabel="height, cm")
    _legend(axes)
    return figure


def _timing(timings: Mapping[str, Timing]) -> Figure:
    figure, axes = _figure(0.7 + 0.3 * len(timings))
    names = list(timings)[::-1]
    axes.barh(names, [timings[name].p99_us for name in names], color=BLUE, alpha=0.25, height=0.6, label="99 %")
    axes.barh(names, [timings[name].p50_us for name in names], color=BLUE, height=0.6, label="median")
    for i, name in enumerate(names):
        axes.text(timings[name].p99_us, i, f"  {timings[name].p50_us:.0f} / {timings[name].p99_us:.0f}", va="center")
    axes.set_xlabel("time in a tick, us")
    axes.margins(x=0.12)
    axes.grid(visible=False, axis="y")
    _legend(axes)
    return figure
