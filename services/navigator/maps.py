"""Maps of the navigator: obstacles to plan routes around, and landmarks."""

import math

from surefoot.errors import Refusal
from surefoot.geometry.heightmap import HeightMap, HeightMapError
from surefoot.schemas.hw import Range
from surefoot.schemas.navigation import OccupancyGrid
from surefoot.schemas.terrain import HeightMapMessage
from surefoot.schemas.terrain import LandmarkMap as LandmarkMapMessage

from .belief.landmark_files import load as load_landmarks
from .belief.landmarks import FloorLandmarks, LandmarkMapError
from .config import NavigatorConfig
from .planning import map_files, zone_files
from .planning.costs import Clearance, Costs, prepare
from .planning.grid import FloorGrid, GridError, Point, grid_of
from .planning.route import PlannedRoute, RouteError, RouteLimits, plan, plan_out
from .planning.seen import Pose, SeenObstacles
from .planning.zones import KeptOut, Zones
from .policy.settings import Conduct

FARTHEST = 1e4
"""Largest distance of a goal from the origin of the map, m; a farther one is refused."""
DETOUR = 1.0
"""Length, m, by which a way around all marks may be longer than that around sure ones; else the latter is taken."""
NAMED = 5
"""Largest number of keepout zones that a refusal names."""
INSIDE = 0.8
"""Part of the robot's radius within which a marked cell or a keepout zone blocks a route; below 1, as routes pass at
that radius."""


class Maps:
    """Obstacles and landmarks, from files of the configuration or from the bus.

    Args:
        config: names the files, with the radius of the robot, m, and the viewing distance, m.
        conduct: distances of ranger echoes, m, and how long obstacles are remembered, s; None = the defaults.

    Raises:
        Refusal: a map file that cannot be used, or a radius of the robot above 0.35 m.
    """

    def __init__(self, config: NavigatorConfig, conduct: Conduct | None = None) -> None:
        self.config, self.conduct = config, conduct or Conduct()
        self._clearance = Clearance(radius=config.robot_radius, through_unknown=config.through_unknown)
        self._limits = RouteLimits(leg=config.viewing_distance)
        self._filed = None if config.map is None else map_files.load(config.map)
        self._marked = None if config.landmarks is None else load_landmarks(config.landmarks)
        self.zones = Zones()
        """Keepout zones and speed limits, of their own file or of that of the map."""
        if config.zones is not None or config.map is not None:
            self.zones = zone_files.load(config.zones or config.map or "", required=config.zones is not None)
        self.reset()

    def reset(self) -> None:
        """Drop the maps received from the bus, as new ones follow a reset; maps from files stay."""
        self.landmarks: FloorLandmarks | None = self._marked
        self.grid: FloorGrid | None = self._filed
        self._costs: Costs | None = None
        self._kept: KeptOut | None = None
        self._heights: HeightMapMessage | None = None
        self._marks: LandmarkMapMessage | None = None
        self._seen: SeenObstacles | None = None
        self._joined: dict[tuple[bool, bool], tuple[int, Costs]] = {}
        """Version of the local map, and the walking costs of global and local map together, by whether only sure marks
        count and whether zones do; as far as computed."""
        self._daring = False
        """True if the route that the robot walks may lead through marks that are not sure."""

    def take(self, heights: HeightMapMessage | None, marks: LandmarkMapMessage | None) -> list[str]:
        """Use the latched maps of the bus, unless files replace them; return a text for each map that cannot be used.

        `heights`: map of heights, which becomes obstacles; `marks`: landmarks; None = there is none.
        """
        problems: list[str] = []
        if heights is not None and heights is not self._heights and self._filed is None:
            self._heights, self._costs, self._kept, self._joined = heights, None, None, {}
            try:
                self.grid = grid_of(HeightMap.from_wire(heights.model_dump(), heights.data))
            except (HeightMapError, GridError) as error:
                self.grid = None
                problems.append(f"terrain/map refused: {error}")
        if marks is not None and marks is not self._marks and self._marked is None:
            self._marks = marks
            try:
                self.landmarks = FloorLandmarks.from_bytes(
                    marks.data, marks.count, marks.descriptor_length, marks.version, marks.source
                )
            except LandmarkMapError as error:
                self.landmarks = None
                problems.append(f"terrain/landmarks refused: {error.message}")
        return problems

    @property
    def obstacle(self) -> int:
        """Occupancy from which on a cell is an obstacle, 1 to 100."""
        return self._clearance.obstacle

    @property
    def costs(self) -> Costs | None:
        """Costs of walking over the cells of the map, made when first needed; None without a map.

        Cells of keepout zones count as obstacles.

        Raises:
            Refusal: the cells of the map are too small for the distances from obstacles.
        """
        if self._costs is None and self.grid is not None:
            kept = self.kept
            self._costs = prepare(self.grid if kept is None else kept.closed(self.grid), self._clearance)
        return self._costs

    @property
    def kept(self) -> KeptOut | None:
        """Cells of the map that keepout zones touch, found when first needed; None without a map or such zones."""
        if self._kept is None and self.grid is not None and self.zones.keepout:
            self._kept = KeptOut(self.zones, self.grid)
        return self._kept

    def see(self, seen: Range, at: Pose, unsure: tuple[float, float], now: float) -> bool:
        """Enter a reading of the ranger into the local map; return True if its echo is of nothing in the map.

        Args:
            seen: the reading.
            at: x, y (m) and heading (rad) of the ranger, frame map.
            unsure: standard deviations of that place, m, and heading, rad.
            now: simulated time, s.
        """
        if self.grid is None:
            return False
        if self._seen is None or self._seen.grid is not self.grid:
            self._seen = SeenObstacles(self.grid, self._clearance.obstacle, self.conduct.remember)
            self._joined = {}
        return self._seen.take(seen, at, unsure, now)

    def free(self, here: Point, route: tuple[Point, ...]) -> bool:
        """Return True if no obstacle unknown to the map was seen by the ranger on the next 2 m of a route from `here`.

        The way to its next waypoint leads no nearer to a keepout zone than the robot is, or keeps most of its radius.
        here, route: x, y in m, frame map.
        """
        return self._free(here, route, sure=self._daring) and all(self.keeps_out(here, end) for end in route[:1])

    def keeps_out(self, here: Point, end: Point) -> bool:
        """Return True if a straight way comes no nearer to a keepout zone than its begin or most of the robot's radius.

        here, end: x, y in m, frame map.
        """
        return self.kept is None or self.kept.open(here, end, INSIDE * self._clearance.radius)

    def _free(self, here: Point, route: tuple[Point, ...], *, sure: bool) -> bool:
        return self._seen is None or self._seen.free(here, route, INSIDE * self._clearance.radius, sure=sure)

    def enterable(self, here: Point, place: Point) -> bool:
        """Return True if the robot may go straight from `here` to a place near by: x, y in m, frame map."""
        if self.costs is None:
            return True
        row, col = self.costs.grid.index(*place)
        inside = self.costs.grid.inside(row, col) and self.costs.weight[row + 1, col + 1] > 0
        return inside and self._free(here, (place,), sure=False)

    def ways(self, here: Point, places: tuple[Point, ...], field: str = "position") -> tuple[tuple[Point, ...], ...]:
        """Return waypoints to each place around obstacles of map and ranger, or straight lines without a map.

        Args:
            here: where the robot is, x, y in m, frame map.
            places: places to reach one after the other, x, y in m, frame map.
            field: name of the request's field, for the refusal.

        Raises:
            Refusal: a place that cannot be reached: `unreachable`, `blocked`, `outside`, `invalid`; names the field.
        """
        return self._ways(here, places, field, bold=False)[0]

    def follow(self, here: Point, places: tuple[Point, ...], *, bold: bool = False) -> tuple[tuple[Point, ...], ...]:
        """Return waypoints as `ways` does, of the route that the robot walks from now on, which `free` checks.

        Args:
            here: where the robot is, x, y in m, frame map.
            places: places to reach one after the other, x, y in m, frame map.
            bold: True = where all marks close every way, a way around sure ones only is taken.

        Raises:
            Refusal: a place that cannot be reached, as of `ways`.
        """
        self._daring = False
        found, self._daring = self._ways(here, places, "position", bold=bold)
        return found

    def _ways(
        self, here: Point, places: tuple[Point, ...], field: str, *, bold: bool
    ) -> tuple[tuple[tuple[Point, ...], ...], bool]:
        """Return waypoints to each place, and True if one of the ways may lead through marks that are not sure.

        The arguments and the refusal are those of `ways` and `follow`.
        """
        found: list[tuple[Point, ...]] = []
        daring = False
        for i, place in enumerate(places):
            where = field if field == "position" else f"{field}.{i}"
            if math.hypot(*place) > FARTHEST:
                raise Refusal("invalid", f"a goal lies within {FARTHEST:g} m of the origin, got {place}", where)
            begin = places[i - 1] if i > 0 else here
            if self.costs is None and self.zones.keepout:
                raise Refusal("no_map", "keepout zones need a map of the floor to plan on", where)
            if self.costs is None:
                found.append((place,))
            elif i > 0 and math.dist(begin, place) < 1e-6:
                found.append(())  # the same place twice in a row
            else:
                way, sure = self._way(begin, place, (field, where), bold=bold)
                found.append(way)
                daring |= sure
        return tuple(found), daring

    def _way(
        self, begin: Point, place: Point, fields: tuple[str, str], *, bold: bool
    ) -> tuple[tuple[Point, ...], bool]:
        """Return waypoints of the way around all marks, or, with True, around sure ones if the former is much longer.

        Args:
            begin: x, y in m, frame map.
            place: x, y in m, frame map.
            fields: names of the request's fields, for a refusal of `begin` and of the place.
            bold: False = a place that no way around all marks leads to is refused.
        """
        found, refused, daring = None, None, False
        for sure in (False, True) if self._unsure else (False,):
            try:
                way = self._plan(begin, place, sure=sure)
            except RouteError as error:
                refused = refused or error
                if bold:
                    continue
                break
            if found is None or way.length < found.length - DETOUR:
                found, daring = way, sure
        if found is None:
            assert refused is not None
            raise Refusal(refused.code, refused.message, fields[refused.field == "goal"]) from None
        return tuple((float(x), float(y)) for x, y in found.waypoints), daring

    def _plan(self, begin: Point, place: Point, *, sure: bool) -> PlannedRoute:
        """Return the cheapest route around keepout zones, from a begin in one first out of it.

        Args:
            begin: x, y in m, frame map.
            place: x, y in m, frame map.
            sure: True = only marks of the ranger that are sure count.

        Raises:
            RouteError: as `plan`; `keepout`: the place is in a keepout zone, or too close to one; the text names it.
        """
        costs, kept = self._costs_now(sure=sure), self.kept
        if kept is None:
            return plan(costs, begin, place, self._limits)
        try:
            if kept.name_at(begin):
                return plan_out(costs, self._costs_now(sure=sure, zones=False), begin, place, self._limits)
            return plan(costs, begin, place, self._limits)
        except RouteError as error:
            name, apart = kept.nearest(place)
            if error.code == "unreachable":
                text = f"{error.message}; it keeps out of {', '.join(kept.names[:NAMED])}"
                raise RouteError("unreachable", text, error.field or "goal", error.nearest) from None
            if error.code != "blocked" or error.field != "goal" or apart > self._clearance.radius:
                raise
            where = "in" if kept.name_at(place) else "too close to"
            near = error.nearest
            hint = "" if near is None else f"; the nearest place that is free is ({near[0]:.3f}, {near[1]:.3f})"
            text = f"goal ({place[0]:.3f}, {place[1]:.3f}) is {where} the keepout zone {name!r}{hint}"
            raise RouteError("keepout", text, "goal", near) from None

    @property
    def _unsure(self) -> bool:
        """True if the local map has marks that are not sure."""
        seen = self._seen
        return seen is not None and seen.grid is self.grid and len(seen.marks) > len(seen.sure)

    def _costs_now(self, *, sure: bool, zones: bool = True) -> Costs:
        """Return the costs of walking over the map with the obstacles that only the ranger saw.

        `sure`: only those that are sure; `zones`: keepout zones count as obstacles.
        """
        seen, costs, grid = self._seen, self.costs, self.grid
        assert costs is not None
        assert grid is not None
        marked = seen is not None and seen.grid is grid and bool(seen.sure if sure else seen.marks)
        if not marked and (zones or self.kept is None):
            return costs
        version = seen.version if seen is not None and marked else -1
        known = self._joined.get((sure, zones))
        if known is None or known[0] != version:
            grid = seen.joined(sure=sure) if seen is not None and marked else grid
            grid = self.kept.closed(grid) if zones and self.kept is not None else grid
            known = (version, prepare(grid, self._clearance, lasting=False))
            self._joined[sure, zones] = known
        return known[1]

    def refuse_blocked(self, place: Point, field: str) -> None:
        """Raise a refusal if a place, x, y in m, frame map, is outside the map or in an obstacle.

        Raises:
            Refusal: `outside` or `blocked`; names `field`.
        """
        grid = self.grid
        if grid is None:
            return
        row, col = grid.index(*place)
        if not grid.inside(row, col):
            raise Refusal("outside", f"{place} is outside of the map, {grid.bounds} (x, y from and to, m)", field)
        if int(grid.cells[row, col]) >= self._clearance.obstacle:
            raise Refusal("blocked", f"{place} is in an obstacle of the map", field)

    def message(self) -> OccupancyGrid:
        """Return the occupancy grid of the floor as a message; without a map it has no cells."""
        grid = self.grid
        if grid is None:
            return OccupancyGrid(rows=0, cols=0, cell=0.05, origin=(0.0, 0.0))
        rows, cols = grid.shape
        return OccupancyGrid(
            rows=rows,
            cols=cols,
            cell=grid.cell,
            origin=grid.origin,
            yaw=grid.yaw,
            source=grid.source,
            data=grid.to_bytes(),
        )
