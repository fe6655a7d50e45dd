"""Height maps of the tests."""

from pathlib import Path

import numpy as np

from surefoot.geometry.heightmap import HeightMap

CELL = 0.005


def bumpy(ny: int = 15, nx: int = 21, seed: int = 0, origin: tuple[float, float] = (0.0, 0.0)) -> HeightMap:
    """Random ground with more columns than rows."""
    z = np.random.default_rng(seed).uniform(-0.02, 0.03, (ny, nx))
    return HeightMap(z=z.astype(np.float32), cell=CELL, origin=origin)


def with_hole() -> HeightMap:
    z = np.array(bumpy().z)
    z[3, 4] = np.nan
    return HeightMap(z=z, cell=CELL, origin=(-0.5, 0.25), version=7)


def same(a: HeightMap, b: HeightMap) -> None:
    np.testing.assert_array_equal(a.z, b.z)
    assert (a.cell, a.origin, a.version, a.sha256) == (b.cell, b.origin, b.version, b.sha256)


def save_asc(heights: HeightMap, path: Path) -> Path:
    """Write an ESRI text grid, rows from y-max down; unknown cells are -9999."""
    rows, cols = heights.shape
    x0, y0 = heights.origin
    head = f"ncols {cols}\nnrows {rows}\nxllcenter {x0!r}\nyllcenter {y0!r}\ncellsize {heights.cell!r}\n"
    z = np.where(np.isfinite(heights.z), heights.z, np.float32(-9999.0))[::-1]
    body = "\n".join(" ".join(f"{value:.9g}" for value in row) for row in z.tolist())
    path.write_text(f"{head}NODATA_value -9999\n{body}\n", encoding="ascii")
    return path
