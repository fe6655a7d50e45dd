"""Style of all plots, and SVG texts that can stand side by side in one HTML page."""

import io
import re
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, TypeVar

import matplotlib as mpl
import numpy as np
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure
from numpy.typing import NDArray

from surefoot.disk import whole
from surefoot.errors import SurefootError

S = TypeVar("S")
MAX_POINTS = 1500  # of one curve: more cannot be seen and only makes the page heavy
PAGE_WIDTH = 7.6  # inches, of all plots of a report
INK, GRID, PAPER = "#1c2733", "#dfe5ea", "none"
BLUE, ORANGE, GREEN, RED, PURPLE, GREY = "#1f6fb2", "#e07b1a", "#2a9d63", "#cc3b3b", "#7a4fb5", "#8a97a3"

STYLE: dict[Any, Any] = {
    "svg.fonttype": "none",
    "font.family": "sans-serif",
    "font.size": 9.0,
    "axes.edgecolor": GREY,
    "axes.labelcolor": INK,
    "axes.grid": True,
    "axes.axisbelow": True,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "grid.color": GRID,
    "xtick.color": INK,
    "ytick.color": INK,
    "text.color": INK,
    "lines.linewidth": 1.3,
    "legend.frameon": False,
    "legend.fontsize": 8.5,
}


def new_figure(width: float, height: float) -> Figure:
    """Return an empty white figure for SVG files, sizes in inches."""
    figure = Figure(figsize=(width, height), layout="constrained", facecolor="white")
    FigureCanvasSVG(figure)
    return figure


PICTURES = (".png", ".svg", ".pdf")
"""File name endings of the picture formats that `save_picture` can write."""


def page_figure(height: float) -> Figure:
    """Return an empty figure without background, as wide as the page of a report; height in inches."""
    figure = Figure(figsize=(PAGE_WIDTH, height), layout="constrained", facecolor=PAPER)
    FigureCanvasSVG(figure)
    return figure


def thinned(rows: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return every k-th row of rows (n, c), in their units, so that fewer than twice `MAX_POINTS` are left."""
    return rows[:: max(1, len(rows) // MAX_POINTS)]


def save_picture(figure: Figure, path: Path) -> Path:
    """Write a figure in the format of the file's ending, all of it or nothing; return the path.

    Raises:
        SurefootError: the ending is none of `PICTURES`.
    """
    ending = path.suffix.lower()
    if ending not in PICTURES:
        raise SurefootError("invalid", f"{path} ends in {ending!r}; known are {', '.join(PICTURES)}", "out")
    with whole(path) as part:
        figure.savefig(part, format=ending[1:])
    return path


def write_figures(plots: Mapping[str, Callable[[S], Figure]], study: S, folder: Path | None) -> tuple[Path, ...]:
    """Write figures of a study as SVG files into a folder, which is made; return their paths.

    Args:
        plots: function that draws each figure, by the name of its file without ending.
        study: argument of these functions.
        folder: None = nothing is written.
    """
    if folder is None:
        return ()
    folder.mkdir(parents=True, exist_ok=True)
    paths = [folder / f"{name}.svg" for name in plots]
    with mpl.rc_context({**STYLE, "svg.hashsalt": "surefoot"}):
        for path, plot in zip(paths, plots.values(), strict=True):
            plot(study).savefig(path, format="svg", metadata={"Date": None})
    return tuple(paths)


def svg_of(figure: Figure, prefix: str) -> str:
    """Return the figure as an SVG element for use in HTML: no prologue, no metadata, ids that begin with `prefix`."""
    stream = io.StringIO()
    with mpl.rc_context({"svg.hashsalt": prefix}):
        nothing = dict.fromkeys(("Creator", "Date", "Format", "Type"))
        figure.savefig(stream, format="svg", metadata=nothing, transparent=True)
    text = stream.getvalue()
    text = text[text.index("<svg") :]
    text = re.sub(r"<metadata>.*?</metadata>", "", text, flags=re.DOTALL)
    text = re.sub(r'\sxmlns(:\w+)?="[^"]*"', "", text)
    text = re.sub(r'<svg ([^>]*?)width="[^"]*" height="[^"]*"|<svg ', r"<svg \1", text, count=1)
    text = re.sub(r"(\d\.\d\d)\d+", r"\1", text)  # hundredths of a pixel are enough
    text = re.sub(r'\bid="', f'id="{prefix}-', text)
    return re.sub(r'(url\(#|href="#)', rf"\g<1>{prefix}-", text)
