"""Summaries of maps of a map_server: what robots of any size find there."""

import math

import numpy as np
import pytest
from PIL import Image

from surefoot.errors import FieldError
from surefoot.lab.maps.summary import summary_of


def room(folder, cell):
    """The YAML file of a room of 60 x 80 cells with walls of one cell around it."""
    image = np.full((60, 80), 255, dtype=np.uint8)
    image[[0, -1]] = image[:, [0, -1]] = 0
    Image.fromarray(image).save(folder / "room.pgm")
    path = folder / "room.yaml"
    path.write_text(
        f"image: room.pgm\nresolution: {cell}\norigin: [0, 0, 0]\nnegate: 0\n"
        "occupied_thresh: 0.65\nfree_thresh: 0.196\n"
    )
    return path


@pytest.mark.parametrize("cell", [0.001, 0.05, 0.5])
@pytest.mark.parametrize("cells", [0.0, 3.0, 20.0])
def test_the_share_where_a_robot_may_stand_is_counted_for_every_size_and_cell(tmp_path, cell, cells):
    found = summary_of(room(tmp_path, cell), cells * cell)
    rest = 2 * math.ceil(cells - 0.5) if cells else 0  # centres are half a cell from the edge of the wall at least
    assert found.facts["largest_region"] == pytest.approx((58 - rest) * (78 - rest) / 4800)
    assert not found.problems


def test_a_robot_without_room_is_a_problem_and_one_of_more_than_200_cells_is_refused(tmp_path):
    path = room(tmp_path, 0.05)
    assert summary_of(path, 5.0).problems == ("a robot with a radius of 5 m stands nowhere",)
    with pytest.raises(FieldError, match="allowed is 0 to 10 m"):
        summary_of(path, 10.1)


def test_keepout_zones_part_the_floor_of_a_map(tmp_path):
    path = room(tmp_path, 0.05)
    zone = " - {name: a, type: keepout, polygon: [[-9, 0.4], [9, 0.4], [9, 0.6], [-9, 0.6]]}\n"
    slow = " - {name: b, type: speed_limit, speed_limit: 20, polygon: [[0, 0], [1, 0], [1, 1]]}\n"
    alone = tmp_path / "zones.yaml"
    alone.write_text(f"zones:\n{zone}{slow}", encoding="utf-8")
    assert summary_of(alone).facts == {"kind": "zones", "keepout": ["a"], "speed_limits": ["b"]}
    before = summary_of(path, 0.05).facts
    path.write_text(path.read_text(encoding="utf-8") + f"zones:\n{zone}", encoding="utf-8")
    after = summary_of(path, 0.05).facts
    assert after["keepout"] == ["a"]
    assert "keepout" not in before
    assert (before["regions"], after["regions"]) == (1, 2)
