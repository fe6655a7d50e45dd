"""Plots of a run as SVG texts for one HTML page. Only here and in `drawing` is matplotlib used."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure

from . import judge, navigation_plots
from .drawing import BLUE, GREEN, GREY, INK, ORANGE, PAPER, PURPLE, RED, STYLE, svg_of
from .traces import VARIANTS, Array, Traces

COLOURS: dict[str, str] = dict(zip(VARIANTS, (PURPLE, ORANGE, GREEN, BLUE, RED), strict=True))
MAX_POINTS = 1500  # of one curve: more cannot be seen and only makes the page heavy
BAND_POINTS = 300  # of a band, which is smooth


@dataclass(frozen=True)
class Timing:
    """Time a service spent in a tick: median and 99th percentile, us."""

    p50_us: float
    p99_us: float


@dataclass(frozen=True)
class Moment:
    """A worst moment: when (s), its value in the unit of the plot, and what it was."""

    plot: str
    time: float
    value: float
    text: str


def moments(traces: Traces, feet: tuple[str, ...]) -> tuple[Moment, ...]:
    """Return the worst moments of a run, in the order of time."""
    found: list[Moment] = []
    truth = traces.series("sim/truth")
    if len(truth):
        i = int(truth[:, 8].argmax())
        tilt = float(truth[i, 8] * judge.DEG)
        found.append(Moment("tilt", truth[i, 0], tilt, f"largest tilt, {tilt:.1f} deg"))
    stability = traces.series("state/stability")
    if len(stability) and np.isfinite(stability[:, 1]).any():
        i = int(np.nanargmin(stability[:, 1]))
        margin = 1000.0 * float(stability[i, 1])
        found.append(Moment("margin", stability[i, 0], margin, f"smallest static margin, {margin:.1f} mm"))
    if traces.stances:
        worst = max(traces.stances, key=lambda stance: stance.sliding)
        foot, slid = _foot(feet, worst.foot), 1000.0 * worst.sliding
        found.append(Moment("slip", worst.time, slid, f"foot {foot} has slid {slid:.2f} mm in its stance"))
    error = judge.velocity_error(truth, traces.series("state/velocity"))
    if len(error):
        size = np.linalg.norm(error[:, 1:], axis=1)
        i = int(size.argmax())
        text = f"largest velocity error, {size[i]:.3f} m/s"
        found.append(Moment("velocity error", error[i, 0], float(size[i]), text))
    if traces.fallen_at is not None:
        found.append(Moment("", traces.fallen_at, 0.0, "the robot has fallen"))
    return tuple(sorted(found, key=lambda moment: moment.time))


def draw(
    traces: Traces, feet: tuple[str, ...], timings: Mapping[str, Timing], limits: Mapping[str, float]
) -> dict[str, str]:
    """Return every plot the traces allow, title to SVG text."""
    marks = {moment.plot: moment for moment in moments(traces, feet)}
    truth = traces.series("sim/truth")
    plots: dict[str, Callable[[], Figure] | None] = {
        "Way over the ground": (lambda: _top_view(traces)) if len(truth) else None,
        "Way by the odometry": (
            (lambda: _own_way(traces)) if not len(truth) and _has(traces, "state/odometry") else None
        ),
        "Where it was and thought it was": (
            (lambda: navigation_plots.top_view(traces)) if _has(traces, "state/pose") else None
        ),
        "What it decided": (lambda: navigation_plots.decisions(traces)) if traces.choices else None,
        "Height along the way": (lambda: _profile(traces)) if len(truth) else None,
        "Tilt of the trunk": (lambda: _tilt(truth, marks.get("tilt"), limits)) if len(truth) else None,
        f"Velocity, estimated{' and true' if len(truth) else ''}": (
            (lambda: _velocity(traces)) if _has(traces, "state/velocity") else None
        ),
        "Velocity error of the estimators": (
            (lambda: _variants(traces, marks.get("velocity error")))
            if len(truth) and _has(traces, "state/velocity")
            else None
        ),
        "Odometry error": (lambda: _odometry(traces)) if len(truth) and _has(traces, "state/odometry") else None,
        "Static stability margin": (
            (lambda: _margin(traces, marks.get("margin"), limits)) if _has(traces, "state/stability") else None
        ),
        "Sliding per stance": (lambda: _slip(traces, feet, marks.get("slip"), limits)) if traces.stances else None,
        "Time in a tick": (lambda: _timing(timings)) if timings else None,
    }
    with mpl.rc_context(STYLE):
        return {
            title: svg_of(figure(), f"plot{i}") for i, (title, figure) in enumerate(plots.items()) if figure is not None
        }


def _has(traces: Traces, key: str) -> bool:
    return len(traces.series(key)) > 0


def _foot(feet: tuple[str, ...], index: int) -> str:
    return feet[index].upper() if index < len(feet) else str(index + 1)


def _figure(height: float = 2.6, rows: int = 1) -> tuple[Figure, list[Axes]]:
    figure = Figure(figsize=(7.6, height), layout="constrained", facecolor=PAPER)
    FigureCanvasSVG(figure)
    axes = [figure.add_subplot(rows, 1, i + 1, facecolor=PAPER) for i in range(rows)]
    for above in axes[:-1]:
        above.sharex(axes[-1])
        above.tick_params(labelbottom=False)
    return figure, axes


def _thin(rows: Array, points: int = MAX_POINTS) -> Array:
    return rows[:: max(1, len(rows) // points)]


def _legend(axes: Axes) -> None:
    axes.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=5, borderaxespad=0.1, handlelength=1.4)


def _mark(axes: Axes, moment: Moment | None) -> None:
    if moment is None:
        return
    axes.plot(moment.time, moment.value, "o", color=RED, markersize=5, zorder=5)
    left = moment.time > sum(axes.get_xlim()) / 2
    high = moment.value > sum(axes.get_ylim()) / 2
    axes.annotate(
        f"t = {moment.time:.2f} s: {moment.text}",
        (moment.time, moment.value),
        xytext=(-8 if left else 8, -11 if high else 6),
        textcoords="offset points",
        ha="right" if left else "left",
        color=RED,
        fontsize=8,
        bbox={"boxstyle": "round,pad=0.2", "facecolor": "white", "alpha": 0.75, "linewidth": 0},
    )


def _limit(axes: Axes, limits: Mapping[str, float], key: str, factor: float = 1.0) -> None:
    if key in limits:
        axes.axhline(factor * limits[key], color=RED, linestyle="--", linewidth=0.9, label="limit")


def _top_view(traces: Traces) -> Figure:
    """Top view of truth, odometry and footfalls over the map the robot was given."""
    figure, (axes,) = _figure(3.4)
    truth = _thin(traces.series("sim/truth"))
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
    """Top view of the odometry and of the stances by the robot's own measurements, where no truth is known."""
    figure, (axes,) = _figure(3.4)
    odometry = traces.series("state/odometry")
    way = _thin(odometry[odometry[:, 7] > 0.5])
    places = np.array([stance.place for stance in traces.stances]).reshape(-1, 2)
    axes.plot(places[:, 0], places[:, 1], "o", color=INK, markersize=2.2, alpha=0.7, label="footfalls")
    axes.plot(way[:, 1], way[:, 2], color=ORANGE, label="odometry")
    axes.set(xlabel="x, m", ylabel="y, m", aspect="equal")
    axes.set_adjustable("datalim")
    _legend(axes)
    return figure


def _placed(traces: Traces) -> Array:
    """Return the odometry's way in the world, (n, 2): start and first heading as in truth."""
    odometry, truth = traces.series("state/odometry"), traces.series("sim/truth")
    if not len(odometry):
        return np.empty((0, 2))
    valid = odometry[odometry[:, 7] > 0.5]
    if not len(valid):
        return np.empty((0, 2))
    first = truth[np.abs(truth[:, 0] - valid[0, 0]).argmin()]
    turn = first[7] - valid[0, 4]
    rot = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    return _thin(first[1:3] + (valid[:, 1:3] - valid[0, 1:3]) @ rot.T)


def _profile(traces: Traces) -> Figure:
    """Side view: ground under the trunk, trunk and centre of mass."""
    figure, (axes,) = _figure()
    truth = _thin(traces.series("sim/truth"))
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


def _tilt(truth: Array, mark: Moment | None, limits: Mapping[str, float]) -> Figure:
    figure, (axes,) = _figure(2.2)
    rows = _thin(truth)
    axes.plot(rows[:, 0], rows[:, 8] * judge.DEG, color=BLUE, label="true")
    _limit(axes, limits, "max_tilt_deg")
    axes.set(xlabel="time, s", ylabel="tilt, deg", ylim=(0, 1.1 * axes.get_ylim()[1]))
    _mark(axes, mark)
    _legend(axes)
    return figure


def _velocity(traces: Traces) -> Figure:
    figure, axes = _figure(4.2, rows=3)
    truth, estimate = _thin(traces.series("sim/truth")), _thin(traces.series("state/velocity"))
    known = truth[:, 4:7] if len(truth) else estimate[estimate[:, 4] > 0.5, 1:4]
    for i, name in enumerate("xyz"):
        if len(truth):
            axes[i].plot(truth[:, 0], truth[:, 4 + i], color=GREY, label="true")
        axes[i].plot(estimate[:, 0], estimate[:, 1 + i], color=BLUE, label="estimated", linewidth=1.0)
        band = _thin(estimate, BAND_POINTS)
        sure = np.where(band[:, 5 + i] < 1.0, 2.0 * band[:, 5 + i], np.nan)
        low, high = band[:, 1 + i] - sure, band[:, 1 + i] + sure
        axes[i].fill_between(band[:, 0], low, high, color=BLUE, alpha=0.15, linewidth=0, label="2 sigma")
        bound = 1.5 * max(0.02, float(np.abs(known[:, i]).max(initial=0.0)))
        axes[i].set(ylabel=f"v{name}, m/s", ylim=(-bound, bound))
    axes[2].set_xlabel("time, s")
    _legend(axes[0])
    return figure


def _variants(traces: Traces, mark: Moment | None) -> Figure:
    """Length of the velocity error over time, smoothed over half a second, of all estimators that were recorded."""
    figure, (axes,) = _figure()
    truth = traces.series("sim/truth")
    overall = judge.variants(traces)
    curves = {name: (f"state/velocity/{name}", COLOURS[name]) for name in overall} or {"used": ("state/velocity", BLUE)}
    for name, (key, colour) in curves.items():
        error = judge.velocity_error(truth, traces.series(key))
        if not len(error):
            continue
        rows = _thin(np.column_stack([error[:, 0], _moving_rms(error)]))
        axes.plot(rows[:, 0], rows[:, 1], color=colour, label=f"{name} (RMS {judge.rms(error[:, 1:]):.3f})")
    axes.set_yscale("log")  # an estimator without corrections drifts by metres per second
    axes.set(xlabel="time, s", ylabel="error, m/s (0.5 s RMS)")
    if mark is not None:
        axes.axvline(mark.time, color=RED, linewidth=0.8, linestyle=":")
    _legend(axes)
    return figure


def _moving_rms(error: Array, span_s: float = 0.5) -> Array:
    """Return the length of the error vectors (n, 1 + 3; first the time) as RMS over a moving window, (n,)."""
    period = float(np.median(np.diff(error[:, 0]))) if len(error) > 1 else span_s
    window = np.ones(min(len(error), max(1, round(span_s / max(period, 1e-6)))))
    power = np.convolve(np.square(error[:, 1:]).sum(axis=1), window, mode="same")
    return np.sqrt(power / np.convolve(np.ones(len(error)), window, mode="same")) + 1e-6


def _odometry(traces: Traces) -> Figure:
    figure, (axes,) = _figure(2.2)
    odometry = traces.series("state/odometry")
    drift = _thin(judge.odometry_error(traces.series("sim/truth"), odometry))
    rows = _thin(odometry[odometry[:, 7] > 0.5], BAND_POINTS)
    if len(rows):
        sigma = 100.0 * np.hypot(rows[:, 5], rows[:, 6])
        axes.fill_between(rows[:, 0], 0.0, 2.0 * sigma, color=ORANGE, alpha=0.15, linewidth=0, label="2 sigma, own")
    if len(drift):
        axes.plot(drift[:, 0], 100.0 * drift[:, 1], color=ORANGE, label="horizontal error")
        axes.set_ylim(0.0, max(1.0, 150.0 * float(drift[:, 1].max())))
    axes.set(xlabel="time, s", ylabel="error, cm")
    _legend(axes)
    return figure


def _margin(traces: Traces, mark: Moment | None, limits: Mapping[str, float]) -> Figure:
    figure, (axes,) = _figure()
    rows = _thin(traces.series("state/stability"))
    axes.plot(rows[:, 0], 1000.0 * rows[:, 2], color=GREY, linewidth=0.9, label="measured CoM")
    axes.plot(rows[:, 0], 1000.0 * rows[:, 1], color=GREEN, label="planned CoM")
    axes.axhline(0.0, color=INK, linewidth=0.8)
    _limit(axes, limits, "min_margin_m", 1000.0)
    axes.set(xlabel="time, s", ylabel="margin, mm")
    _mark(axes, mark)
    _legend(axes)
    return figure


def _slip(traces: Traces, feet: tuple[str, ...], mark: Moment | None, limits: Mapping[str, float]) -> Figure:
    figure, (axes,) = _figure()
    number = max(stance.foot for stance in traces.stances) + 1
    palette = (BLUE, ORANGE, GREEN, PURPLE, "#c2a100", "#008fa1", GREY, INK)
    for foot in range(number):
        own = np.array([(s.time, 1000.0 * s.sliding) for s in traces.stances if s.foot == foot]).reshape(-1, 2)
        axes.plot(own[:, 0], own[:, 1], "o", markersize=3.5, color=palette[foot % 8], label=_foot(feet, foot))
    mean = float(np.mean([1000.0 * stance.sliding for stance in traces.stances]))
    axes.axhline(mean, color=INK, linewidth=0.9, linestyle="-", label=f"mean {mean:.2f}")
    _limit(axes, limits, "max_slip_mm")
    axes.set(xlabel="time, s", ylabel="sliding, mm", ylim=(0.0, None))
    _mark(axes, mark)
    axes.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=9, borderaxespad=0.1, handlelength=1.0)
    return figure


def _timing(timings: Mapping[str, Timing]) -> Figure:
    figure, (axes,) = _figure(0.7 + 0.3 * len(timings))
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
