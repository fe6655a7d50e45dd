"""The terrain map as the foothold functions look at it: prepared once per map version."""

from dataclasses import dataclass

from surefoot.geometry.heightmap import HeightMap


@dataclass(frozen=True, eq=False)
class FootholdGround:
    """Layers over one grid."""

    surface: HeightMap
    """Ground heights, filtered."""
    centres: HeightMap
    """Heights of a foot CENTRE whose sphere rests on the surface: what a foot is sent to."""
    foot_radius: float
    """m."""
    smooth: bool = True
    """Whether the surface went through the 3 x 3 median."""

    @property
    def version(self) -> int:
        """Version of the map the layers come from."""
        return self.surface.version

    def near(self, x: float, y: float) -> bool:
        """Whether a point is finite and near enough to the map to have a cell number."""
        far = 1e6 * self.surface.cell
        x0, y0 = self.surface.origin
        return abs(x - x0) <= far and abs(y - y0) <= far


def build_ground(heights: HeightMap, foot_radius: float, smooth: bool = True) -> FootholdGround:
    """Filter a map and dilate it by the foot sphere.

    Args:
        heights: the map as received.
        foot_radius: radius of the foot sphere, m.
        smooth: 3 x 3 median. 3 mm of noise per cell give K1 a deviation of 25 mm on flat ground, as much as a real
            edge; the filter leaves 7 mm, and straight edges stay. Switch it off for exact maps.
    """
    surface = heights.smoothed() if smooth else heights
    return FootholdGround(surface=surface, centres=surface.dilated(foot_radius), foot_radius=foot_radius, smooth=smooth)
