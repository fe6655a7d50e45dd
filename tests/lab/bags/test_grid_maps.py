"""Heights of grid_maps in ROS bags; cell by cell as grid_map's documentation places them."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rosbags.rosbag2 import StoragePlugin, Writer

from surefoot.bus.ros2 import types
from surefoot.bus.ros_messages import map_message
from surefoot.errors import SurefootError
from surefoot.geometry.heightmap import HeightMap, HeightMapError
from surefoot.lab.bags.grid_maps import last_heights
from surefoot.lab.footholds.scored import read_map
from surefoot.schemas.terrain import HeightMapMessage
from tests.surefoot.expect import expect_error

CELL = 0.1


def given(seed: int = 0) -> HeightMap:
    z = np.random.default_rng(seed).normal(size=(4, 6)).astype(np.float32)
    z[1, 2] = np.nan
    return HeightMap(z=z, cell=CELL, origin=(1.05, -0.35))


def message(heights: HeightMap) -> Any:
    ny, nx = heights.shape
    return map_message(
        HeightMapMessage(rows=ny, cols=nx, cell=CELL, origin=heights.origin, data=heights.z.tobytes(), version=1)
    )


def bag(path: Path, *maps: Any, mcap: bool = True) -> Path:
    store = types()
    with Writer(path, version=9, storage_plugin=StoragePlugin.MCAP if mcap else StoragePlugin.SQLITE3) as writer:
        link = writer.add_connection("/elevation_map", "grid_map_msgs/msg/GridMap", typestore=store)
        for stamp, each in enumerate(maps):
            writer.write(link, stamp, store.serialize_cdr(each, each.__msgtype__))
    return path


def moved(m: Any, rows: int, cols: int) -> Any:
    """The same map in a buffer that begins elsewhere, as after `GridMap::move`."""
    nx, ny = round(m.info.length_x / CELL), round(m.info.length_y / CELL)
    buffer = np.empty((nx, ny), dtype=np.float32)
    for i in range(nx):
        for j in range(ny):
            buffer[(i + rows) % nx, (j + cols) % ny] = m.data[0].data[j * nx + i]  # column-major
    m.data[0].data[:] = buffer.T.ravel()
    m.outer_start_index, m.inner_start_index = rows, cols
    return m


@pytest.mark.parametrize("mcap", [True, False])
@pytest.mark.parametrize("start", [(0, 0), (4, 0), (0, 3), (5, 1)])
def test_the_last_map_of_a_bag_is_read(tmp_path: Path, start: tuple[int, int], mcap: bool) -> None:
    heights = given()
    path = bag(tmp_path / "run", message(given(1)), moved(message(heights), *start), mcap=mcap)
    found = read_map(path)
    np.testing.assert_array_equal(found.z, heights.z)
    assert (found.cell, found.origin) == (CELL, pytest.approx(heights.origin))


def changed(field: str) -> Any:
    m = message(given())
    if field == "layer":
        m.layers[0] = "height"
    elif field == "turned":
        m.info.pose.orientation.w, m.info.pose.orientation.z = 0.8, 0.6
    else:
        m.data[0].layout.dim[0].size = 9
    return m


@pytest.mark.parametrize("field", ["layer", "turned", "sizes"])
def test_maps_that_are_none_are_refused(tmp_path: Path, field: str) -> None:
    with expect_error(SurefootError, "invalid", "map"):
        read_map(bag(tmp_path / "run", changed(field)))


def test_layers_without_data_are_refused(tmp_path: Path) -> None:
    m = message(given())
    m.layers.insert(0, "variance")
    with expect_error(HeightMapError, "invalid", "data", "got 2 layers and 1 arrays"):
        last_heights(bag(tmp_path / "run", m))


def test_a_bag_without_a_map_is_refused(tmp_path: Path) -> None:
    with expect_error(SurefootError, "unknown_topic", "map"):
        read_map(bag(tmp_path / "run"))


@pytest.mark.parametrize("name", ["nix", "nix.mcap", "nix.tif"])
def test_a_map_that_is_not_there_is_reported(tmp_path: Path, name: str) -> None:
    with expect_error(SurefootError, "unreadable", "map"):
        read_map(tmp_path / name)
