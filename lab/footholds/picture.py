"""Drawings of a slip model: predicted slip P (per stroke) over ground coefficients K1, K2, samples, a scored map."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from surefoot.services.footholds.features import Features
from surefoot.services.footholds.models.lattice import inputs
from surefoot.services.footholds.models.learned import LearnedModel
from surefoot.services.footholds.models.protocol import UNLEARNED

SIZE = 201


def surface(model: LearnedModel, cos_k3: float = 0.0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return K1 (n,), K2 (n,), mm, and slip per stroke P[K2, K1] (n, n), NaN if |K1| > K2 or not learned."""
    scale = 8.0 * model.conditions.cell
    (low1, high1), (_, high2), _ = model.ranges
    k1, k2 = np.linspace(low1, high1, SIZE) * scale, np.linspace(0.0, high2, SIZE) * scale
    a, b = np.meshgrid(k1, k2)
    layers = (a, b, np.full(a.shape, cos_k3))
    p = model.predict(Features(*(layer.astype(np.float32) for layer in layers)), model.conditions.cell)
    p = np.where((np.abs(a) <= b + 1e-12) & (p != UNLEARNED), p, np.nan)
    return 1e3 * k1, 1e3 * k2, p


def draw(model: LearnedModel, path: Path) -> Path:
    """Draw the predicted slip per stroke P at cos K3 = 0, and the number of samples per bin; return the path."""
    import matplotlib as mpl
    from matplotlib.figure import Figure

    from ..report.drawing import STYLE, save_picture

    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(9.0, 3.6), layout="constrained")
        left, right = figure.subplots(1, 2)
        k1, k2, p = surface(model)
        image = left.pcolormesh(k1, k2, p, shading="nearest", cmap="viridis")
        figure.colorbar(image, ax=left, label="P, slip per stroke")
        left.set(title=f"{model.name}, cos K3 = 0", xlabel="K1, mm", ylabel="K2, mm")
        centres = inputs(model.lattice.centres(model.bins)) * np.array([8e3 * model.conditions.cell] * 2 + [1.0])
        count = np.array([each.count for each in model.bins.values()])
        dots = right.scatter(centres[:, 0], centres[:, 1], c=np.log10(count), s=8, cmap="magma_r")
        figure.colorbar(dots, ax=right, label="samples of a bin, log10")
        right.set(title="bins, all cos K3", xlabel="K1, mm", ylabel="K2, mm")
        return save_picture(figure, path)


def draw_scored(layers: Mapping[str, np.ndarray], cell: float, origin: tuple[float, float], path: Path) -> Path:
    """Draw heights, predicted slip P, support and masked cells of a scored map; return the path.

    Args:
        layers: z (m), p (slip per stroke), support, mask, (ny, nx) each.
        cell: edge length of a cell, m.
        origin: x, y of the centre of the first cell, m, map frame.
        path: picture to write; its suffix gives the format, e.g. .png.
    """
    import matplotlib as mpl
    from matplotlib.figure import Figure

    from ..report.drawing import STYLE, save_picture

    ny, nx = layers["z"].shape
    ends = (origin[0], origin[0] + cell * (nx - 1), origin[1], origin[1] + cell * (ny - 1))
    p = np.where(layers["p"] >= 0.0, layers["p"], np.nan)
    shown = (("z", layers["z"], "height, m"), ("p", p, "P, slip per stroke"), ("support", layers["support"], "support"))
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(10.0, 7.0), layout="constrained")
        axes = figure.subplots(2, 2).ravel()
        for one, (_, values, label) in zip(axes, shown, strict=False):
            image = one.imshow(values, origin="lower", extent=ends, cmap="viridis")
            figure.colorbar(image, ax=one, label=label)
        axes[3].imshow(layers["mask"] == 0, origin="lower", extent=ends, cmap="gray", vmin=0, vmax=1)
        axes[3].set_title("free cells (white), without a leg")
        for one in axes:
            one.set(xlabel="x, m", ylabel="y, m")
        return save_picture(figure, path)
