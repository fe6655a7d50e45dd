"""Local map of obstacles that a ranger detects and the static map does not hold; they expire.

An echo at r m in a cone is explained if the map, or a mark, has an obstacle in the cone no farther than r and a slack.
An echo that is not explained states that something is somewhere on its arc: it marks the cells of the arc but for
those that other readings showed free a short while before. The marks are sure where they are few, or near; else the way
may lead through them. A cone clears the cells that are nearer than its echo, and a mark that is not seen again is
forgotten.
"""

import math
from collections import deque
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
NARROW = 0.3
"""Largest distance between marks that explain an echo, m, at which they are sure: something is there, about as wide."""
NEAR = 0.4
"""Distance of an echo, m, up to which its marks are sure however many they are: the robot comes no nearer."""
FRESH = 10.0
"""Time, s, for which a place that a reading showed free counts as free when an echo is marked."""
SETTLED = 0.5
"""Least age, s, of a reading by which an echo shows that something has come: the cone of a robot that turns is then at
another angle."""
STEP, SWAY = 0.03, 0.02
"""Distance, m, and angle, rad, up to which two readings are from the same pose."""
VIEWS = 256
"""Largest number of readings whose free space is kept, evenly in time."""
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
        self.sure: set[tuple[int, int]] = set()
        """Marked cells that alone explain an echo, or are near to one; of the others only one of many is occupied."""
        self.version = 0
        """Number that changes whenever the set of marked cells, or that of sure ones, does."""
        self._views: deque[tuple[Pose, float, float, float]] = deque(maxlen=VIEWS)
        """Recent readings: pose, half angle of the cone, rad, distance up to which it is free, m, simulated time, s."""

    def take(self, seen: Range, at: Pose, unsure: tuple[float, float], now: float) -> bool:
        """Update the marked cells with one reading of the ranger; return True if its echo is of nothing in the map.

        Args:
            seen: the reading.
            at: x, y (m) and heading (rad) of the ranger, frame map.
            unsure: standard deviations of that place, m, and heading, rad.
            now: simulated time, s.
        """
        before, unknown = (set(self.marks), set(self.sure)), False
        for cell in [cell for cell, time in self.marks.items() if now - time > self.keep]:
            del self.marks[cell]
        half, distance = 0.5 * seen.field_of_view, seen.distance
        empty = min(seen.longest if distance is None else distance, FARTHEST) - SLACK
        for cell in self._inside(at, half, empty):
            del self.marks[cell]
        if distance is not None and distance <= FARTHEST:
            slack, wider = SLACK + 2.0 * unsure[0], half + EDGE + 2.0 * unsure[1]
            known = expected_echo(self.grid, at, (wider, 0.0), distance + slack + 0.1, self.obstacle)[0]
            unknown = known > distance + slack
            if unknown:
                self._echo(at, half, distance, now)
        while self._views and now - self._views[0][3] > FRESH:
            self._views.popleft()
        if not self._views or now - self._views[-1][3] >= FRESH / VIEWS:
            self._views.append((at, half, empty, now))
        while len(self.marks) > MOST:
            del self.marks[min(self.marks, key=lambda cell: self.marks[cell])]
        self.sure &= self.marks.keys()
        self.version += before != (set(self.marks), self.sure)
        return unknown

    def _echo(self, at: Pose, half: float, distance: float, now: float) -> None:
        """Renew the marks that explain an echo, or mark where its object may be, and note which of these are sure.

        Args:
            at: x, y (m) and heading (rad) of the ranger, frame map.
            half: half angle of its cone, rad.
            distance: distance of the echo, m.
            now: simulated time, s.
        """
        cells = self._inside(at, half if distance > CLOSE else 0.5 * half, distance + SLACK)  # nearer ones are cleared
        few = self._extent(cells) <= NARROW
        if not cells:
            middle = self._arc(at, min(half, 0.5 * WIDTH / distance), distance)
            arc = self._unseen(self._arc(at, half, distance), at, distance, now)
            few = self._extent(arc) <= NARROW
            left = set(arc)
            cells = [cell for cell in middle if cell in left] or arc or middle
        self.marks.update(dict.fromkeys(cells, now))
        if few or distance <= NEAR:
            self.sure.update(cells)

    def _extent(self, cells: list[tuple[int, int]]) -> float:
        """Return the diagonal of the rectangle about the centres of cells (row, column), m; infinite without any."""
        if not cells:
            return math.inf
        rows, cols = zip(*cells, strict=True)
        return self.grid.cell * math.hypot(max(rows) - min(rows), max(cols) - min(cols))

    def _arc(self, at: Pose, half: float, distance: float) -> list[tuple[int, int]]:
        """Return the cells (row, column) on the arc of an echo that the static map has free, each once.

        Args:
            at: x, y (m) and heading (rad) of the ranger, frame map.
            half: half angle of the arc, rad.
            distance: distance of the echo, m.
        """
        grid, reach = self.grid, distance + 0.5 * self.grid.cell
        count = max(3, math.ceil(4.0 * half * reach / grid.cell))
        angles = np.linspace(at[2] - half, at[2] + half, count).tolist()
        cells = [grid.index(at[0] + reach * math.cos(angle), at[1] + reach * math.sin(angle)) for angle in angles]
        free = [cell for cell in cells if grid.inside(*cell) and int(grid.cells[cell]) < self.obstacle]
        return list(dict.fromkeys(free))

    def _unseen(self, cells: list[tuple[int, int]], at: Pose, distance: float, now: float) -> list[tuple[int, int]]:
        """Return the cells (row, column) of an arc that no recent reading showed free, none where something has come.

        Something has come if a reading from the same pose showed nothing as near a while before, or if no cell is left.
        The readings that showed one of the cells free are forgotten then.

        Args:
            cells: those of the arc.
            at: x, y (m) and heading (rad) of the ranger, frame map.
            distance: distance of the echo, m.
            now: simulated time, s.
        """
        if not self._views or not cells:
            return cells
        cones = [
            (*view[:2], math.cos(view[2]), math.sin(view[2]), math.cos(half), empty, time)
            for view, half, empty, time in self._views
        ]
        x, y, c, s, edge, empty, time = np.array(cones).T
        dx, dy = (np.array([self.grid.centre(*cell) for cell in cells])[:, :, None] - (x, y)).transpose(1, 0, 2)
        away = np.sqrt(dx * dx + dy * dy)
        free = (away < empty) & (c * dx + s * dy >= edge * away)  # (cells, readings)
        same = (np.square(x - at[0]) + np.square(y - at[1]) <= STEP**2) & (now - time >= SETTLED)
        same &= c * math.cos(at[2]) + s * math.sin(at[2]) >= math.cos(SWAY)
        if (same & (empty > distance)).any() or free.any(axis=1).all():
            views = zip(self._views, free.any(axis=0).tolist(), strict=True)
            self._views = deque((view for view, old in views if not old), VIEWS)
            return []
        return [cell for cell, shown in zip(cells, free.any(axis=1).tolist(), strict=True) if not shown]

    def _inside(self, at: Pose, half: float, reach: float) -> list[tuple[int, int]]:
        """Return the marked cells (row, column) in the cone of a ranger.

        Args:
            at: x, y (m) and heading (rad) of the ranger, frame map.
            half: half angle of the cone, rad.
            reach: largest distance from the ranger, m.
        """
        return [cell for cell in self.marks if _in_cone(*self.grid.centre(*cell), at, half, reach)]

    def free(self, here: Point, route: tuple[Point, ...], radius: float, *, sure: bool = False) -> bool:
        """Return True if the next 2 m of a route come near no marked cell, or no nearer than the robot is already.

        Args:
            here: where the robot is, x, y in m, frame map.
            route: waypoints from there on, x, y in m, frame map.
            radius: distance that obstacles keep from the route, m.
            sure: True = only marks that are sure count.
        """
        cells = self.sure if sure else self.marks
        if not cells:
            return True
        centres = np.array([self.grid.centre(*cell) for cell in cells])
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

    def joined(self, *, sure: bool = False) -> FloorGrid:
        """Return a copy of the static map in which marked cells are occupied, too; with `sure` only those that are."""
        cells = self.grid.cells.copy()
        for cell in self.sure if sure else self.marks:
            cells[cell] = OCCUPIED
        return replace(self.grid, cells=cells)


def _in_cone(x: float, y: float, at: Pose, half: float, reach: float) -> bool:
    """Return True if a place lies in a cone.

    Args:
        x: first coordinate of the place, m, frame map.
        y: second coordinate of the place, m, frame map.
        at: x, y (m) and heading (rad) of the ranger, frame map.
        half: half angle of its cone, rad.
        reach: largest distance from the ranger, m.
    """
    dx, dy = x - at[0], y - at[1]
    away = math.hypot(dx, dy)
    return away < reach and math.cos(at[2]) * dx + math.sin(at[2]) * dy >= math.cos(half) * away
