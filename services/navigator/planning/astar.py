"""Route search: A* over cells with integer costs and a queue of buckets, as kernels on arrays.

A step between cells of weights v and w costs STRAIGHT (v + w) over an edge and DIAGONAL (v + w) over a corner (17/12 is
sqrt 2 but for 0.2 %), and over a corner only if both cells beside it are free. Bounds of the cost to the goal:

    2 UNIT (STRAIGHT (max - min) + DIAGONAL min)   of the offsets along rows and columns, and
    |d(mark, goal) - d(mark, cell)|                for marks whose costs to all cells are known (ALT; Goldberg 2005).

The larger one never exceeds the cost and is consistent, so a cell that has left the queue is settled. f = g + h grows
by less than BUCKETS from a cell to its neighbour: a ring of that many buckets is a queue, and within a bucket the last
comes first.

Where a cell and its eight neighbours weigh the same (EVEN), only the steps onward are taken: straight on after a step
over an edge; straight on and along both its parts after one over a corner. The other neighbours cost no more by a way
around the cell, over the corner first (canonical orders, as in jump point search; Harabor & Grastien 2011).
A run of EVEN cells straight on has one successor each, so only its end enters the queue, after RUN cells at the latest;
the cells of a run are seen, not settled, and a cheaper way to one of them runs on over the rest.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from surefoot.kernels.jit import inner_kernel, row_kernel

Bytes = NDArray[np.uint8]
Ints = NDArray[np.int32]
Longs = NDArray[np.int64]

STRAIGHT, DIAGONAL = 12, 17
UNIT = 4
"""Weight of a cell far from everything."""
HEAVIEST = 16
"""Largest weight."""
RUN = 32
"""Largest number of cells of a straight run that one step of the search takes."""
BUCKETS = 8192
"""Number of buckets of the queue of open cells: a power of two above twice the cost of the dearest step and run,
4 DIAGONAL HEAVIEST + 4 STRAIGHT UNIT RUN."""
NOWHERE = -1
"""Goal of a search that settles everything."""
EVEN = 128
"""Bit of a weight: the cell and its eight neighbours weigh the same."""
FACTOR = 127
"""Bits of the value of a weight."""
ANY = 8
"""Direction of a cell that was reached by no step."""
UNSEEN = 2**31 - 1
GROWTH = 65_536
"""Entries the pool of the queue begins with."""


@row_kernel
def bound(dr: int, dc: int, marks: Ints, cell: int, goal: int) -> int:
    """Return a lower bound of the cost from a cell to the goal, no unit: an edge of a free cell costs 2 * 12 * 4.

    Args:
        dr: offset along rows, cells.
        dc: offset along columns, cells.
        marks: costs between marks and cells, (cells, marks), UNSEEN where there is no way.
        cell: index of the cell.
        goal: index of the goal.
    """
    dr, dc = abs(dr), abs(dc)
    h = 2 * UNIT * (STRAIGHT * max(dr, dc) + (DIAGONAL - STRAIGHT) * min(dr, dc))
    for m in range(marks.shape[1]):
        h = max(h, abs(marks[cell, m] - marks[goal, m]))
    return h


@row_kernel
def enter(entry: int, f: int, heads: Ints, cell_of: Ints, next_of: Ints, spare: int, used: int) -> tuple[int, int]:
    """Put an entry (cell << 4 | direction) into the bucket of f, in place; all numbers are indices or costs, no unit.

    Args:
        entry: what to put.
        f: cost and bound.
        heads: first place of each bucket, (buckets,), -1 = empty.
        cell_of: entry at each place, (places,).
        next_of: place after each, of a bucket or of those that are spare, (places,).
        spare: first spare place, -1 = none: the place `used` is taken, which has to exist.
        used: places that were ever used.

    Returns:
        `spare` and `used`.
    """
    place = used
    if spare >= 0:
        place = spare
        spare = next_of[place]
    else:
        used += 1
    slot = f & (BUCKETS - 1)
    cell_of[place] = entry
    next_of[place] = heads[slot]
    heads[slot] = place
    return spare, used


@row_kernel
def doubled(entries: Ints) -> Ints:
    """Return an array (2 n,), no unit, that begins with these entries (n,); the rest is not set."""
    out = np.empty(2 * entries.size, dtype=np.int32)
    for i in range(entries.size):
        out[i] = entries[i]
    return out


class SearchMap(NamedTuple):
    """Costs, goal and neighbours of one A* search, constant while it runs."""

    weight: Bytes
    """Cost factors with the bit EVEN, padded and flattened, (cells,)."""
    wide: int
    """Cells of a padded row."""
    marks: Ints
    """Costs between marks and cells, (cells, marks)."""
    goal: int
    """Index of the goal, or NOWHERE."""
    goal_row: int
    goal_col: int
    offsets: Longs
    """Offset of the neighbour in each direction, cells, (8,): edges first, then corners."""
    row_of: Longs
    """Offset along rows, (8,)."""
    col_of: Longs
    """Offset along columns, (8,)."""
    onward: Longs
    """Directions after each, (8, 3)."""


class Successors(NamedTuple):
    """Ends of the steps from one cell."""

    entry: Longs
    """Cell << 4 | direction, (8,)."""
    f: Longs
    """Cost from the start to each end, plus the bound on the rest of the way, (8,)."""
    h: Longs
    """Lower bound on the cost of the rest of the way, (8,)."""


@row_kernel
def _map_of(weight: Bytes, goal: int, marks: Ints) -> SearchMap:
    """Return the constants of a search for one goal: weights with a border (rows + 2, cols + 2), goal, neighbours."""
    wide = weight.shape[1]
    return SearchMap(
        weight.ravel(),
        wide,
        marks,
        goal,
        goal // wide,
        goal % wide,
        np.array([1, wide, -1, -wide, wide + 1, wide - 1, -wide - 1, -wide + 1]),
        np.array([0, 1, 0, -1, 1, 1, -1, -1]),
        np.array([1, 0, -1, 0, 1, -1, -1, 1]),
        np.array([[0, 0, 0], [1, 0, 0], [2, 0, 0], [3, 0, 0], [4, 0, 1], [5, 1, 2], [6, 2, 3], [7, 3, 0]]),
    )


@row_kernel
def _run(floor: SearchMap, g: Ints, n: int, step: int, cost: int) -> tuple[int, int, int]:
    """Follow a straight run of EVEN cells from n by steps of `step`, reached at `cost`; write costs into g (cells,).

    Returns:
        End of the run, cost there, length in cells; length 0 where a cell of the run was reached as cheaply before.
    """
    length, each = 1, int(2 * STRAIGHT * (floor.weight[n] & FACTOR))
    while floor.weight[n] >= EVEN and n != floor.goal and length < RUN:
        cost += each
        if cost >= g[n + step]:
            return n, cost, 0
        n += step
        g[n] = cost
        length += 1
    return n, cost, length


@inner_kernel
def _expand(floor: SearchMap, g: Ints, cell: int, came: int, here: int, out: Successors) -> int:
    """Write the ends of the steps from a cell that become cheaper; return their number.

    Args:
        floor: constants of the search.
        g: costs, (cells,), written.
        cell: index of the cell.
        came: direction of the step to it, or ANY.
        here: its cost.
        out: result.
    """
    r, c = cell // floor.wide, cell % floor.wide
    even, own = floor.weight[cell] >= EVEN and came < ANY, floor.weight[cell] & FACTOR
    steps, count, closed = 8, 0, 0  # closed: bits of the edges that are not free
    if even:
        steps = 1 if came < 4 else 3
    for i in range(steps):
        k = floor.onward[came, i] if even else i
        n = cell + floor.offsets[k]
        factor = floor.weight[n] & FACTOR
        if not even:
            if factor == 0:
                closed |= 1 << k
                continue
            if k >= 4 and closed & (1 << floor.onward[k, 1] | 1 << floor.onward[k, 2]):
                continue
        cost, length = int(here + (STRAIGHT if k < 4 else DIAGONAL) * (own + factor)), 1
        if cost >= g[n]:
            continue
        g[n] = cost
        if k < 4:
            n, cost, length = _run(floor, g, n, floor.offsets[k], cost)
            if length == 0:
                continue  # its only successor has been reached as cheaply
        h = 0
        if floor.goal != NOWHERE:
            row, col = r + length * floor.row_of[k], c + length * floor.col_of[k]
            h = bound(row - floor.goal_row, col - floor.goal_col, floor.marks, n, floor.goal)
        out.entry[count], out.f[count], out.h[count] = n << 4 | k, cost + h, h
        count += 1
    return count


@row_kernel
def _settle_rest(g: Ints) -> int:
    """Settle the cells of g (cells,) that were seen only, in place; return their number."""
    count = 0
    for n in range(g.size):
        if 0 <= g[n] < UNSEEN:
            g[n] = -g[n] - 1
            count += 1
    return count


@row_kernel
def search(weight: Bytes, start: int, goal: int, marks: Ints, g: Ints) -> int:
    """Settle cells from the start on until the goal is.

    Args:
        weight: cost factors with the bit EVEN, padded by a frame of zeros, (rows + 2, cols + 2).
        start: index of a free cell in the flattened array.
        goal: index of a cell in the region of the start; or NOWHERE.
        marks: costs between marks and cells of that region, (cells, marks); (cells, 0) = none.
        g: cost from the start, flattened, written: settled cells as -g - 1, seen ones as g, others as UNSEEN. The cells
            inside of a run stay seen; where the search ends because nothing is left, they are settled, too.

    Returns:
        Number of settled cells.
    """
    floor = _map_of(weight, goal, marks)
    g[:] = UNSEEN
    heads, ends = np.full(BUCKETS, -1, dtype=np.int32), np.zeros((3, 8), dtype=np.int64)
    out = Successors(ends[0], ends[1], ends[2])
    cell_of, next_of = np.empty(GROWTH, dtype=np.int32), np.empty(GROWTH, dtype=np.int32)
    spare, used, queued, settled = -1, 1, 1, 0
    g[start] = 0
    f = 0
    if goal != NOWHERE:
        row, col = start // floor.wide - floor.goal_row, start % floor.wide - floor.goal_col
        f = bound(row, col, marks, start, goal)
    cell_of[0], next_of[0] = start << 4 | ANY, -1
    heads[f & (BUCKETS - 1)] = 0
    while queued > 0:
        slot = f & (BUCKETS - 1)
        entry = heads[slot]
        if entry < 0:
            f += 1
            continue
        heads[slot] = next_of[entry]
        cell, came = int(cell_of[entry] >> 4), int(cell_of[entry] & 15)
        next_of[entry] = spare
        spare = entry
        queued -= 1
        here = int(g[cell])
        if here < 0:
            continue
        g[cell] = -here - 1
        settled += 1
        if cell == goal:
            return settled
        if used + 8 > cell_of.size:
            cell_of, next_of = doubled(cell_of), doubled(next_of)
        count, held = _expand(floor, g, cell, came, here, out), 0
        for i in range(1, count):  # the most promising neighbour enters the queue last, to be taken first
            this = i
            if out.f[i] < out.f[held] or (out.f[i] == out.f[held] and out.h[i] < out.h[held]):
                this, held = held, i
            spare, used = enter(out.entry[this], out.f[this], heads, cell_of, next_of, spare, used)
        if count > 0:
            spare, used = enter(out.entry[held], out.f[held], heads, cell_of, next_of, spare, used)
        queued += count
    return settled + _settle_rest(g)


@row_kernel
def cost_of(entry: int) -> int:
    """Return the cost that `search` wrote of a cell, settled or seen; UNSEEN of others."""
    return -entry - 1 if entry < 0 else entry


@row_kernel
def trace(weight: Bytes, start: int, goal: int, g: Ints) -> Ints:
    """Return the cells of the path from start to goal, flat indices (n,), by the costs g (cells,) of `search`.

    `weight` (rows, cols): factor of each cell.
    """
    wide = weight.shape[1]
    w = weight.ravel()
    offsets = np.array([1, wide, -1, -wide, wide + 1, wide - 1, -wide - 1, -wide + 1])
    path = np.empty(1024, dtype=np.int32)
    path[0], n, cell = goal, 1, goal
    while cell != start:
        here, factor, found = cost_of(g[cell]), w[cell] & FACTOR, -1
        for k in range(8):
            if found >= 0:
                break
            other = cell + offsets[k]
            if w[other] == 0 or g[other] == UNSEEN:
                continue
            before = cost_of(g[other])  # pyright: ignore[reportArgumentType] - a number to the compiler
            if k < 4:
                if before + STRAIGHT * (factor + (w[other] & FACTOR)) == here:
                    found = other
            elif before + DIAGONAL * (factor + (w[other] & FACTOR)) == here:
                across = offsets[k] - wide if k < 6 else offsets[k] + wide
                if w[cell + across] > 0 and w[other - across] > 0:
                    found = other
        cell = found
        if n == path.size:
            path = doubled(path)
        path[n] = cell
        n += 1
    return path[:n][::-1].copy()
