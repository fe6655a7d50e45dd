"""What the navigator knows of the world: obstacles to plan routes around, and landmarks."""

import math

from surefoot.errors import Refusal
from surefoot.schemas.navigation import OccupancyGrid
from surefoot.schemas.terrain import HeightMapMessage
from surefoot.schemas.terrain import LandmarkMap as LandmarkMapMessage
from surefoot.services.navigator.belief.landmarks import LandmarkMap, LandmarkMapError
from surefoot.services.navigator.config import NavigatorConfig

Point = tuple[float, float]

FARTHEST = 1e4
"""m, of a goal from the origin."""


class World:
    """Maps, from files of the configuration or from the bus.

    Args:
        config: of the service.
    """

    def __init__(self, config: NavigatorConfig) -> None:
        self.config = config
        self.reset()

    def reset(self) -> None:
        """Forget what came from the bus: a new epoch brings its own."""
        self.landmarks: LandmarkMap | None = None
        self._heights: HeightMapMessage | None = None
        self._marks: LandmarkMapMessage | None = None

    def take(self, heights: HeightMapMessage | None, marks: LandmarkMapMessage | None) -> list[str]:
        """Take in the latched maps; returns what is wrong with them."""
        problems: list[str] = []
        if heights is not None and heights is not self._heights:
            self._heights = heights
        if marks is not None and marks is not self._marks:
            self._marks = marks
            try:
                self.landmarks = LandmarkMap.from_bytes(
                    marks.data, marks.count, marks.descriptor_length, marks.version, marks.source
                )
            except LandmarkMapError as error:
                self.landmarks = None
                problems.append(f"terrain/landmarks refused: {error.message}")
        return problems

    def route(self, here: Point, places: tuple[Point, ...], field: str) -> tuple[Point, ...]:
        """Return the waypoints from a place over the wanted ones.

        Raises:
            Refusal: a place that cannot be reached; names the field.
        """
        for i, place in enumerate(places):
            where = field if field == "position" else f"{field}.{i}"
            if math.hypot(*place) > FARTHEST:
                raise Refusal("invalid", f"a goal lies within {FARTHEST:g} m of the origin, got {place}", where)
            self.refuse_blocked(place, where)
        return places

    def refuse_blocked(self, place: Point, field: str) -> None:
        """Raise a refusal if there is an obstacle at a place."""

    def message(self) -> OccupancyGrid:
        """Return the occupancy grid; without a map it has no cells."""
        return OccupancyGrid(rows=0, cols=0, cell=0.05, origin=(0.0, 0.0))
