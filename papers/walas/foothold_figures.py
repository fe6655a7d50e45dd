"""Figures 7 to 12 of Walas & Belter (2011) drawn again, one SVG file each."""

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from surefoot.lab.report.drawing import BLUE, GREEN, GREY, ORANGE, PURPLE, RED, new_figure, write_figures
from surefoot.services.footholds.learning.samples import StanceSample, gather
from surefoot.services.footholds.models.lattice import filled, inputs
from surefoot.services.footholds.models.learned import LearnedModel

from .foothold_runs import WalkResult
from .foothold_study import FootholdStudy, predicted

COLOURS = (GREY, "#444444", RED, ORANGE, BLUE, PURPLE, GREEN, "#c0a000")
MM = 1e3


def draw(study: FootholdStudy, out: Path | None) -> tuple[Path, ...]:
    """Draw all figures of a study and write them into the folder `out`; return their paths, none if it is None."""
    plots: dict[str, Callable[[FootholdStudy], Figure]] = {
        "fig07-data": lambda s: _cloud(s.exact, s.models["primitives K1, K2"], "Fig. 7: stances and bin means"),
        "fig08-elementary": lambda s: _surface(s.models["primitives K1, K2"], s.exact, "Fig. 8: elementary terms"),
        "fig09-gaussian": lambda s: _surface(s.models["Gaussian"], s.noisy, "Fig. 9: Gaussians, noisy primitives"),
        "fig10-window": _window,
        "fig11-accumulated": lambda s: _curves(s.walks, "Fig. 11: accumulated slip"),
        "fig12-re-learning": lambda s: _curves({"random": s.walks["random"], **s.relearned}, "Fig. 12: re-learning"),
    }
    return write_figures(plots, study, out)


def _new(title: str, columns: int = 1) -> tuple[Figure, list[Axes]]:
    figure = new_figure(5.2 * columns, 4.2)
    axes = [figure.add_subplot(1, columns, k + 1) for k in range(columns)]
    axes[0].set_title(title, loc="left", fontsize=10)
    return figure, axes


def _cloud(samples: Sequence[StanceSample], model: LearnedModel, title: str) -> Figure:
    figure, (left, right) = _new(title, 2)
    found = gather(samples, relief=False)
    u = inputs(found.x)
    bins = filled(model.lattice, found.x, found.r)
    centres = inputs(model.lattice.centres(bins))
    means = np.array([each.mean for each in bins.values()])
    for axes, at, r in ((left, u, found.r), (right, centres, means)):
        dots = axes.scatter(
            at[:, 0], at[:, 1], c=r, s=10, cmap="viridis", vmin=0.0, vmax=float(np.quantile(found.r, 0.98))
        )
        axes.set_xlabel("K1 / (8 cell)")
    left.set_ylabel("K2 / (8 cell)")
    figure.colorbar(dots, ax=right, label="r, slip per stroke")
    return figure


def _surface(model: LearnedModel, samples: Sequence[StanceSample], title: str) -> Figure:
    figure, (axes,) = _new(title)
    b = np.linspace(0.0, min(1.0, model.ranges[1][1]), 60)
    a = np.linspace(-b[-1], b[-1], 121)
    p = np.array([[predicted(model, x, y) if abs(x) <= y + 1e-9 else np.nan for x in a] for y in b])
    image = axes.pcolormesh(a, b, p, shading="nearest", cmap="viridis", rasterized=True)
    figure.colorbar(image, ax=axes, label="P, slip per stroke")
    u = inputs(gather(samples, relief=False).x)
    axes.plot(u[:, 0], u[:, 1], ".", color="white", markersize=1.5)
    axes.set(xlabel="K1 / (8 cell)", ylabel="K2 / (8 cell)", xlim=(a[0], a[-1]), ylim=(0.0, b[-1]))
    return figure


def _window(study: FootholdStudy) -> Figure:
    figure, axes = _new("Fig. 10: heights, Q and what is excluded", 3)
    z, q, mask = study.window
    least = np.unravel_index(int(np.argmin(np.where(mask == 0, q, np.inf))), q.shape)
    for one, layer, label in zip(
        axes, (MM * z, np.where(mask == 0, q, np.nan), np.where(mask == 0, np.nan, mask)), ("height, mm", "Q", "mask"),
        strict=True,
    ):  # fmt: skip
        figure.colorbar(one.imshow(layer, origin="lower", cmap="viridis"), ax=one, label=label)
        one.plot(least[1], least[0], "x", color=RED)
    return figure


def _curves(walks: dict[str, list[WalkResult]], title: str) -> Figure:
    figure, (axes,) = _new(title)
    for colour, (name, some) in zip(COLOURS, walks.items(), strict=False):
        steps = min(each.steps for each in some)
        curves = np.array([each.accumulated(steps) for each in some])
        mean, sd, n = curves.mean(axis=0), curves.std(axis=0), np.arange(1, steps + 1)
        axes.plot(n, mean, color=colour, label=name)
        axes.fill_between(n, mean - sd, mean + sd, color=colour, alpha=0.12, linewidth=0)
    axes.set(xlabel="step", ylabel="S, sum of r over stances")
    axes.legend()
    return figure
