"""Ground coefficients by numpy slices in float64: the reference of the compiled ones."""

import numpy as np
from numpy.typing import NDArray

from surefoot.services.footholds.features import Features, Layer, push_direction

Vector = NDArray[np.float64]


def map_features_numpy(z: Layer, stroke: Vector, cell: float) -> Features:
    """Return the coefficients of every cell of a map by numpy slices in float64: the reference of `map_features`.

    (1) K1 = sum (z_c - z_n), (2) K2 = sum |z_c - z_n| over the 8 neighbours,
    (3) n = res (sx [dz(-sx,sy) - dz(sx,sy) - 2 dz(sx,0)], sy [dz(sx,-sy) - dz(sx,sy) - 2 dz(0,sy)], 4 res),
    the sum of the cross products of the five neighbours within 90 deg of the quadrant (sx, sy) of the push,
    (4) cos K3 = n.f / (|n| |f|).
    """
    fx, fy, fz = push_direction(stroke)
    sx, sy = (1 if fx >= 0.0 else -1), (1 if fy >= 0.0 else -1)
    padded = np.pad(z.astype(np.float64), 1, constant_values=np.nan)
    ny, nx = z.shape

    def dz(p: int, q: int) -> Vector:
        return padded[1 + q : 1 + q + ny, 1 + p : 1 + p + nx] - padded[1:-1, 1:-1]

    ring = np.stack([dz(p, q) for q in (-1, 0, 1) for p in (-1, 0, 1) if (p, q) != (0, 0)])
    k1, k2 = -ring.sum(axis=0), np.abs(ring).sum(axis=0)
    n_x = sx * (dz(-sx, sy) - dz(sx, sy) - 2.0 * dz(sx, 0))
    n_y = sy * (dz(sx, -sy) - dz(sx, sy) - 2.0 * dz(0, sy))
    n_z = 4.0 * cell
    cos_k3 = (n_x * fx + n_y * fy + n_z * fz) / np.sqrt(n_x**2 + n_y**2 + n_z**2)
    cos_k3[np.isnan(k2)] = np.nan
    return Features(k1.astype(np.float32), k2.astype(np.float32), cos_k3.astype(np.float32))
