"""Import of terrain heights from a grid_map message in a ROS bag.

Cell (i, j) of a grid_map lies at (x, y) = centre + half of its lengths - (i + 1/2, j + 1/2) resolution; its layers are
circular buffers that begin at `outer_start_index`, `inner_start_index`.
"""

import math
from pathlib import Path
from typing import Any

import numpy as np

from surefoot.bus.ros2 import GRID_MAP
from surefoot.errors import SurefootError
from surefoot.geometry.heightmap import HeightMap, HeightMapError

from .ros import bag_messages, reader_of

SUFFIXES = (".bag", ".db3", ".mcap")
"""File suffixes of ROS bags; a folder counts as a bag as well."""
GRID, LAYER = "grid_map_msgs/msg/GridMap", "elevation"
"""`GRID`: ROS message type of an elevation map; `LAYER`: name of the layer with its heights."""


def last_heights(path: Path) -> HeightMap:
    """Return the heights of the last grid_map message of a bag.

    Raises:
        SurefootError: the bag cannot be read, or has no grid_map, or one that is rotated or has no layer of heights.
        HeightMapError: heights or sizes are no valid height map.
    """
    reader = reader_of(path, GRID_MAP)
    try:
        topics = {c.topic for c in reader.connections if c.msgtype == GRID}
        last: Any = None
        for topic, _, message in bag_messages(reader, path, topics):
            last = message if topic in topics else last  # fixed transforms come as well
    finally:
        reader.close()
    if last is None:
        raise SurefootError("unknown_topic", f"{path} has no message of type {GRID}", "map")
    return _heights(last)


def _heights(m: Any) -> HeightMap:
    if LAYER not in m.layers:
        raise SurefootError("invalid", f"the grid_map has no layer {LAYER!r}, it has {', '.join(m.layers)}", "map")
    info, turn = m.info, m.info.pose.orientation
    if not math.isclose(abs(turn.w), 1.0, abs_tol=1e-6):
        raise SurefootError("invalid", "the grid_map is turned against its frame, wanted is one along x and y", "map")
    if len(m.layers) > len(m.data):
        raise HeightMapError("data", f"got {len(m.layers)} layers and {len(m.data)} arrays, allowed is one for each")
    array = m.data[list(m.layers).index(LAYER)]
    sizes = [dim.size for dim in array.layout.dim]
    if len(sizes) != 2 or sizes[0] * sizes[1] != len(array.data):
        raise SurefootError("invalid", f"the grid_map has {len(array.data)} heights in dimensions {sizes}", "map")
    cells = np.asarray(array.data, dtype=np.float32).reshape(sizes[0], sizes[1])
    if array.layout.dim[0].label == "column_index":
        cells = cells.T
    cells = np.roll(cells, (-m.outer_start_index, -m.inner_start_index), (0, 1))  # (i, j), x and y fall
    nx, ny = cells.shape
    centre, cell = info.pose.position, info.resolution
    origin = (centre.x - 0.5 * (nx - 1) * cell, centre.y - 0.5 * (ny - 1) * cell)
    return HeightMap(z=cells[::-1, ::-1].T, cell=cell, origin=origin)
