"""Kernels that prepare a grid for planning: distance to obstacles, cost of a cell, connected regions.

Work on padded arrays: a frame of one blocked cell around the grid spares every neighbour its test of the borders.
"""

import math

import numpy as np
from numpy.typing import NDArray

from surefoot.kernels.jit import row_kernel

Bytes = NDArray[np.uint8]
Ints = NDArray[np.int32]


@row_kernel
def blocked(cells: NDArray[np.int8], obstacle: int, through_unknown: bool) -> Bytes:
    """Return 1 where a cell is an obstacle, padded, (rows + 2, cols + 2); the frame is one, too."""
    rows, cols = cells.shape
    out = np.ones((rows + 2, cols + 2), dtype=np.uint8)
    for r in range(rows):
        for c in range(cols):
            value = cells[r, c]
            out[r + 1, c + 1] = value >= obstacle or (value < 0 and not through_unknown)
    return out


@row_kernel
def squared_distance(wall: Bytes, most: int) -> Ints:
    """Squared distance in cells of every cell centre to the nearest wall's, exact up to `most`, then (most + 1)^2.

    d^2(r, c) = min over k of (k - c)^2 + down(r, k)^2, down = distance to the nearest wall of the same column.
    """
    rows, cols = wall.shape
    far = most + 1
    down = np.empty((rows, cols), dtype=np.int32)
    for r in range(rows):
        for c in range(cols):
            before = down[r - 1, c] + 1 if r > 0 else far
            down[r, c] = 0 if wall[r, c] else min(far, before)
    for r in range(rows - 2, -1, -1):
        for c in range(cols):
            down[r, c] = min(down[r, c], down[r + 1, c] + 1)
    out = np.empty((rows, cols), dtype=np.int32)
    for r in range(rows):
        for c in range(cols):
            out[r, c] = down[r, c] * down[r, c]
        for k in range(1, most + 1):
            k2 = k * k
            for c in range(cols - k):
                out[r, c] = min(out[r, c], down[r, c + k] * down[r, c + k] + k2)
            for c in range(k, cols):
                out[r, c] = min(out[r, c], down[r, c - k] * down[r, c - k] + k2)
    return out


@row_kernel
def weights(distance2: Ints, table: Bytes) -> Bytes:
    """Return the cost factor of every cell, `table[d^2]`; 0 = not to be entered. The frame stays 0."""
    rows, cols = distance2.shape
    out = np.zeros((rows, cols), dtype=np.uint8)
    last = table.size - 1
    for r in range(1, rows - 1):
        for c in range(1, cols - 1):
            out[r, c] = table[min(last, distance2[r, c])]
    return out


@row_kernel
def mark_even(weight: Bytes, bit: int) -> None:
    """Set a bit of the free cells that weigh the same as all eight neighbours, in place."""
    rows, cols = weight.shape
    before, this = np.zeros(cols, dtype=np.bool_), np.zeros(cols, dtype=np.bool_)
    for r in range(1, rows - 1):
        for c in range(1, cols - 1):
            w = weight[r, c]
            same = w > 0
            for i in range(-1, 2):
                for j in range(-1, 2):
                    same = same and weight[r + i, c + j] == w
            this[c] = same
        for c in range(1, cols - 1):  # a row behind, so that no mark is compared
            if before[c]:
                weight[r - 1, c] |= np.uint8(bit)
            before[c] = this[c]
    for c in range(1, cols - 1):
        if before[c]:
            weight[rows - 2, c] |= np.uint8(bit)


@row_kernel
def root(parent: Ints, i: int) -> int:
    """Representative of a label; shortens the way to it."""
    while parent[i] != i:
        parent[i] = parent[parent[i]]
        i = parent[i]
    return i


@row_kernel
def regions(weight: Bytes) -> Ints:
    """Label of the connected region of every free cell from 1 on, 0 = blocked; neighbours share an edge.

    A diagonal step needs both cells beside it, so it connects nothing that edges do not.
    """
    rows, cols = weight.shape
    label = np.zeros((rows, cols), dtype=np.int32)
    parent = np.zeros(rows * cols // 2 + 2, dtype=np.int32)
    used = 0
    for r in range(1, rows - 1):
        for c in range(1, cols - 1):
            if weight[r, c] == 0:
                continue
            left, under = label[r, c - 1], label[r - 1, c]
            if left == 0 and under == 0:
                used += 1
                parent[used] = used
                label[r, c] = used
            elif left == 0 or under == 0 or left == under:
                label[r, c] = max(left, under)
            else:
                a, b = root(parent, left), root(parent, under)
                parent[max(a, b)] = min(a, b)
                label[r, c] = min(a, b)
    names = np.zeros(used + 1, dtype=np.int32)
    count = 0
    for i in range(1, used + 1):
        at = root(parent, i)
        if names[at] == 0:
            count += 1
            names[at] = count
        names[i] = names[at]
    for r in range(1, rows - 1):
        for c in range(1, cols - 1):
            label[r, c] = names[label[r, c]]
    return label


@row_kernel
def nearest_free(weight: Bytes, label: Ints, wanted: int, row: float, col: float) -> tuple[int, int, float]:
    """Free cell nearest to a place, all in padded cells; of one region, or of any where `wanted` is 0.

    Returns:
        Row, column (0, 0 if there is none), distance in cells.
    """
    rows, cols = weight.shape
    best, best_r, best_c = math.inf, 0, 0
    for r in range(1, rows - 1):
        dr = (r - row) * (r - row)
        if dr >= best:
            continue
        for c in range(1, cols - 1):
            if weight[r, c] == 0 or (wanted != 0 and label[r, c] != wanted):
                continue
            d = dr + (c - col) * (c - col)
            if d < best:
                best, best_r, best_c = d, r, c
    return best_r, best_c, math.sqrt(best)


@row_kernel
def settled_costs(cost: Ints, marks: Ints, column: int) -> int:
    """Write the costs of a search of everything into a column of the marks; return the next mark's cell.

    That is the cell whose least cost to any mark so far is largest. Cells out of reach get 0 in every column.

    Args:
        cost: of `astar_kernel.search`, flattened: -cost - 1 where it was settled.
        marks: (cells, marks).
        column: to be written, or -1: none, and the next one is the cell farthest from this search's start.
    """
    best, farthest = 0, -1
    for i in range(cost.size):
        value = -cost[i] - 1 if cost[i] < 0 else 0
        if column >= 0:
            marks[i, column] = value
            for m in range(column):
                value = min(value, marks[i, m])
        if value > farthest:
            best, farthest = i, value
    return best
