"""The ground of the last terrain map, prepared once and updated where a new map differs."""

from surefoot.errors import Refusal
from surefoot.geometry.heightmap import HeightMap
from surefoot.schemas.terrain import HeightMapMessage

from .ground import FootholdGround, build_ground, updated_ground


class LatchedGround:
    """Ground of the last map.

    Args:
        foot_radius: of the robot, m.
        smooth: as in the configuration.

    Attributes:
        ground: None without a map.
    """

    def __init__(self, foot_radius: float, smooth: bool) -> None:
        self._foot_radius, self._smooth = foot_radius, smooth
        self.forget()

    def forget(self) -> None:
        """Drop the map."""
        self.ground: FootholdGround | None = None
        self._heights: HeightMap | None = None
        self._message: HeightMapMessage | None = None

    def take(self, message: HeightMapMessage | None) -> bool:
        """Prepare the ground of a map and return True; False: it is the same as before, or none.

        Raises:
            HeightMapError: it is no map; then there is no ground.
        """
        if message is None or message is self._message:
            return False
        before, heights = self.ground, self._heights
        self.forget()
        self._message = message
        self._heights = HeightMap.from_wire(message.model_dump(), message.data)
        if before is not None and heights is not None:
            self.ground = updated_ground(before, heights, self._heights)
        else:
            self.ground = build_ground(self._heights, self._foot_radius, self._smooth)
        return True

    def known(self) -> FootholdGround:
        """Return the ground (raises Refusal `not_ready`: there is none)."""
        if self.ground is None:
            raise Refusal("not_ready", "no terrain map has come yet")
        return self.ground
