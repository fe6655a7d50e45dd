"""Fig. 3 of Wawrzynski et al. drawn again, and the errors over all walks."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from surefoot.lab.report.drawing import BLUE, GREY, INK, ORANGE, new_figure, write_figures

from .study import PAPER, Experiment

TITLES = {
    "imu": "IMU only (IV-A)", "kinematics": "kinematics (IV-B)", "kinematics_gyro": "kinematics and gyro (IV-C)",
    "paper": "EKF (V)", "ekf": "ours, ekf", "best": "ours, best",
}  # fmt: skip
LIMIT = 0.3  # m/s, of the axes but those of the IMU alone


def draw(done: Sequence[Experiment], out: Path | None) -> tuple[Path, ...]:
    """Draw all figures of the experiments into the folder `out`; return their paths, none if it is None."""
    return write_figures({"fig3-velocity": lambda all_: _figure_3(all_[0]), "errors": _errors}, done, out)


def _figure_3(one: Experiment) -> Figure:
    """Return the figure of the velocity along x of the IMU by every estimator, and of the truth."""
    names = [*PAPER, *(name for name in one.tracks if name not in PAPER)]
    figure = new_figure(9.0, 1.7 * len(names))
    rows = one.walking
    t = one.log.seconds[rows] - one.log.seconds[rows][0]
    panels = figure.subplots(len(names), 1, sharex=True)
    for axes, name in zip(panels, names, strict=True):
        axes.plot(t, one.tracks[name].v[rows, 0], color=BLUE if name in PAPER else ORANGE, lw=0.8)
        axes.plot(t, one.log.v[rows, 0], color=INK, lw=0.7)
        axes.set_title(TITLES.get(name, name), loc="left", fontsize=9)
        axes.set_ylabel("v x, m/s")
        if name != "imu":
            axes.set_ylim(-LIMIT, LIMIT)
    panels[-1].set_xlabel("s; black: truth")
    return figure


def _errors(done: Sequence[Experiment]) -> Figure:
    """Return the figure of the errors of every walk by estimator: of the mean velocity, equation (38), and rms."""
    names = [name for name in done[0].tracks if name != "imu"]
    figure = new_figure(9.0, 3.2)
    left, right = figure.subplots(1, 2)
    for i, name in enumerate(names):
        share = [100 * (one.average[name][0] / one.average[name][1] - 1.0) for one in done]
        rmse = [100 * one.scores[name].rmse for one in done]
        spread = np.linspace(-0.15, 0.15, len(done))
        for axes, values in ((left, share), (right, rmse)):
            axes.plot(i + spread, values, "o", ms=3, color=BLUE if name in PAPER else ORANGE)
    left.axhline(100 * (3.28 / 3.57 - 1.0), color=GREY, lw=1.0, ls="--")
    left.set(title="error of the mean velocity (38), %; dashed: the paper", ylabel="%")
    right.set(title="rms error of the velocity", ylabel="cm/s", ylim=(0.0, None))
    for axes in (left, right):
        axes.set_xticks(range(len(names)), names, rotation=20, ha="right")
    return figure
