"""Plots of an estimate: velocity with its band, tilt, NIS, contacts and sliding, the path."""

from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure

from surefoot.geometry.constants import GRAVITY

from ..report.drawing import BLUE, GREEN, GREY, INK, ORANGE, RED, STYLE
from .results import NIS_BAND, Result
from .scores import base_pose

MAX_POINTS = 3000


def draw(result: Result, path: Path) -> Path:
    """Draw the plots of an estimate into one SVG file; return its path."""
    log, track = result.log, result.track
    every = max(1, len(log.stamp_ns) // MAX_POINTS)
    rows = slice(None, None, every)
    t = log.seconds[rows]
    with mpl.rc_context({**STYLE, "svg.hashsalt": "estimate"}):
        figure = Figure(figsize=(9.0, 14.0), layout="constrained")
        FigureCanvasSVG(figure)
        axes = figure.subplots(7, 1)
        sd = np.sqrt(np.maximum(np.diagonal(track.p[rows, 3:, 3:], axis1=1, axis2=2), 0.0))
        for i, axis in enumerate("xyz"):
            v = track.v[rows, i]
            axes[i].fill_between(t, v - 2 * sd[:, i], v + 2 * sd[:, i], color=BLUE, alpha=0.2, lw=0, label="2 sigma")
            axes[i].plot(t, v, color=BLUE, label=track.name)
            if log.truth is not None:
                axes[i].plot(t, log.v[rows, i], color=INK, lw=0.8, label="truth")
            top = max(0.05, 1.3 * float(np.abs(v).max()))
            axes[i].set(ylabel=f"v {axis}, IMU axes, m/s", ylim=(-top, top))
        axes[0].legend(ncols=3, loc="upper right")
        up = track.g[rows] / np.maximum(np.linalg.norm(track.g[rows], axis=1), 1e-9)[:, None]
        for i, axis in enumerate("xyz"):
            axes[3].plot(t, up[:, i], color=(BLUE, ORANGE, GREEN)[i], label=f"up {axis}")
            if log.truth is not None:
                axes[3].plot(t, log.up[rows, i] / GRAVITY, color=INK, lw=0.6)
        axes[3].set(ylabel="up, IMU axes")
        axes[3].legend(ncols=3, loc="upper right")
        axes[4].semilogy(t, np.maximum(track.nis[rows], 1e-3), ".", ms=2, color=BLUE)
        axes[4].axhspan(*NIS_BAND, color=GREEN, alpha=0.15, lw=0)
        axes[4].set(ylabel="NIS (95 % band)")
        _feet(axes[5], result, rows, t)
        axes[5].set(xlabel="s", ylabel="feet")
        axes[6].plot(track.position[rows, 0], track.position[rows, 1], color=BLUE, label=track.name)
        if log.truth is not None:
            place, _ = base_pose(log)
            place = place - place[0] + track.position[0]
            axes[6].plot(place[rows, 0], place[rows, 1], color=INK, lw=0.8, label="truth, laid over the start")
        axes[6].set(xlabel="x, m", ylabel="y, m", aspect="equal", adjustable="datalim")
        axes[6].legend(loc="upper right")
        figure.savefig(path, format="svg", metadata={"Date": None})
    return path


def _feet(axes, result: Result, rows: slice, t) -> None:
    """Draw a line per foot over time: contact by the sensors grey, by the estimator green, sliding red."""
    log, track = result.log, result.track
    if len(log.foot_ns) == 0:
        return
    at = np.clip(np.searchsorted(log.foot_ns, log.stamp_ns[rows], side="right") - 1, 0, len(log.foot_ns) - 1)
    for f in range(log.feet_count):
        axes.fill_between(t, f, f + 0.8 * log.contact[at, f], color=GREY, alpha=0.4, lw=0)
        if track.contact is not None:
            axes.plot(t, f + 0.8 * track.contact[rows, f], color=GREEN)
        if track.slipping is not None:
            axes.fill_between(t, f, f + 0.8 * track.slipping[rows, f], color=RED, alpha=0.6, lw=0)
    axes.set_yticks(np.arange(log.feet_count) + 0.4, [str(f) for f in range(log.feet_count)])
