"""Map files: cells against the formulas of map_server pixel by pixel, round trips, and files that are refused."""

import math
import struct
import zlib
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from surefoot.geometry.heightmap import HeightMap
from surefoot.services.navigator.planning.grid import FloorGrid, GridError, grid_of
from surefoot.services.navigator.planning.map_files import (
    MAX_IMAGE_BYTES,
    MODES,
    MapFileError,
    MapInfo,
    load,
    occupancy,
)
from tests.services.refusals import refused

YAML = "image: {image}\nresolution: 0.05\norigin: [-1.0, -2.0, 0.0]\noccupied_thresh: 0.65\nfree_thresh: 0.196\n"


def write(folder, text, name="map.yaml"):
    (folder / name).write_text(text, encoding="utf-8")
    return folder / name


def pgm(folder, levels, name="map.pgm"):
    rows, cols = levels.shape
    (folder / name).write_bytes(b"P5\n# a comment\n%d %d\n255\n" % (cols, rows) + levels.astype(np.uint8).tobytes())
    return write(folder, YAML.format(image=name))


def cell_of(level, info):
    """One pixel by the formulas, in the order of operations of map_server."""
    shade = int(level) / 255
    occ = shade if info.negate else 1.0 - shade
    high, low = info.occupied_thresh, info.free_thresh
    if info.mode == "raw":
        value = math.floor(shade * 255 + 0.5)
        return value if 0 <= value <= 100 else -1
    if high < occ:
        return 100
    if occ < low:
        return 0
    return round((occ - low) / (high - low) * 100.0) if info.mode == "scale" else -1


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("negate", [False, True])
@pytest.mark.parametrize(("high", "low"), [(0.65, 0.196), (0.65, 0.25), (0.9, 0.1), (1.0, 0.0)])
def test_every_grey_becomes_the_cell_of_the_formulas(mode, negate, high, low):
    info = MapInfo(Path("x.pgm"), 0.05, (0.0, 0.0), high, low, negate, mode)
    levels = np.arange(256, dtype=np.uint8).reshape(16, 16)
    expected = [cell_of(level, info) for level in range(256)]
    assert occupancy(levels, None, info).ravel().tolist() == expected
    coloured = np.repeat(levels[..., None], 3, axis=2)
    assert occupancy(coloured, None, info).ravel().tolist() == expected


def test_opacity_counts_as_a_colour_in_trinary_and_hides_in_scale():
    info = MapInfo(Path("x.png"), 0.05, (0.0, 0.0), 0.65, 0.196)
    black, clear = np.zeros((1, 2, 3), dtype=np.uint8), np.array([[255, 0]], dtype=np.uint8)
    assert occupancy(black, clear, info).tolist() == [[100, 100]]  # 1 - 255/1020 and 1
    grey = np.full((1, 2, 3), 128, dtype=np.uint8)
    assert occupancy(grey, clear, info).tolist() == [[-1, -1]]
    white = np.full((1, 2, 3), 255, dtype=np.uint8)
    assert occupancy(white, clear, info).tolist() == [[0, -1]]
    scale = MapInfo(Path("x.png"), 0.05, (0.0, 0.0), 0.65, 0.196, mode="scale")
    assert occupancy(white, clear, scale).tolist() == [[0, -1]]


@pytest.mark.parametrize("kind", ["P5", "P2", "png", "rgb", "rgba", "bits", "palette"])
def test_every_format_shows_the_same_floor(tmp_path, kind):
    """The top row of the image is y-max."""
    levels = np.array([[0, 254, 254], [254, 254, 0]], dtype=np.uint8)
    levels = np.where(levels, 255, 0).astype(np.uint8)
    if kind == "P5":
        path = pgm(tmp_path, levels)
    elif kind == "P2":
        (tmp_path / "map.pgm").write_text("P2 3 2 255\n" + " ".join(str(v) for v in levels.ravel()) + "\n")
        path = write(tmp_path, YAML.format(image="map.pgm"))
    else:
        mode = {"png": "L", "rgb": "RGB", "rgba": "RGBA", "bits": "1", "palette": "P"}[kind]
        Image.fromarray(levels).convert(mode).save(tmp_path / "map.png")
        path = write(tmp_path, YAML.format(image="map.png"))
    grid = load(path)
    assert grid.cells.tolist() == [[0, 0, 100], [100, 0, 0]]
    assert (grid.cell, grid.origin, grid.source) == (0.05, (-1.0, -2.0), "map.yaml")
    assert grid.index(-1.0 + 0.12, -2.0 + 0.01) == (0, 2)
    assert grid.centre(0, 2) == pytest.approx((-0.875, -1.975))
    assert grid.bounds == pytest.approx((-1.0, -2.0, -0.85, -1.9))


def test_numbers_may_be_written_as_yaml_1_2_writes_them(tmp_path):
    pgm(tmp_path, np.zeros((2, 2)))
    path = write(tmp_path, YAML.format(image="map.pgm").replace("0.05", "5e-2") + "negate: true\nother: 1\n")
    assert load(path).cell == 0.05


@pytest.mark.parametrize(
    ("old", "new", "field"),
    [
        ("image: map.pgm", "image: ../map.pgm", "image"),
        ("image: map.pgm", "image: /etc/passwd", "image"),
        ("image: map.pgm", "image: other.pgm", "image"),
        ("image: map.pgm", "image: ''", "image"),
        ("image: map.pgm", "image: [map.pgm]", "image"),
        ("image: map.pgm", 'image: "map\\0.pgm"', "image"),
        ("image: map.pgm\n", "", "image"),
        ("resolution: 0.05", "resolution: 0", "resolution"),
        ("resolution: 0.05", "resolution: -1", "resolution"),
        ("resolution: 0.05", "resolution: .nan", "resolution"),
        ("resolution: 0.05", "resolution: nan", "resolution"),
        ("resolution: 0.05", "resolution: .inf", "resolution"),
        ("resolution: 0.05", "resolution: true", "resolution"),
        ("resolution: 0.05", "resolution: wide", "resolution"),
        ("resolution: 0.05\n", "", "resolution"),
        ("[-1.0, -2.0, 0.0]", "[-1.0, -2.0, 30.0]", "origin"),
        ("[-1.0, -2.0, 0.0]", "[-1.0, -2.0, .nan]", "origin"),
        ("[-1.0, -2.0, 0.0]", "[-1.0, -2.0, 0.0, 1.0]", "origin"),
        ("[-1.0, -2.0, 0.0]", "[-1.0, -2.0]", "origin"),
        ("[-1.0, -2.0, 0.0]", "[-1.0, .nan, 0.0]", "origin"),
        ("[-1.0, -2.0, 0.0]", "'120'", "origin"),
        ("[-1.0, -2.0, 0.0]", "[-1.1e6, -2.0, 0.0]", "origin"),
        ("[-1.0, -2.0, 0.0]", "[-1.0, 1.1e6, 0.0]", "origin"),
        ("origin: [-1.0, -2.0, 0.0]\n", "", "origin"),
        ("occupied_thresh: 0.65", "occupied_thresh: 1.1", "occupied_thresh"),
        ("occupied_thresh: 0.65", "occupied_thresh: -0.1", "occupied_thresh"),
        ("free_thresh: 0.196", "free_thresh: -0.1", "free_thresh"),
        ("free_thresh: 0.196", "free_thresh: 0.7", "free_thresh"),
        ("free_thresh: 0.196", "free_thresh: 1.7", "free_thresh"),
        ("free_thresh: 0.196", "free_thresh: 0.196\nmode: binary", "mode"),
        ("free_thresh: 0.196", "free_thresh: 0.196\nmode: [raw]", "mode"),
        ("free_thresh: 0.196", "free_thresh: 0.196\nnegate: 2", "negate"),
        ("free_thresh: 0.196", "free_thresh: 0.196\nnegate: [1]", "negate"),
        ("resolution: 0.05", "resolution: &a 0.05\nother: *a", "yaml"),
        ("resolution: 0.05", "resolution: [", "yaml"),
        ("resolution: 0.05", "resolution: !!python/object/apply:os.getcwd []", "yaml"),
        ("resolution: 0.05", "resolution: 0.05\nlong: " + 70_000 * "x", "yaml"),
    ],
)
def test_yaml_that_is_no_map_is_refused(tmp_path, old, new, field):
    path = pgm(tmp_path, np.zeros((2, 2)))
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new))
    with refused(MapFileError, field=field):
        load(path)


@pytest.mark.parametrize("text", ["", "- 1\n- 2\n", "just words", "\t"])
def test_other_yaml_is_refused(tmp_path, text):
    with pytest.raises(MapFileError):
        load(write(tmp_path, text))


def test_links_out_of_the_folder_are_refused(tmp_path):
    (tmp_path / "in").mkdir()
    pgm(tmp_path, np.zeros((2, 2)))
    (tmp_path / "in" / "map.pgm").symlink_to(tmp_path / "map.pgm")
    with refused(MapFileError, field="image"):
        load(write(tmp_path / "in", YAML.format(image="map.pgm")))


def png_head(width, height, bits=8):
    """A PNG that ends after the header with its size."""
    head = struct.pack(">IIBBBBB", width, height, bits, 0, 0, 0, 0)
    chunk = b"IHDR" + head
    return b"\x89PNG\r\n\x1a\n" + struct.pack(">I", len(head)) + chunk + struct.pack(">I", zlib.crc32(chunk))


@pytest.mark.parametrize(
    "content",
    [
        b"P5\n100000 2\n255\n" + bytes(200_000),
        b"P5\n100000 100000\n255\n",
        b"P5\n5000 5000\n255\n" + bytes(25_000_000),
        b"P5\n2 100000\n255\n" + bytes(200_000),
        b"P5\n2 x\n255\n" + bytes(4),
        b"P5\n0 2\n255\n",
        b"P5\n2 2\n65535\n" + bytes(8),
        b"P5\n2 2\n255\n" + bytes(3),
        b"P5\n2 2\n0\n" + bytes(4),
        b"P5\n2 -2\n255\n" + bytes(4),
        b"P5\n2",
        b"P2\n2 2\n255\n1 2 3",
        b"P2\n2 2\n255\n1 2 3 x",
        b"P6\n1 1\n255\n" + bytes(3),
        b"",
        b"GIF89a",
        png_head(100_000, 10),
        png_head(10, 10, bits=16),
        png_head(10, 10),
        png_head(10, 10)[:20],
        b"\x89PNG\r\n\x1a\n" + bytes(100),
    ],
)
def test_images_that_are_no_map_are_refused(tmp_path, content):
    (tmp_path / "map.pgm").write_bytes(content)
    with refused(MapFileError, field="image"):
        load(write(tmp_path, YAML.format(image="map.pgm")))


@pytest.mark.parametrize(
    ("image", "content", "words"),
    [
        ("map.pgm", b"P5\n20 20\n255\n" + bytes(3), "20 x 20 pixels do not fit"),
        ("map.pgm", b"P5\n2 2\n0\n" + bytes(4), "largest value must be 1 to 255, got 0"),
        ("map.png", png_head(10, 10).replace(b"IHDR", b"JHDR") + bytes(30), "cut off in its header"),
        ("''", b"", "the name of a PGM or PNG file"),
    ],
)
def test_a_head_that_lies_is_named_before_anything_is_decoded(tmp_path, image, content, words):
    if content:
        (tmp_path / image).write_bytes(content)
    with pytest.raises(MapFileError, match=words):
        load(write(tmp_path, YAML.format(image=image)))


def test_sixteen_bits_cut_off_pngs_and_missing_files_are_refused(tmp_path):
    Image.fromarray(np.zeros((50, 50), dtype=np.uint16)).save(tmp_path / "map.png")
    with pytest.raises(MapFileError, match="65535"):
        load(write(tmp_path, YAML.format(image="map.png")))
    noise = np.random.default_rng(1).integers(0, 255, (50, 50)).astype(np.uint8)
    Image.fromarray(noise).save(tmp_path / "map.png")
    whole = (tmp_path / "map.png").read_bytes()
    for n in (len(whole) // 2, len(whole) - 20, 40):
        (tmp_path / "map.png").write_bytes(whole[:n])
        with pytest.raises(MapFileError):
            load(tmp_path / "map.yaml")
    with refused(MapFileError, "not_found"):
        load(tmp_path / "none.yaml")
    with pytest.raises(MapFileError):
        load(tmp_path)


def test_a_yaml_that_is_no_text_and_an_image_of_too_many_bytes_are_refused(tmp_path):
    (tmp_path / "map.yaml").write_bytes(b"image: \xff\xfe\n")
    with pytest.raises(MapFileError, match="is not UTF-8 text"):
        load(tmp_path / "map.yaml")
    path = pgm(tmp_path, np.zeros((2, 2)))
    with (tmp_path / "map.pgm").open("r+b") as stream:
        stream.truncate(MAX_IMAGE_BYTES + 1)
    with pytest.raises(MapFileError, match=f"more than {MAX_IMAGE_BYTES} bytes"):
        load(path)


def test_ground_off_the_floor_is_occupied_and_unknown_stays_unknown():
    z = np.zeros((4, 5), dtype=np.float32)
    z[0, 0], z[1, 1], z[2, 2], z[3, 3], z[3, 4] = 0.05, -0.05, 0.03, np.nan, 0.5
    grid = grid_of(HeightMap(z=z + 1.0, cell=0.1, origin=(0.05, 0.05)))
    expected = np.zeros((4, 5))
    expected[0, 0] = expected[1, 1] = expected[3, 4] = 100
    expected[3, 3] = -1
    assert grid.cells.tolist() == expected.tolist()
    assert grid.origin == pytest.approx((0.0, 0.0))
    assert grid.index(0.02, 0.02) == (0, 0)
    with pytest.raises(GridError):
        grid_of(HeightMap(z=np.full((2, 2), np.nan, dtype=np.float32), cell=0.1))


@pytest.mark.parametrize(
    ("cells", "cell", "origin", "field"),
    [
        (np.zeros((0, 3)), 0.1, (0.0, 0.0), "cells"),
        (np.zeros(3), 0.1, (0.0, 0.0), "cells"),
        (np.full((2, 2), 101), 0.1, (0.0, 0.0), "cells"),
        (np.full((2, 2), -2), 0.1, (0.0, 0.0), "cells"),
        (np.zeros((2, 2)), 0.0, (0.0, 0.0), "cell"),
        (np.zeros((2, 2)), math.nan, (0.0, 0.0), "cell"),
        (np.zeros((2, 2)), 0.1, (0.0, math.inf), "origin"),
    ],
)
def test_grids_that_cannot_be_are_refused(cells, cell, origin, field):
    with refused(GridError, field=field):
        FloorGrid(cells, cell, origin)
    with pytest.raises(GridError):
        FloorGrid.from_bytes(bytes(3), 2, 2, 0.1, (0.0, 0.0))


@pytest.mark.parametrize("text", ["[" * 3000, "image: [[[[[[[[[1]]]]]]]]]\n", "image: a\nresolution: 0.05: 1\n"])
def test_what_is_nested_too_deep_or_no_yaml_is_one_sentence(tmp_path, text):
    with pytest.raises(MapFileError) as found:
        load(write(tmp_path, text))
    assert "\n" not in str(found.value)
    assert "map.yaml" in str(found.value)
