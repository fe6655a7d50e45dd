"""Plots of a run with goals: true and estimated path of the robot, and the decisions of the navigator."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Ellipse

from surefoot.arrays import Array

from .drawing import BLUE, GREEN, GREY, INK, ORANGE, PAPER, PURPLE, RED, page_figure, thinned
from .traces import Traces

ELLIPSES = 40
SCALE_95 = 2.4477  # of an ellipse that holds 95 % of a plane normal distribution
COLOURS = (BLUE, ORANGE, GREEN, PURPLE, RED, GREY, INK, "#b5894f")


def top_view(traces: Traces) -> Figure:
    """Return a map of the true and the estimated path, with 95 % ellipses of the estimate, and the goals."""
    figure = page_figure(3.6)
    axes = figure.add_subplot(facecolor=PAPER)
    truth, belief = thinned(traces.series("sim/truth")), traces.series("state/pose")
    for row in belief[:: max(1, len(belief) // ELLIPSES)]:
        axes.add_patch(_ellipse(row))
    if len(truth):
        axes.plot(truth[:, 1], truth[:, 2], color=BLUE, linewidth=1.8, label="true")
    axes.plot(belief[:, 1], belief[:, 2], color=ORANGE, linewidth=1.0, label="estimated, 95 %")
    for goal in traces.goals:
        axes.plot(*goal.place, "*", color=GREEN if goal.state == "succeeded" else RED, markersize=11)
    axes.set(xlabel="x, m", ylabel="y, m")
    axes.set_aspect("equal", adjustable="datalim")
    axes.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=3, borderaxespad=0.1)
    return figure


def _ellipse(row: Array) -> Ellipse:
    cov = row[4:13].reshape(3, 3)[:2, :2]
    values, axes = np.linalg.eigh(cov)
    size = 2.0 * SCALE_95 * np.sqrt(np.maximum(values, 0.0))
    angle = float(np.degrees(np.arctan2(axes[1, 1], axes[0, 1])))
    return Ellipse((row[1], row[2]), size[1], size[0], angle=angle, facecolor=ORANGE, alpha=0.15, linewidth=0)


def decisions(traces: Traces) -> Figure:
    """Return plots over time: actions, entropy of the pose, and the value of each action less the best one's."""
    figure = page_figure(4.6)
    first, second, third = (figure.add_subplot(3, 1, i + 1, facecolor=PAPER) for i in range(3))
    names = list(dict.fromkeys(choice.action for choice in traces.choices))
    for i, name in enumerate(names):
        times = [choice.time for choice in traces.choices if choice.action == name]
        first.plot(times, [i] * len(times), "|", color=COLOURS[i % len(COLOURS)], markersize=11, markeredgewidth=2)
    first.set_yticks(range(len(names)), names)
    first.set_ylim(-0.6, len(names) - 0.4)
    belief = thinned(traces.series("state/pose"))
    second.plot(belief[:, 0], belief[:, 13], color=INK)
    second.set(ylabel="entropy, nats")
    _values(third, traces, names)
    third.set(xlabel="t, s", ylabel="value less the best's")
    for axes in (first, second):
        axes.sharex(third)
        axes.tick_params(labelbottom=False)
    return figure


def _values(axes: Axes, traces: Traces, names: list[str]) -> None:
    for i, name in enumerate(names):
        rows = [
            (choice.time, choice.values[name] - max(choice.values.values()))
            for choice in traces.choices
            if name in choice.values
        ]
        if rows:
            axes.plot(*np.array(rows).T, ".-", color=COLOURS[i % len(COLOURS)], linewidth=0.8, markersize=3, label=name)
    if names:
        axes.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=4, borderaxespad=0.1)
