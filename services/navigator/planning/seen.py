"""Local map of obstacles that a ranger detects and the static map does not hold; they expire.

An echo at r m in a cone is explained if the map, or a mark, has an obstacle in the cone no farther than r and a slack.
An echo that is not explained marks the cells of its arc; an empty cone clears the cells in it, and a mark that is not
seen again is forgotten.
"""

import math
from dataclasses import replace

import numpy as np

from surefoot.schemas.hw import Range

from .grid import OCCUPIED, FloorGrid, Point

Pose = tuple[float, float, float]

FARTHEST = 1.0
"""Largest distance of a ranger echo that marks cells, m: the arc of a farther one is wider than a door."""
SLACK = 0.15
"""Difference between echo and mapped distance that counts as agreement, m: half a cell, the trunk's sway, ranger
noise."""
EDGE = 0.1
"""Angle by which the ranger's cone is widened to compare it with the map, rad, for cells at its edge."""
WIDTH = 0.5
"""Length of the arc of cells that a ranger echo marks, m: the object may be narrower than the cone, or wider."""
CLOSE = 0.5
"""Distance of an echo, m, below which marks at the cone's edge do not explain it, as the robot is about to collide."""
MOST = 4096
"""Largest number of cells marked by ranger echoes; the oldest are dropped."""
NEARER = 0.02
"""Distance by which a route may come nearer to a marked cell that the robot is already too near to, m: it may leave."""
AHEAD = 2.0
"""Length of route ahead of the robot that is checked for marked cells, m; farther marks count when they come near."""


def expected_echo(
    grid: FloorGrid, at: Pose, half: tuple[float, float], longest: float, obstacle: int
) -> tuple[float, float]:
    """Return least and largest distance, m, at which the nearest obstacle of a map in a cone may lie; `longest`: none.

    The heading of the cone errs by up to `half[1]`. The least is the distance in the cone wider by that, which contains
    all possible cones, the largest that in the narrower one, which all possible cones contain.

    Args:
        grid: map of obstacles.
        at: x, y (m) and heading (rad) of the ranger, frame map.
        half: half angle of the cone, and error of the heading, rad.
        longest: largest distance that counts, m.
        obstacle: occupancy from which on a cell is an obstacle, 1 to 100.
    """
    (row, col), reach = grid.index(at[0], at[1]), math.ceil(longest / grid.cell)
    rows, cols = grid.shape
    r0, c0, r1, c1 = max(0, row - reach), max(0, col - reach), min(rows, row + reach + 1), min(cols, col + reach + 1)
    if r0 >= r1 or c0 >= c1:
        return longest, longest
    found = np.argwhere(grid.cells[r0:r1, c0:c1] >= obstacle)
    (x, y), heading = grid.aligned(at[0], at[1]), at[2] - grid.yaw
    dx = grid.origin[0] + (found[:, 1] + c0 + 0.5) * grid.cell - x
    dy = grid.origin[1] + (found[:, 0] + r0 + 0.5) * grid.cell - y
    ahead = math.cos(heading) * dx + math.sin(heading) * dy
    away = np.sqrt(dx * dx + dy * dy)
    least, largest = (
        float(np.min(away, where=ahead >= math.cos(min(math.pi, max(0.0, angle))) * away, initial=math.inf))
        for angle in (half[0] + half[1], half[0] - half[1])
    )
    return min(longest, max(0.0, least - 0.5 * grid.cell)), min(longest, max(0.0, largest - 0.5 * grid.cell))


class SeenObstacles:
    """Memory of cells that a ranger saw occupied but the static map has free; marks expire.

    Args:
        grid: static map.
        obstacle: its occupancy from which on a cell is an obstacle, 1 to 100.
        keep: time after which a mark that was not seen again is forgotten, s.
    """

    def __init__(self, grid: FloorGrid, obstacle: int, keep: float) -> None:
        self.grid, self.obstacle, self.keep = grid, obstacle, keep
        self.marks: dict[tuple[int, int], float] = {}
        """Simulated time, s, at which each marked cell (row, column) was last seen occupied."""
        self.version = 0
        """Number that changes whenever the set of marked cells does."""

    def take(self, seen: Range, at: Pose, unsure: tuple[float, float], now: float) -> bool:
        """Update the marked cells with one reading of the ranger; return True if its echo is of nothing in the map.

        Args:
            seen: the reading.
            at: x, y (m) and heading (rad) of the ranger, frame map.
            unsure: standard deviations of that place, m, and heading, rad.
            now: simulated time, s.
        """
        before, unknown = set(self.marks), False
        for cell in [cell for cell, time in self.marks.items() if now - time > self.keep]:
            del self.marks[cell]
        half, distance = 0.5 * seen.field_of_view, seen.distance
        for cell in self._inside(at, half, min(seen.longest if distance is None else distance, FARTHEST) - SLACK):
            del self.marks[cell]
        if distance is not None and distance <= FARTHEST:
            slack, wider = SLACK + 2.0 * unsure[0], half + EDGE + 2.0 * unsure[1]
            known = expected_echo(self.grid, at, (wider, 0.0), distance + slack + 0.1, self.obstacle)[0]
            unknown = known > distance + slack
            if unknown and not self._seen_again(at, half, distance, now):
                self._mark(at, min(half, 0.5 * WIDTH / distance), distance, now)
        while len(self.marks) > MOST:
            del self.marks[min(self.marks, key=lambda cell: self.marks[cell])]
        self.version += before != set(self.marks)
        return unknown

    def _seen_again(self, at: Pose, half: float, distance: float, now: float) -> bool:
        """Return True if marked cells explain an echo, and renew the times of these cells.

        Args:
            at: x, y (m) and heading (rad) of the ranger, frame map.
            half: half angle of its cone, rad.
            distance: distance of the echo, m.
            now: simulated time, s.
        """
        again = self._inside(at, half if distance > CLOSE else 0.5 * half, distance + SLACK)  # nearer ones are cleared
        self.marks.update(dict.fromkeys(again, now))
        return bool(again)

    def _mark(self, at: Pose, half: float, distance: float, now: float) -> None:
        """Mark the cells on the arc of an echo that the static map has free.

        Args:
            at: x, y (m) and heading (rad) of the ranger, frame map.
            half: half angle of the arc, rad.
            distance: distance of the echo, m.
            now: simulated time, s.
        """
        grid, reach = self.grid, distance + 0.5 * self.grid.cell
        count = max(3, math.ceil(4.0 * half * reach / grid.cell))
        for angle in np.linspace(at[2] - half, at[2] + half, count).tolist():
            cell = grid.index(at[0] + reach * math.cos(angle), at[1] + reach * math.sin(angle))
            if grid.inside(*cell) and int(grid.cells[cell]) < self.obstacle:
                self.marks[cell] = now

    def _inside(self, at: Pose, half: float, reach: float) -> list[tuple[int, int]]:
        """Return the marked cells (row, column) in the cone of a ranger.

        Args:
            at: x, y (m) and heading (rad) of the ranger, frame map.
            half: half angle of the cone, rad.
            reach: largest distance from the ranger, m.
        """
        found: list[tuple[int, int]] = []
        for cell in self.marks:
            x, y = self.grid.centre(*cell)
            dx, dy = x - at[0], y - at[1]
            away = math.hypot(dx, dy)
            ahead = math.cos(at[2]) * dx + math.sin(at[2]) * dy
            if away < reach and ahead >= math.cos(half) * away:
                found.append(cell)
        return found

    def free(self, here: Point, route: tuple[Point, ...], radius: float) -> bool:
        """Return True if the next 2 m of a route come near no marked cell, or no nearer than the robot is already.

        Args:
            here: where the robot is, x, y in m, frame map.
            route: waypoints from there on, x, y in m, frame map.
            radius: distance that obstacles keep from the route, m.
        """
        if not self.marks:
            return True
        centres = np.array([self.grid.centre(*cell) for cell in self.marks])
        limit = np.minimum(radius, np.hypot(centres[:, 0] - here[0], centres[:, 1] - here[1]) - NEARER)
        left, begin = AHEAD, here
        for end in route:
            length = math.dist(begin, end)
            if length > 0.0:
                ux, uy = (end[0] - begin[0]) / length, (end[1] - begin[1]) / length
                dx, dy = centres[:, 0] - begin[0], centres[:, 1] - begin[1]
                along = np.clip(dx * ux + dy * uy, 0.0, min(length, left))
                if bool((np.hypot(dx - along * ux, dy - along * uy) < limit).any()):
                    return False
            left, begin = left - length, end
            if left <= 0.0:
                break
        return True

    def joined(self) -> FloorGrid:
        """Return a copy of the static map in which marked cells are occupied, too."""
        cells = self.grid.cells.copy()
        for cell in self.marks:
            cells[cell] = OCCUPIED
        return replace(self.grid, cells=cells)
