"""Figures 15 to 24 of Walas & Belter (2011) drawn again, one SVG file each."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from surefoot.arrays import Array
from surefoot.geometry.constants import GRAVITY
from surefoot.lab.report.drawing import BLUE, GREEN, GREY, INK, ORANGE, PURPLE, RED, new_figure, write_figures

from . import ragno as walas_ragno
from .ragno import CM
from .study import StabilityStudy


def draw(study: StabilityStudy, out: Path | None) -> tuple[Path, ...]:
    """Draw all figures of a study and write them into the folder `out`; return their paths, none if it is None."""
    plots: dict[str, Callable[[StabilityStudy], Figure]] = {
        "fig15-com-displacement": _figure_15,
        "fig16-21-procedure": _figure_16,
        "fig17-slope": _figure_17,
        "fig18-pressure-sensor": _figure_18,
        "fig20-force-at-the-tip": _figure_20,
        "fig22-backward-movement": lambda s: _movement(s, -1.0, "Fig. 22: backward movement"),
        "fig23-forward-movement": lambda s: _movement(s, 1.0, "Fig. 23: forward movement"),
        "fig24-forces-and-com": _figure_24,
    }
    return write_figures(plots, study, out)


def _new(width: float, height: float, title: str) -> tuple[Figure, Axes]:
    figure = new_figure(width, height)
    axes = figure.add_subplot(1, 1, 1)
    axes.set_title(title, loc="left", fontsize=10)
    return figure, axes


def _plane(axes: Axes) -> None:
    axes.set_aspect("equal")
    axes.set_xlabel("x, cm (forward)")
    axes.set_ylabel("y, cm (left)")


def _closed(points: Array) -> tuple[Array, Array]:
    ring = CM * np.vstack((points, points[:1]))
    return ring[:, 0], ring[:, 1]


def _arrow(axes: Axes, start: Array, end: Array, colour: str, label: str = "") -> None:
    axes.annotate("", _at(end), _at(start), arrowprops={"arrowstyle": "-|>", "color": colour, "lw": 1.4})
    if label:
        middle = _at(0.5 * (start[:2] + end[:2]))
        axes.annotate(label, middle, (0, 6), textcoords="offset points", color=colour, ha="center")


def _at(point: Array) -> tuple[float, float]:
    return CM * float(point[0]), CM * float(point[1])


def _figure_15(s: StabilityStudy) -> Figure:
    figure, axes = _new(6.4, 5.6, "Fig. 15: CoM of Ragno, legs neutral and 30 deg forward and backward")
    for p, colour, line in zip(s.postures, (GREY, BLUE, ORANGE), ("--", "-", ":"), strict=True):
        name = {0.0: "neutral", 30.0: "forward", -30.0: "backward"}[p.turn_deg]
        for hip, leg, foot in zip(p.hips, p.leg_com, p.feet, strict=True):
            axes.plot(*(CM * np.vstack((hip, foot))).T, line, color=colour, lw=0.8)
            _arrow(axes, hip, leg, colour)
        shift = CM * (p.com[0] - s.postures[0].com[0])
        axes.plot(CM * p.com[0], CM * p.com[1], "o", color=colour, label=f"{name}: {shift:+.2f} cm")
    box = 0.5 * s.ragno.trunk.box
    axes.plot(*_closed(np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]]) * box[:2]), color=INK, lw=1.0)
    _plane(axes)
    axes.legend(loc="lower left", title="CoM of the robot")
    return figure


def _figure_16(s: StabilityStudy) -> Figure:
    figure, axes = _new(7.6, 4.6, "Figs 16, 21: stability check, with the numbers of the slope (mu 0.45)")
    demo = s.demo
    extent = float("nan") if demo.corrected.extent is None else CM * (demo.corrected.extent.value or float("nan"))
    now = demo.corrected.margin_now.value
    boxes = [
        ("1  region of the contacts (SOCP)", f"{demo.region.calls} directions, extent along r_M {extent:.2f} cm"),
        ("2  CoM now", f"Fig. 16: by kinematics, x = {CM * demo.com[0]:.2f} cm\nFig. 21: from stance forces (T2CM)"),
        ("3  movement with kinematic correction", f"r_KM = r_M + r_KIN = 4.30 {CM * demo.shift[0]:+.2f} cm"),
        (
            "4  signed margin",
            f"GSM {walas_ragno.gsm(demo.corrected):.2f} cm (without correction {walas_ragno.gsm(demo.plain):.2f}), "
            f"margin now {CM * (now or 0.0):.2f} cm",
        ),
    ]
    for i, (title, text) in enumerate(boxes):
        y = 3.0 - i
        axes.text(
            0.5, y, f"{title}\n{text}", ha="center", va="center",
            bbox={"boxstyle": "round,pad=0.5", "facecolor": "#f4f7fa", "edgecolor": BLUE},
        )  # fmt: skip
        if i < len(boxes) - 1:
            axes.annotate("", (0.5, y - 0.68), (0.5, y - 0.32), arrowprops={"arrowstyle": "-|>", "color": INK})
    axes.set_xlim(0.0, 1.0)
    axes.set_ylim(-0.5, 3.5)
    axes.axis("off")
    return figure


def _figure_17(s: StabilityStudy) -> Figure:
    figure, axes = _new(7.2, 5.8, "Fig. 17: Ragno on the 30 deg slope, r_M = +4.3 cm")
    demo = s.demo
    axes.plot(*_closed(demo.hull), ":", color=GREY, label="hull of the feet")
    for other, alpha in ((s.slopes[0], 0.35), (s.slopes[1], 0.6)):
        axes.plot(*_closed(other.region.inner), color=BLUE, lw=0.9, alpha=alpha, label=f"region, mu {other.mu:g}")
    axes.plot(*_closed(demo.region.inner), color=BLUE, label=f"region, mu {demo.mu:g}")
    axes.plot(*_closed(demo.sixteen.inner), "o", color=BLUE, markersize=3.0, label="16 directions")
    axes.plot(*(CM * demo.contacts.position[:, :2]).T, "s", color=INK, markersize=5, label="feet")
    axes.axvline(CM * walas_ragno.SLOPE_X, color=ORANGE, lw=0.8, label="slope begins")
    com, moved, after = demo.com, demo.com + walas_ragno.MOVE[:2], demo.corrected.com_after
    low = np.array([0.0, -0.012])
    _arrow(axes, com, moved, RED, "r_M")
    _arrow(axes, moved + low, after + low, PURPLE, "r_KIN")
    _arrow(axes, com + 2.0 * low, after + 2.0 * low, GREEN, "r_KM")
    axes.plot(*(CM * com), "x", color=INK)
    axes.plot(*(CM * after), "o", color=GREEN, label=f"CoM after, GSM {walas_ragno.gsm(demo.corrected):.2f} cm")
    axes.plot(*(CM * moved), "o", color=RED, label=f"without correction, GSM {walas_ragno.gsm(demo.plain):.2f} cm")
    _plane(axes)
    axes.legend(loc="upper left", fontsize=7.5)
    return figure


def _figure_18(s: StabilityStudy) -> Figure:
    figure, axes = _new(6.4, 3.8, "Fig. 18: characteristic of a pressure sensor")
    sensor = s.sensor
    force = np.linspace(0.0, 30.0, 400)
    axes.plot(force / GRAVITY, sensor.voltage(force), color=BLUE, label="characteristic")
    inside = np.array([sensor.least, sensor.most])
    offset, slope = sensor.line()
    axes.plot(inside / GRAVITY, (inside - offset) / slope, color=RED, label="straight line, 0.5 to 2 kg")
    axes.axvspan(inside[0] / GRAVITY, inside[1] / GRAVITY, color=GREY, alpha=0.12)
    axes.set_xlabel("load, kg")
    axes.set_ylabel("voltage, V")
    axes.legend(loc="lower right")
    return figure


def _figure_20(s: StabilityStudy) -> Figure:
    figure, axes = _new(7.6, 3.6, f"Fig. 20: force at the tip of {s.messor.leg_names[1]} in the tripod gait (Messor)")
    g = s.gait
    axes.plot(g.time, g.printed, color=GREY, lw=0.8, label="(30) as printed, 0.845 Nm/A")
    axes.plot(g.time, g.measured, color=BLUE, label="from currents, calibrated, with the leg's weight")
    axes.plot(g.time, g.true, color=INK, lw=0.9, ls="--", label="true")
    axes.set_xlabel("time, s")
    axes.set_ylabel("upward force, N")
    axes.legend(loc="upper right", ncols=3, fontsize=7.5)
    return figure


def _movement(s: StabilityStudy, side: float, title: str) -> Figure:
    figure, axes = _new(6.4, 4.4, f"{title} of the trunk by 10 cm (Messor)")
    w = s.sweep
    chosen = side * np.array([r.trunk[0] - w.readings[0].trunk[0] for r in w.readings]) > -0.002
    for path, colour, mark, name in (
        (w.printed, GREY, "o-", "(30), (31) and 0.845 Nm/A"),
        (w.gain_free, BLUE, "s-", "from forces, gain-free"),
        (w.true, INK, "x", "true"),
    ):
        axes.plot(*(CM * path[chosen]).T, mark, color=colour, markersize=4, label=name)
    for foot in s.standing.feet[:, :2]:
        axes.plot(*(CM * foot), "s", color=INK, markersize=5)
    _plane(axes)
    axes.legend(loc="upper left", fontsize=7.5)
    return figure


def _figure_24(s: StabilityStudy) -> Figure:
    figure, axes = _new(6.4, 5.0, "Fig. 24: measured stance forces and CoM (Messor)")
    st = s.standing
    axes.plot(*_closed(st.region.inner), color=BLUE, label="support region")
    for foot, force in zip(st.feet, st.force, strict=True):
        axes.plot(*(CM * foot[:2]), "s", color=INK, markersize=5)
        _arrow(axes, foot, foot + np.array([0.0, 0.012 * force[2], 0.0]), ORANGE)
        axes.annotate(f"{force[2]:.2f} N", _at(foot), (5, -11), textcoords="offset points", fontsize=7.5)
    axes.plot(*(CM * st.measured), "+", color=RED, markersize=14, markeredgewidth=2, label="CoM, measured")
    axes.plot(*(CM * st.reading.com), "o", color=GREEN, markersize=4, label="CoM, true")
    _plane(axes)
    axes.legend(loc="lower left")
    return figure
