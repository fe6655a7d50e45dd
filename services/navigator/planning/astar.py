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

from surefoot.arrays import Ints
from surefoot.kernels.jit import inner_kernel, row_kernel

Bytes = NDArray[np.uint8]
Ints32 = NDArray[np.int32]

STRAIGHT, DIAGONAL = 12, 17
UNIT = 4
"""Cost factor of a cell far from all obstacles, no unit."""
HEAVIEST = 16
"""Cost factor of a cell nearest to an obstacle, the largest, no unit."""
RUN = 32
"""Largest number of cells of a straight run that one step of the search takes."""
BUCKETS = 8192
"""Number of buckets of the queue of open cells: a power of two above twice the largest cost of one step and one run, 4
DIAGONAL HEAVIEST + 4 STRAIGHT UNIT RUN."""
NOWHERE = -1
"""Goal index of a search without a goal, which settles every cell in reach."""
EVEN = 128
"""Bit of a cell's weight that is set if all eight neighbours weigh as much as the cell."""
FACTOR = 127
"""Bit mask of the cost factor in a cell's weight."""
ANY = 8
"""Direction number of a cell that no step led to, as the start: all eight directions are expanded."""
UNSEEN = 2**31 - 1
GROWTH = 65_536
"""Initial number of entries in the pool of the queue of open cells."""


@row_kernel
def enter(
    entry: int, f: int, heads: Ints32, cell_of: Ints32, next_of: Ints32, spare: int, used: int
) -> tuple[int, int]:
    """Enter an open cell into the bucket of its cost f in the queue; the three arrays are changed in place.

    Args:
        entry: index of a cell << 4 | direction of the step to it, 0 to 7, or 8 for none.
        f: cost from the start plus bound on the rest of the path, no unit.
        heads: first place of each bucket in the pool, (buckets,), -1 = empty.
        cell_of: entry at each place of the pool, (places,).
        next_of: place after each, in a bucket or in the list of spare places, -1 = last, (places,).
        spare: first spare place, -1 = none: the place `used` is taken, which has to exist.
        used: number of places that were ever used.

    Returns:
        `spare` and `used` afterwards.
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
def doubled(entries: Ints32) -> Ints32:
    """Return an array of twice the length, (2 n,), that begins with `entries` (n,); the rest is uninitialised."""
    out = np.empty(2 * entries.size, dtype=np.int32)
    for i in range(entries.size):
        out[i] = entries[i]
    return out


class SearchMap(NamedTuple):
    """Costs, goal and neighbours of one A* search, constant while it runs; cells are indices of the flattened array."""

    weight: Bytes
    """Cost factors of the padded, flattened cells, (cells,): 0 = blocked; bit 128 set = all eight neighbours weigh as
    much."""
    wide: int
    """Number of cells in a padded row."""
    marks: Ints32
    """Costs between marks (cells with stored costs) and all cells, (cells, marks), no unit."""
    goal: int
    """Index of the goal in the flattened array; -1 = no goal."""
    goal_row: int
    """Row of the goal in the padded array of cells."""
    goal_col: int
    """Column of the goal in the padded array of cells."""
    offsets: Ints
    """Index offset of the neighbour in each direction in the flattened array, (8,): edges first, then corners."""
    onward: Ints
    """Directions to expand after a step in each direction if all cells around weigh the same, (8, 3)."""


class Successors(NamedTuple):
    """Successors of one cell in the search, at most eight."""

    entry: Ints
    """Queue entries of the successors, (8,): index of the cell << 4 | direction of the step to it."""
    f: Ints
    """Cost from the start to each successor, plus the lower bound on the cost from there to the goal, (8,)."""
    h: Ints
    """Lower bound on the cost from each successor to the goal, (8,)."""


@row_kernel
def _map_of(weight: Bytes, goal: int, marks: Ints32) -> SearchMap:
    """Return the constants of a search for one goal.

    Args:
        weight: cost factors (0 = blocked; bit 128: all eight neighbours weigh the same), padded by a frame of zeros,
            (rows + 2, cols + 2).
        goal: index of a cell in the flattened array, or -1 = none.
        marks: costs between marks (chosen cells) and all cells, (cells, marks), no unit.
    """
    wide = weight.shape[1]
    return SearchMap(
        weight.ravel(),
        wide,
        marks,
        goal,
        goal // wide,
        goal % wide,
        np.array([1, wide, -1, -wide, wide + 1, wide - 1, -wide - 1, -wide + 1]),
        np.array([[0, 0, 0], [1, 0, 0], [2, 0, 0], [3, 0, 0], [4, 0, 1], [5, 1, 2], [6, 2, 3], [7, 3, 0]]),
    )


@row_kernel
def bound(floor: SearchMap, cell: int) -> int:
    """Return a lower bound of the cost from a cell to the goal, no unit; 0 without a goal.

    A step over an edge costs 96 between two cells far from obstacles, up to 384 near them.

    Args:
        floor: constants of the search: goal, width, costs to marks.
        cell: index of the cell in the flattened array.
    """
    if floor.goal == NOWHERE:
        return 0
    dr, dc = abs(cell // floor.wide - floor.goal_row), abs(cell % floor.wide - floor.goal_col)
    h = 2 * UNIT * (STRAIGHT * max(dr, dc) + (DIAGONAL - STRAIGHT) * min(dr, dc))
    for m in range(floor.marks.shape[1]):
        h = max(h, abs(floor.marks[cell, m] - floor.marks[floor.goal, m]))
    return h


@row_kernel
def _run(floor: SearchMap, g: Ints32, n: int, step: int, cost: int) -> tuple[int, int]:
    """Follow a straight run of cells whose neighbours all weigh the same; return its end, and the cost there.

    The end is -1 where a cell of the run was reached as cheaply before.

    Args:
        floor: constants of the search.
        g: cost from the start, (cells,), no unit, written for the cells of the run.
        n: index of the first cell of the run.
        step: difference of the indices of two cells of the run.
        cost: cost at which the first one was reached.
    """
    length, each = 1, int(2 * STRAIGHT * (floor.weight[n] & FACTOR))
    while floor.weight[n] >= EVEN and n != floor.goal and length < RUN:
        cost += each
        if cost >= g[n + step]:
            return -1, cost
        n += step
        g[n] = cost
        length += 1
    return n, cost


@inner_kernel
def _expand(floor: SearchMap, g: Ints32, cell: int, came: int, here: int, out: Successors) -> int:
    """Write the successors of a cell that become cheaper; return their number.

    Args:
        floor: constants of the search.
        g: cost from the start, (cells,), no unit, written for cells that are reached more cheaply.
        cell: index of the cell.
        came: direction of the step to it, 0 to 7, or 8 = none.
        here: cost from the start to it.
        out: written: cell and direction, cost plus bound, bound of each end.
    """
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
        cost = int(here + (STRAIGHT if k < 4 else DIAGONAL) * (own + factor))
        if cost >= g[n]:
            continue
        g[n] = cost
        if k < 4:
            n, cost = _run(floor, g, n, floor.offsets[k], cost)
            if n < 0:
                continue  # its only successor has been reached as cheaply
        h = bound(floor, n)
        out.entry[count], out.f[count], out.h[count] = n << 4 | k, cost + h, h
        count += 1
    return count


@row_kernel
def _settle_rest(g: Ints32) -> int:
    """Mark the cells that a search reached but did not settle as settled, in place; return their number.

    `g`: cost c from the start, (cells,), no unit: -c - 1 of settled cells, c of seen ones, 2^31 - 1 of others.
    """
    count = 0
    for n in range(g.size):
        if 0 <= g[n] < UNSEEN:
            g[n] = -g[n] - 1
            count += 1
    return count


@row_kernel
def search(weight: Bytes, start: int, goal: int, marks: Ints32, g: Ints32) -> int:
    """Run A* from the start: settle cells in the order of their cost until the goal is settled.

    Args:
        weight: cost factors (0 = blocked; bit 128: all eight neighbours weigh the same), padded by a frame of zeros,
            (rows + 2, cols + 2).
        start: index of a free cell in the flattened array.
        goal: index of a cell in the region of the start; or -1: all cells in reach are settled.
        marks: costs between marks (chosen cells) and all cells of that region, (cells, marks); (cells, 0) = none.
        g: written, (cells,), no unit: with c the cost from the start, -c - 1 of settled cells, c of seen ones, 2^31 - 1
            of others. The cells inside of a run stay seen; where nothing is left to search, they are settled, too.

    Returns:
        Number of settled cells.
    """
    floor = _map_of(weight, goal, marks)
    g[:] = UNSEEN
    heads, ends = np.full(BUCKETS, -1, dtype=np.int32), np.zeros((3, 8), dtype=np.int64)
    out = Successors(ends[0], ends[1], ends[2])
    cell_of, next_of = np.empty(GROWTH, dtype=np.int32), np.empty(GROWTH, dtype=np.int32)
    spare, used, queued, settled = -1, 1, 1, 0
    g[start], f = 0, bound(floor, start)
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
    """Return the cost c of a cell from its entry after a search: -c - 1 if settled, c if reached, 2^31 - 1 if not."""
    return -entry - 1 if entry < 0 else entry


@row_kernel
def trace(weight: Bytes, start: int, goal: int, g: Ints32) -> Ints32:
    """Return the cells of the cheapest path from start to goal, indices in the flattened array, (n,).

    Args:
        weight: cost factors (0 = blocked; bit 128: all eight neighbours weigh the same), padded by a frame of zeros,
            (rows + 2, cols + 2).
        start: index of the first cell.
        goal: index of the last cell.
        g: cost c from the start as a search left it, (cells,): -c - 1 of settled cells, c of seen ones.
    """
    wide = weight.shape[1]
    w = weight.ravel()
    offsets = np.array([1, wide, -1, -wide, wide + 1, wide - 1, -wide - 1, -wide + 1])
    path = np.empty(1024, dtype=np.int32)
    path[0], n, cell = goal, 1, goal
    while cell != start:
        here, factor, other = cost_of(g[cell]), w[cell] & FACTOR, cell
        for k in range(8):
            other = cell + offsets[k]
            step = (STRAIGHT if k < 4 else DIAGONAL) * (factor + (w[other] & FACTOR))
            across = offsets[k] - wide if k < 6 else offsets[k] + wide
            before = cost_of(g[other])  # pyright: ignore[reportArgumentType] - a number to the compiler
            if before + step == here and (k < 4 or (w[cell + across] > 0 and w[other - across] > 0)):
                break
        cell = other
        if n == path.size:
            path = doubled(path)
        path[n] = cell
        n += 1
    return path[:n][::-1].copy()
