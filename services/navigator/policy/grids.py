"""Tables of action values on a grid, with interpolation between its points.

table (layers, nd, nphi, A): layer = drift of the planner or entropy of the learner; d = distance of the goal, 0 to
d_max, clamped; phi = its bearing, periodic, row 0 at -pi. Weights are multilinear hats: not negative, of sum 1.
"""

import math

from surefoot.arrays import Array, Record
from surefoot.kernels.jit import row_kernel

D_MIN, D_MAX, LAYER_MIN, LAYER_MAX, MIRRORED, PER_M = 0, 1, 2, 3, 4, 5
"""Indices of a grid's elements. `D_MIN`, `D_MAX`: distance of the first and last row, m; `LAYER_MIN`, `LAYER_MAX`:
value of the first and last layer; `MIRRORED`: 1 = layers mirror, -1 = bearings do; `PER_M`: value that each m beyond
the last row adds."""
GRID = 6


@row_kernel
def place(value: float, low: float, high: float, count: int) -> tuple[int, float]:
    """Return where a value lies on an axis of `count` points, evenly from `low` to `high`, which clamp it.

    Returns:
        Index i of the point before it, and weight w of the point i + 1, 0 to 1.
    """
    if count < 2:
        return 0, 0.0
    u = (min(max(value, low), high) - low) / (high - low) * (count - 1)
    i = min(int(u), count - 2)
    return i, u - i


@row_kernel
def add_values(
    table: Array, grid: Array, actions: Record, d: float, phi: float, layer: float, weight: float, out: Array
) -> None:
    """Add `weight` times the values of all actions in a table, by linear interpolation, to `out`, in place.

    If grid[4] = 1, a negative layer is read at (-phi, -layer); if -1, a negative phi at -phi: left and right actions
    are then exchanged.

    Args:
        table: action values by layer, distance, bearing and action, (nl, nd, nphi, A) s.
        grid: distance of the first and last row (m), value of the first and last layer, mirrored (1, -1 or 0), value
            that each m beyond the last row adds, (6,).
        actions: actions of the model, records whose `mirror` is the index of the action to the other side, (A,).
        d: distance of the goal, m.
        phi: bearing of the goal, rad.
        layer: third coordinate of the table: drift, rad per m, or entropy of the belief, nats.
        weight: factor.
        out: values of all actions, (A,) s, added to.
    """
    flip = (grid[MIRRORED] > 0.0 and layer < 0.0) or (grid[MIRRORED] < 0.0 and phi < 0.0)
    if flip:
        phi = -phi
        if grid[MIRRORED] > 0.0:
            layer = -layer
    nl, nd, nphi = table.shape[0], table.shape[1], table.shape[2]
    beyond = grid[PER_M] * max(0.0, d - grid[D_MAX])
    il, wl = place(layer, grid[LAYER_MIN], grid[LAYER_MAX], nl)
    jd, wd = place(d, grid[D_MIN], grid[D_MAX], nd)
    u = (phi + math.pi) / (2.0 * math.pi) * nphi
    whole = math.floor(u)
    wp = u - whole
    k0 = int(whole) % nphi
    k1 = k0 + 1 if k0 + 1 < nphi else 0
    jd1, il1 = min(jd + 1, nd - 1), min(il + 1, nl - 1)
    w00, w01, w10, w11 = (1.0 - wd) * (1.0 - wp), (1.0 - wd) * wp, wd * (1.0 - wp), wd * wp
    for a in range(table.shape[3]):
        low = w00 * table[il, jd, k0, a] + w01 * table[il, jd, k1, a]
        low += w10 * table[il, jd1, k0, a] + w11 * table[il, jd1, k1, a]
        if wl > 0.0:
            high = w00 * table[il1, jd, k0, a] + w01 * table[il1, jd, k1, a]
            high += w10 * table[il1, jd1, k0, a] + w11 * table[il1, jd1, k1, a]
            low += wl * (high - low)
        out[int(actions[a].mirror) if flip else a] += weight * (low + beyond)
