"""Ground of real land: the elevation model of the Jacksboro fault in the sample data of matplotlib.

344 x 403 heights of real land, one a cell, scaled so that the highest is `amp` above the lowest. It continues beyond
its edges as its own mirror image; the seed turns it over and moves it. Where matplotlib came without its sample data,
the kind is refused.
"""

import importlib.util
from functools import lru_cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from surefoot.arrays import Array

from .grid import BLEND, PAD_END, Shape, ShapeSpec, random_stream, smooth

ELEVATION_HEIGHT = 0.087  # m, the same as of the mixed ground
ELEVATION_CELL = 0.005  # m between two of its heights
ELEVATION_FILE = "mpl-data/sample_data/jacksboro_fault_dem.npz"


def elevation_file() -> Path | None:
    """Return the path of the elevation model among matplotlib's sample data, None if absent; imports no matplotlib."""
    found = importlib.util.find_spec("matplotlib")
    path = None if found is None or found.origin is None else Path(found.origin).parent / ELEVATION_FILE
    return path if path is not None and path.is_file() else None


def elevation(r: ShapeSpec) -> Shape:
    """Return the heights of the Jacksboro fault as a field behind the flat pad where a robot starts.

    `r`: grid, seed (turns and moves the field) and height of the highest over the lowest point.

    Raises:
        FileNotFoundError: matplotlib is installed without its sample data, or not at all.
    """
    path = elevation_file()
    if path is None:
        raise FileNotFoundError(f"matplotlib's sample data ({ELEVATION_FILE}) is not installed")
    model, rng = _model(path), random_stream(r.seed, "terrain/elevation")
    turned, flipped_x, flipped_y = rng.random(3) < 0.5
    model = model.T if turned else model
    model = model[:: -1 if flipped_y else 1, :: -1 if flipped_x else 1]
    begin = [rng.uniform(0.0, 2.0 * n * ELEVATION_CELL) for n in model.shape]
    x, y = r.grid.axes()
    u, v = (x[0] + begin[1]) / ELEVATION_CELL, (y[:, 0] + begin[0]) / ELEVATION_CELL
    i, j = np.floor(u).astype(int), np.floor(v).astype(int)
    a, b = (u - i)[None, :], (v - j)[:, None]
    cols, rows = ([_mirrored(k + d, n) for d in (0, 1)] for k, n in ((i, model.shape[1]), (j, model.shape[0])))
    low, high = (model[row][:, cols[0]] * (1.0 - a) + model[row][:, cols[1]] * a for row in rows)
    z = r.amp * (low * (1.0 - b) + high * b) * smooth((x - PAD_END) / BLEND)
    return Shape(z, z)


@lru_cache(maxsize=2)
def _model(path: Path) -> Array:
    """Return the heights of a stored elevation model, (rows, cols), scaled to [0, 1]."""
    with np.load(path, allow_pickle=False) as archive:
        z = np.array(archive["elevation"], dtype=np.float64)
    return (z - z.min()) / (z.max() - z.min())


def _mirrored(index: NDArray[np.int64], n: int) -> NDArray[np.int64]:
    """Return indices of any shape folded into 0..n-1: forwards, backwards, forwards ..."""
    folded = index % (2 * n)
    return np.where(folded < n, folded, 2 * n - 1 - folded)
