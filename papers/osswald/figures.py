"""Figures 3 to 6 of Osswald et al. drawn again, one SVG file each."""

import math
from collections.abc import Callable
from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.patches import Circle, Ellipse, Rectangle

from surefoot.arrays import Array
from surefoot.lab.report.drawing import BLUE, GREEN, GREY, INK, ORANGE, RED, new_figure, write_figures
from surefoot.services.navigator.policy.params import Scene

from .episode import Episode
from .measures import WINDOW, moving_mean, typical
from .study import NavigationStudy

CHI2 = 5.991  # 95 % of 2 degrees of freedom
ELLIPSE_EVERY = 8  # actions


def draw(study: NavigationStudy, out: Path | None) -> tuple[Path, ...]:
    """Draw all figures of the study into the folder `out`; return their paths, none if it is None."""
    plots: dict[str, Callable[[NavigationStudy], Figure]] = {
        "fig3-training-paths": _figure_3,
        "fig4-training-times": _figure_4,
        "fig5-trajectory": _figure_5,
        "fig6-features": _figure_6,
    }
    return write_figures(plots, study, out)


def _corridor(figure: Figure, scene: Scene, title: str) -> Axes:
    axes = figure.add_subplot(1, 1, 1)
    axes.set_title(title, loc="left", fontsize=10)
    corner, size = (scene.x_min, scene.y_min), (scene.x_max - scene.x_min, scene.y_max - scene.y_min)
    axes.add_patch(Rectangle(corner, *size, fill=False, edgecolor=INK, linewidth=1.5))
    axes.add_patch(Circle((scene.goal_x, scene.goal_y), scene.goal_radius, fill=False, edgecolor=RED, zorder=4))
    axes.plot(scene.start_x, scene.start_y, "s", color=RED, markersize=4, zorder=4)
    axes.set_xlim(scene.x_min - 0.1, scene.x_max + 0.1)
    axes.set_ylim(scene.y_min - 0.1, scene.y_max + 0.1)
    axes.set_aspect("equal")
    axes.set_xlabel("x, m")
    axes.set_ylabel("y, m (left)")
    return axes


def _figure_3(s: NavigationStudy) -> Figure:
    figure = new_figure(8.4, 3.6)
    axes = _corridor(figure, s.normal.model.scene, "Fig. 3: true paths of every 10th training episode")
    last = s.paths[-1][0]
    shades = mpl.colormaps["Greys"]
    for number, e in s.paths:
        moved = np.concatenate(([True], ~e.stands))
        axes.plot(*e.truth[moved, :2].T, color=shades(0.2 + 0.8 * number / last), lw=0.6, zorder=1 + number / last)
    norm = Normalize(0, last)
    figure.colorbar(ScalarMappable(norm, shades), ax=axes, shrink=0.7, label="episode")
    return figure


def _figure_4(s: NavigationStudy) -> Figure:
    figure = new_figure(7.6, 3.8)
    axes = figure.add_subplot(1, 1, 1)
    axes.set_title("Fig. 4: time of the training episodes", loc="left", fontsize=10)
    v = s.normal
    middle = np.arange(v.trained.shape[1] - WINDOW + 1) + WINDOW / 2
    for i, seconds in enumerate(v.trained):
        if i != v.chosen:
            axes.plot(middle, moving_mean(seconds), color=GREY, lw=0.6, alpha=0.7, label="" if i else "other trainings")
    chosen = v.trained[v.chosen]
    axes.plot(chosen, ".", color=BLUE, markersize=1.5, alpha=0.5, label="one training")
    axes.plot(middle, moving_mean(chosen), color=BLUE, label=f"its mean of {WINDOW}")
    for at, name, side, shift in ((700, "caption", "right", -3), (800, "text", "left", 3)):
        axes.axvline(at, color=ORANGE, lw=0.9, ls="--")
        axes.annotate(name, (at, 400.0), (shift, 0), textcoords="offset points", color=ORANGE, ha=side)
    axes.set_ylim(0.0, 720.0)
    axes.set_xlabel("episode")
    axes.set_ylabel("time, s")
    axes.legend(loc="upper right")
    return figure


def _figure_5(s: NavigationStudy) -> Figure:
    figure = new_figure(8.4, 3.4)
    e = typical(s.normal.learned_walks)
    side = "left" if e.drift > 0.0 else "right"
    title = f"Fig. 5: the learned policy in simulation, drift to the {side}, {e.seconds:.0f} s"
    axes = _corridor(figure, s.normal.model.scene, title)
    axes.plot(*e.truth[:, :2].T, color=INK, label="true")
    axes.plot(*e.mean[:, :2].T, color=BLUE, label="estimated, 95 % ellipses")
    for at in range(0, len(e.mean), ELLIPSE_EVERY):
        axes.add_patch(_ellipse(e.mean[at], e.cov[at]))
    for way, mark, name in ((1, "^", "turn left"), (-1, "v", "turn right")):
        at = np.flatnonzero(e.turns == way)
        if at.size:
            axes.plot(*e.mean[at, :2].T, mark, color=ORANGE, markersize=4, ls="none", label=name)
    if e.stands.any():
        axes.plot(*e.mean[:-1][e.stands, :2].T, "o", color=GREEN, markersize=4, ls="none", label="stand")
    axes.legend(loc="upper left", ncols=5)
    return figure


def _ellipse(mean: Array, cov: Array) -> Ellipse:
    size, axis = np.linalg.eigh(cov[:2, :2])
    width, height = 2.0 * np.sqrt(CHI2 * size[::-1])
    angle = math.degrees(math.atan2(axis[1, 1], axis[0, 1]))
    return Ellipse((float(mean[0]), float(mean[1])), width, height, angle=angle, fill=False, edgecolor=BLUE, lw=0.5)


def _figure_6(s: NavigationStudy) -> Figure:
    figure = new_figure(9.0, 5.6)
    v = s.blur
    pair = ((typical(v.hand_walks), "hand controller"), (typical(v.learned_walks), "learned policy"))
    rows = figure.subplots(3, 2, sharex=True, sharey="row")
    for column, (e, name) in enumerate(pair):
        shown = e.features * (1.0, 180.0 / math.pi, 1.0)
        for axes, values, label in zip(rows[:, column], shown.T, ("d, m", "phi, deg", "h, nats"), strict=True):
            _over_time(axes, e, values)
            if column == 0:
                axes.set_ylabel(label)
        title = f"{name}: {e.seconds:.0f} s, {e.stands.sum()} stands"
        rows[0, column].set_title(f"Fig. 6: {title}" if column == 0 else title, loc="left", fontsize=10)
        rows[2, column].set_xlabel("time, s")
    rows[2, 0].axhline(v.threshold, color=ORANGE, lw=0.9, ls="--", label="it stands above")
    rows[2, 0].legend(loc="upper right")
    return figure


def _over_time(axes: Axes, e: Episode, values: Array) -> None:
    for at in np.flatnonzero(e.stands):
        axes.axvspan(e.time[at], e.time[at + 1], color=GREEN, alpha=0.35, lw=0.0)
    axes.plot(e.time, values, color=BLUE)
