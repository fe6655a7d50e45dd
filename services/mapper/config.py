"""Configuration of the mapper."""

from pydantic import Field

from surefoot.lockstep.config import ServiceConfig

from .mapper import MapParams

_PARAMS = MapParams()


class MapperConfig(ServiceConfig):
    """Settings of the mapper: size of the map, and limits of the depths and images that it uses."""

    cell_m: float = Field(default=_PARAMS.cell, ge=0.002, le=0.1, description="edge of a cell, m")
    cells: int = Field(default=_PARAMS.cells, ge=3, le=301, description="cells along an edge of the map")
    farthest_m: float = Field(default=_PARAMS.farthest, gt=0, le=20, description="largest depth that is used, m")
    late_s: float = Field(default=_PARAMS.late_s, gt=0, le=0.5, description="largest age of an image that is used, s")
    start_deviation_m: float = Field(
        default=_PARAMS.start_deviation, gt=0, le=1, description="deviation of the unseen ground at the start, m"
    )
    start_margin_m: float = Field(
        default=_PARAMS.start_margin, ge=0, le=1, description="way by which that ground goes beyond the feet, m"
    )

    def params(self) -> MapParams:
        """Return the parameters of the elevation map that this configuration states."""
        return MapParams(
            self.cell_m, self.cells, self.farthest_m, self.late_s, self.start_deviation_m, self.start_margin_m
        )
