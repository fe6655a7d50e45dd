"""The ground of the last terrain map, prepared once and updated where a new map differs."""

from base64 import b64decode

import numpy as np

from surefoot.errors import Refusal
from surefoot.geometry.heightmap import HeightMap, HeightMapError
from surefoot.schemas.terrain import ElevationMap, HeightMapMessage

from .ground import FootholdGround, build_ground, updated_ground


class LatchedGround:
    """Terrain map that was received last, prepared for the choice of footholds.

    Args:
        key: topic that the maps come on, which a refusal names.
        foot_radius: radius of the robot's foot spheres, m.
        smooth: 3 x 3 median over the heights.
        unsure: deviation of a height, m, above which a cell of a map with variances counts as unknown.

    Attributes:
        ground: the prepared map; None without a map.
    """

    def __init__(self, key: str, foot_radius: float, smooth: bool, unsure: float) -> None:
        self._key, self._foot_radius, self._smooth, self._unsure = key, foot_radius, smooth, unsure
        self.forget()

    def forget(self) -> None:
        """Drop the map of the ground."""
        self.ground: FootholdGround | None = None
        self._heights: HeightMap | None = None
        self._message: HeightMapMessage | ElevationMap | None = None

    def take(self, message: HeightMapMessage | ElevationMap | None) -> bool:
        """Prepare the ground of a new map and return True; return False for None or the map that is prepared already.

        Raises:
            HeightMapError: the message holds no map; then there is no ground.
        """
        if message is None or message is self._message:
            return False
        before, heights = self.ground, self._heights
        self.forget()
        self._message = message
        if isinstance(message, ElevationMap):
            self.ground = self._measured(message)
            return True
        self._heights = HeightMap.from_wire(message.model_dump(), message.data)
        if before is not None and heights is not None:
            self.ground = updated_ground(before, heights, self._heights)
        else:
            self.ground = build_ground(self._heights, self._foot_radius, self._smooth)
        return True

    def _measured(self, message: ElevationMap) -> FootholdGround | None:
        """Return the ground of a map with variances; too uncertain cells count as not seen; None: all cells are.

        Raises:
            HeightMapError: the message holds no map, or impossible variances.
        """
        heights = HeightMap.from_base64(message.model_dump(), message.heights)
        try:
            data = b64decode(message.variances, validate=True)
            variance = np.frombuffer(data, dtype="<f4").reshape(heights.shape)
        except ValueError as error:
            raise HeightMapError("variances", f"must be as many float32 as heights: {error}") from None
        sure = variance <= self._unsure**2
        if (variance < 0.0).any():
            raise HeightMapError("variances", f"must be >= 0 m^2, got {float(np.nanmin(variance)):g}")
        if not sure.any():
            return None
        heights = heights.with_z(np.where(sure, heights.z, np.float32(np.nan)))
        return build_ground(heights, self._foot_radius, self._smooth, np.where(sure, variance, np.float32(np.nan)))

    def known(self) -> FootholdGround:
        """Return the prepared map.

        Raises:
            Refusal: there is none (`not_ready`).
        """
        if self.ground is None:
            raise Refusal("not_ready", f"no usable map has come on {self._key} yet")
        return self.ground
