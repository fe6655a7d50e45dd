"""Messages of the terrain map and the landmark map, whose heights and places travel as float32 numbers."""

from pydantic import Field

from .base import Bulk, Message, Request, Vec2


class HeightMapMessage(Bulk):
    """Heights of the ground, float32 little-endian, C order ``z[row = y, col = x]``, row 0 = y-min, NaN = unknown."""

    rows: int = Field(gt=0, le=4096, description="cells along y")
    cols: int = Field(gt=0, le=4096, description="cells along x")
    cell: float = Field(gt=0, description="edge of a cell, m")
    origin: Vec2 = Field(description="x, y of the CENTRE of cell [0, 0], m")
    frame: str = Field(default="map", description="frame of origin and heights")
    version: int = Field(default=0, ge=0, description="changes whenever the heights change")
    kind: str = Field(default="", description="how the terrain was made")
    profile: str = Field(default="exact", description="exact, noise or shifted: how far the map is from the ground")

    def data_bytes(self) -> int:
        """Return the length of the raw heights by the other fields of the message, bytes."""
        return 4 * self.rows * self.cols


class ElevationMap(Message):
    """Heights of the ground about the robot, measured while it walks; float32 little-endian ``z[row = y, col = x]``.

    Grid and frame as in `HeightMapMessage`. The variance is that of a height relative to the robot now: it grows with
    the drift of the odometry since the cell was seen.
    """

    rows: int = Field(gt=0, le=512, description="cells along y")
    cols: int = Field(gt=0, le=512, description="cells along x")
    cell: float = Field(gt=0, description="edge of a cell, m")
    origin: Vec2 = Field(description="x, y of the CENTRE of cell [0, 0], m")
    frame: str = Field(default="map", description="frame of origin and heights: that of the odometry")
    version: int = Field(default=0, ge=0, description="number of images in it")
    heights: str = Field(repr=False, description="base64 of the heights, m; NaN = not seen")
    variances: str = Field(repr=False, description="base64 of their variances, m^2; NaN where the height is")
    refused: dict[str, int] = Field(default_factory=dict, description="images and single depths refused, by reason")


class MapRequest(Request):
    """Asks for a map that was published once and stays valid (latched); the reply is that message."""


class LandmarkMap(Bulk):
    """Landmarks on the floor, float32 little-endian, one row each: x, y in m, frame map, then the descriptor."""

    count: int = Field(ge=0, le=100_000, description="landmarks")
    descriptor_length: int = Field(ge=0, le=256, description="numbers in a descriptor")
    frame: str = Field(default="map", description="frame of the positions")
    version: int = Field(default=0, ge=0, description="changes whenever the landmarks change")
    source: str = Field(default="", description="how the map was made")

    def data_bytes(self) -> int:
        """Return the length of the raw landmarks by the other fields of the message, bytes."""
        return 4 * self.count * (2 + self.descriptor_length)
