"""Estimate of a robot's pose on a map from landmarks, and planning of routes on the map.

    belief = navigation.PoseFilter((0.0, 0.0, 0.0))
    belief.predict(forward=0.1, turn=0.02, sd=(0.01, 0.01, 0.02))
    belief.landmark(place=(1.0, 0.5), distance=1.02, bearing=0.45)
    route = navigation.plan(navigation.grid(heights), start=(0.0, 0.0), goal=(3.0, 1.0))

Poses are x, y in m and heading in rad, frame map.
"""

import math
from collections.abc import Sequence
from dataclasses import replace
from os import PathLike

import numpy as np
from numpy.typing import ArrayLike

from surefoot.arguments import array, file_path, instance, number, shape_of
from surefoot.arrays import Array
from surefoot.errors import FieldError
from surefoot.geometry.heightmap import HeightMap
from surefoot.services.navigator.belief import ukf
from surefoot.services.navigator.planning.costs import WIDEST, Clearance, prepare
from surefoot.services.navigator.planning.grid import LARGEST_CELL, MOST_TURNED, FloorGrid, grid_of
from surefoot.services.navigator.planning.map_files import load
from surefoot.services.navigator.planning.route import PlannedRoute, RouteError, RouteLimits
from surefoot.services.navigator.planning.route import plan as plan_route

__all__ = ["Clearance", "FloorGrid", "PlannedRoute", "PoseFilter", "grid", "plan"]

FAR = 1e5
"""Largest absolute coordinate, and largest distance of a landmark, m; larger ones are refused."""
LONGEST_MOTION = 100.0
"""Largest motion of one prediction, m; a longer one is refused, as probably in millimetres."""
BESIDE = 0.2
"""Distance to an obstacle beyond the robot's radius, m, below which a route costs more."""
FINEST = 1e-3
"""Smallest edge of a cell on which routes are planned, m; a grid of smaller ones is refused."""
WIDEST_TURN = 6.3
"""Largest absolute angle, rad; a larger one is refused, as probably in degrees."""


class PoseFilter:
    """Unscented Kalman filter of a planar pose, fed with motions and with range and bearing of landmarks.

    Args:
        pose: first estimate of the pose, x and y in m and heading in rad, frame map, (3,).
        covariance: its covariance, (3, 3) in m and rad; None = 5 cm and 5 degrees.

    Raises:
        FieldError: shape, NaN, range, a covariance that is not symmetric and positive.
    """

    def __init__(self, pose: ArrayLike = (0.0, 0.0, 0.0), covariance: ArrayLike | None = None) -> None:
        self._mean, self._cov = _pose(pose), np.diag([0.05**2, 0.05**2, np.radians(5.0) ** 2])
        if covariance is not None:
            self._cov = _covariance(covariance)
        self._work, self._gain = ukf.work_space(3), np.zeros((2, 0))

    @property
    def pose(self) -> Array:
        """Estimated pose, x and y in m and heading in rad, frame map, (3,)."""
        return self._mean.copy()

    @property
    def covariance(self) -> Array:
        """Covariance of the pose x, y, heading, (3, 3), in m and rad, frame map."""
        return self._cov.copy()

    @property
    def entropy(self) -> float:
        """Differential entropy of the estimated pose (x, y in m, heading in rad), nats."""
        return float(ukf.entropy(self._cov))

    def predict(
        self, forward: float = 0.0, left: float = 0.0, turn: float = 0.0, sd: ArrayLike = (0.0, 0.0, 0.0)
    ) -> None:
        """Predict pose and covariance after a motion of the robot.

        The turn is spread evenly over the motion, and so is its error. To first order the end of the path is therefore
        off sideways by distance times half the error of the turn, which correlates place and heading.

        Args:
            forward: distance along the heading half-way through the turn, m.
            left: distance to the left of that heading, m.
            turn: change of heading, rad, left positive.
            sd: standard deviations of forward and left, m, and turn, rad, (3,).

        Raises:
            FieldError: NaN or out of range; pose and covariance stay as they were.
        """
        ahead = number(forward, "forward", "m", low=-LONGEST_MOTION, high=LONGEST_MOTION)
        side = number(left, "left", "m", low=-LONGEST_MOTION, high=LONGEST_MOTION)
        angle = number(turn, "turn", "rad", low=-WIDEST_TURN, high=WIDEST_TURN)
        noise = array(sd, "sd", (3,), "m, m, rad", low=0.0, high=LONGEST_MOTION)
        half = float(self._mean[2]) + 0.5 * angle
        ukf.predict(self._mean, self._cov, ahead, side, angle, 0.0, np.append(noise * noise, 0.0), self._work)
        c, s = 0.5 * math.cos(half), 0.5 * math.sin(half)
        moves = np.array([-ahead * s - side * c, ahead * c - side * s, 0.0])  # m of x and y per rad of the turn
        one = noise[2] * noise[2] * moves
        self._cov += np.multiply.outer(one, moves)
        self._cov[2] += one
        self._cov[:, 2] += one

    def landmark(self, place: ArrayLike, distance: float, bearing: float, sd: ArrayLike = (0.05, 0.026)) -> float:
        """Correct the pose by a measured landmark, and return the normalised innovation squared (2 degrees of freedom).

        Args:
            place: place of the landmark, (2,) m, frame map.
            distance: measured distance, m.
            bearing: measured angle, rad, left of the heading positive.
            sd: standard deviations of distance, m, and bearing, rad, (2,), above 0.

        Raises:
            FieldError: NaN or out of range; pose and covariance stay as they were.
        """
        x, y = array(place, "place", (2,), "m", low=-FAR, high=FAR).tolist()
        seen = number(distance, "distance", "m", low=0.0, high=FAR)
        angle = number(bearing, "bearing", "rad", low=-WIDEST_TURN, high=WIDEST_TURN)
        r, a = array(sd, "sd", (2,), "m, rad", low=1e-9, high=LONGEST_MOTION).tolist()
        sighting = ukf.LandmarkSighting(x, y, seen, angle, r * r, a * a)
        return float(ukf.update(self._mean, self._cov, sighting, self._gain, self._work))


def grid(
    source: HeightMap | ArrayLike | str | PathLike[str], cell: float = 0.05, origin: Sequence[float] = (0.0, 0.0)
) -> FloorGrid:
    """Return an occupancy grid of the floor, for `plan`.

    Args:
        source: a height map (ground over or under the floor is occupied), occupancy (ny, nx) of -1 = unknown and 0 to
            100, or the YAML file of a map of `map_server`.
        cell: edge of a cell of an array, m.
        origin: lower left corner of an array, frame map, (2,) m; with a third number the angle, rad, left positive, by
            which its rows are turned about that corner.

    Raises:
        SurefootError: `source` is none of these, or its cells are smaller than 1 mm or larger than 10 m.
    """
    if isinstance(source, HeightMap):
        return _fine(grid_of(source), "source.cell")
    if isinstance(source, str | PathLike):
        return _fine(load(file_path(source, "source")), "source.cell")
    cells = array(source, "source", ("ny", "nx"), low=-1.0, high=100.0)
    if not np.array_equal(cells, np.rint(cells)) or cells.max(initial=0.0) == 1.0:
        most = f"got values up to {cells.max():g}"
        raise FieldError("range", "source", f"{most}, expected -1 = unknown and whole percents, 100 = occupied")
    turned = shape_of(origin) == (3,)
    x, y = array(origin[:2] if turned else origin, "origin", (2,), "m", low=-FAR, high=FAR).tolist()
    yaw = number(origin[2], "origin", "rad", low=-MOST_TURNED, high=MOST_TURNED) if turned else 0.0
    edge = number(cell, "cell", "m", low=FINEST, high=LARGEST_CELL)
    return FloorGrid(cells.astype(np.int8), edge, (x, y), yaw=yaw)


def plan(
    floor: FloorGrid, start: Sequence[float], goal: Sequence[float], *, radius: float = 0.15, leg: float = 1.0
) -> PlannedRoute:
    """Return the cheapest route between two points: `waypoints` (n, 2) m, `length` m, `clearance` m.

    `clearance` is the exact least distance of the route, from its start on, from the squares of occupied or unknown
    cells and from the edge of the grid, at most `radius` + 0.2 m. It is less than `radius` in two cases: the start or
    the goal itself is closer than that; or the only way passes a corner, closer than `radius` by up to 0.21 cells. Ways
    are searched over centres of cells, so a door whose middle lies between two centres must be one cell wider.

    Args:
        floor: result of `grid`; cells of 1 mm to 10 m.
        start: start of the route, x and y, (2,) m, frame map.
        goal: end of the route, x and y, (2,) m, frame map.
        radius: radius of the robot, m.
        leg: largest distance of two waypoints, m.

    Raises:
        SurefootError: a point is blocked or outside, or no way leads there; names the nearest free place, of a goal the
            nearest that can be reached.
    """
    instance(floor, "floor", FloorGrid, "the result of `navigation.grid`")
    _fine(floor, "floor.cell")
    (x0, y0), (x1, y1) = array(start, "start", (2,), "m").tolist(), array(goal, "goal", (2,), "m").tolist()
    keep = number(radius, "radius", "m", low=0.0, high=max(0.0, (WIDEST - 1) * floor.cell - BESIDE))
    limits = RouteLimits(leg=number(leg, "leg", "m", low=1e-3, high=1e3))
    near = Clearance(radius=keep, comfort=keep + BESIDE)
    costs = prepare(floor, replace(near, exact=True), lasting=False)
    try:
        route = plan_route(costs, (x0, y0), (x1, y1), limits)
    except RouteError:
        route = plan_route(prepare(floor, near, lasting=False), (x0, y0), (x1, y1), limits)
    return replace(route, clearance=costs.clearance_along(np.vstack((route.start, route.waypoints))))


def _fine(floor: FloorGrid, field: str) -> FloorGrid:
    """Return a grid after a check that routes can be planned on cells of its size (raises FieldError)."""
    number(floor.cell, field, "m", low=FINEST, high=LARGEST_CELL)
    return floor


def _pose(pose: ArrayLike) -> Array:
    found = array(pose, "pose", (3,), "m, m, rad", low=-FAR, high=FAR)
    number(found[2], "pose", "rad of heading", low=-WIDEST_TURN, high=WIDEST_TURN)
    found[2] = ukf.wrap(found[2])
    return found


def _covariance(covariance: ArrayLike) -> Array:
    found = array(covariance, "covariance", (3, 3), "m and rad, squared")
    (a, b, c), (_, d, e), (_, _, f) = found.tolist()
    whole = a * (d * f - e * e) - b * (b * f - c * e) + c * (b * e - c * d)
    least = min(a, d, f, a * d - b * b, a * f - c * c, d * f - e * e, whole)  # of the principal minors
    if not np.allclose(found, found.T, rtol=1e-9, atol=1e-12) or least < -1e-12:
        raise FieldError("covariance", "covariance", f"got {found.tolist()}, expected symmetric and not negative")
    return found
