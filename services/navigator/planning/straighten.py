"""Replacement of parts of a path over cells by straight lines of no higher cost."""

import numpy as np

from surefoot.arrays import Flags
from surefoot.kernels.jit import row_kernel

from .astar import DIAGONAL, FACTOR, HEAVIEST, STRAIGHT, Bytes, Ints32
from .gap import gap
from .grid import Point


@row_kernel
def line_cost(weight: Bytes, r0: float, c0: float, r1: float, c1: float) -> float:
    """Return the cost of a straight line: 24 * length (cells) * mean weight; -1 if it crosses a blocked cell.

    Args:
        weight: cost factors (0 = blocked, low 7 bits 4 to 16), padded by a frame of zeros, (rows + 2, cols + 2).
        r0: row of the beginning in padded cells, cell i reaches from i to i + 1.
        c0: column of the beginning.
        r1: row of the end.
        c1: column of the end.
    """
    r, c, last_r, last_c = int(r0), int(c0), int(r1), int(c1)
    dr, dc = r1 - r0, c1 - c0
    length = np.sqrt(dr * dr + dc * dc)
    if weight[r, c] == 0:
        return -1.0
    if length == 0.0:
        return 0.0
    step_r, step_c = (1 if dr > 0.0 else -1), (1 if dc > 0.0 else -1)
    each_r, each_c = 1.0 / max(abs(dr), 1e-12), 1.0 / max(abs(dc), 1e-12)  # of the line per row and column
    next_r = ((r + 1 - r0) if dr > 0.0 else (r0 - r)) * each_r
    next_c = ((c + 1 - c0) if dc > 0.0 else (c0 - c)) * each_c
    at, total = 0.0, 0.0
    for _ in range(abs(last_r - r) + abs(last_c - c) + 2):
        to = min(1.0, min(next_r, next_c))
        total += (to - at) * (weight[r, c] & FACTOR)
        at = to
        if at >= 1.0 or (r == last_r and c == last_c):
            break
        if abs(next_r - next_c) < 1e-9:  # through a corner: both cells beside it have to be free
            if weight[r + step_r, c] == 0 or weight[r, c + step_c] == 0:
                return -1.0
            r, c = r + step_r, c + step_c
            next_r, next_c = next_r + each_r, next_c + each_c
        elif next_r < next_c:
            r, next_r = r + step_r, next_r + each_r
        else:
            c, next_c = c + step_c, next_c + each_c
        if weight[r, c] == 0:
            return -1.0
    return 2.0 * STRAIGHT * length * total


@row_kernel
def leads_out(weight: Bytes, r0: float, c0: float, r1: float, c1: float) -> bool:
    """Return True if a straight line crosses no blocked cell after it has left those at its beginning.

    Where it leaves them is found to a sixteenth of a cell.

    Args:
        weight: cost factors (0 = blocked), padded by a frame of zeros, (rows + 2, cols + 2).
        r0: row of the beginning in padded cells, cell i reaches from i to i + 1.
        c0: column of the beginning.
        r1: row of the end.
        c1: column of the end.
    """
    steps = int(16.0 * max(abs(r1 - r0), abs(c1 - c0))) + 1
    for i in range(steps):
        r, c = r0 + i * (r1 - r0) / steps, c0 + i * (c1 - c0) / steps
        if weight[int(r), int(c)] > 0:
            return line_cost(weight, r, c, r1, c1) >= 0.0
    return weight[int(r1), int(c1)] > 0


@row_kernel
def pull(weight: Bytes, path: Ints32, r_start: float, c_start: float, r_goal: float, c_goal: float) -> Ints32:
    """Return which cells of a path stay as corners when straight lines of no higher cost replace its parts.

    From each corner the farthest cell is sought whose line is free and costs no more than the path, by doubling and
    halving the way.

    Args:
        weight: cost factors (0 = blocked, low 7 bits 4 to 16), padded by a frame of zeros, (rows + 2, cols + 2).
        path: cells, indices in the flattened array, (n,).
        r_start: row of the exact start in padded cells, cell i reaches from i to i + 1; it replaces the first cell's
            centre.
        c_start: column of the start.
        r_goal: row of the exact goal, in place of the last cell's centre.
        c_goal: column of the goal.

    Returns:
        Indices into `path` of the corners, (k,); the first is 0 (the start), the last n - 1 (the goal).
    """
    wide, n = weight.shape[1], path.size
    w = weight.ravel()
    rows, cols = path // wide + 0.5, path % wide + 0.5
    rows[0], cols[0], rows[n - 1], cols[n - 1] = r_start, c_start, r_goal, c_goal
    spent = np.zeros(n)
    for i in range(1, n):
        over_edge = (path[i] // wide == path[i - 1] // wide) or (path[i] % wide == path[i - 1] % wide)
        both = (w[path[i]] & FACTOR) + (w[path[i - 1]] & FACTOR)
        spent[i] = spent[i - 1] + (STRAIGHT if over_edge else DIAGONAL) * both
    corners, count, at = np.empty(n, dtype=np.int32), 1, 0
    corners[0] = 0
    slack = STRAIGHT * HEAVIEST  # of the cells at both ends a line counts what it crosses
    while at < n - 1:
        good, step, bad = at + 1, 2, n
        while bad - good > 1:
            j = min(at + step, n - 1) if bad == n else (good + bad) // 2
            cost = line_cost(weight, rows[at], cols[at], rows[j], cols[j])
            if 0.0 <= cost <= spent[j] - spent[at] + slack:
                good, step = j, 2 * step
            else:
                bad = j
        corners[count] = good
        count += 1
        at = good
    return corners[:count]


def kept_off(wall: Flags, path: Ints32, corners: Ints32, ends: tuple[Point, Point], most: float) -> list[int]:
    """Return which cells of a path a line bends at so that it stays away from obstacles.

    Between two corners that a straight line joins too closely, the path is halved until it does not; its single steps
    never come too close. Too close is nearer than `most`, and nearer than the start or goal that the line begins or
    ends at.

    Args:
        wall: True where a cell is occupied, padded, (rows + 2, cols + 2).
        path: cells whose centres keep the distance, indices in the flattened array, (n,).
        corners: indices into `path` as `pull` returns them, (k,).
        ends: exact start and goal, row and column in padded cells.
        most: distance to keep, in cells.

    Returns:
        Indices into `path` of the cells between start and goal whose centres are corners.
    """
    n, wide = path.size, wall.shape[1]
    if n == 1:
        return []
    places = [ends[0], *((cell // wide + 0.5, cell % wide + 0.5) for cell in path.tolist()), ends[1]]
    need = {0: gap(wall, [ends[0]], most), n + 1: gap(wall, [ends[1]], most)}
    ahead = [n + 1, *(int(corner) + 1 for corner in corners[-2:0:-1])]  # the next one is the last
    at, kept = 0, []
    while ahead:
        to = ahead[-1]
        least = min(most, need.get(at, most), need.get(to, most)) - 1e-9
        if to - at > 1 and gap(wall, [places[at], places[to]], least) < least:
            ahead.append((at + to) // 2)
            continue
        at = ahead.pop()
        kept.append(at - 1)
    return kept[:-1]
