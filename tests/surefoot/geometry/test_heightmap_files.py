"""Files of height maps: our own, ESRI grids, images; maps of other programs, whatever way round they are stored."""

import json
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from surefoot.geometry import heightmap_files
from surefoot.geometry.heightmap import HeightMap, HeightMapError
from surefoot.geometry.heightmap_exchange import load_any
from surefoot.geometry.heightmap_files import load_asc, save
from tests.surefoot.expect import expect_error
from tests.surefoot.geometry.maps import CELL, same, save_asc, with_hole


def test_file_round_trip_and_checks(tmp_path: Path) -> None:
    ground = with_hole()
    path = heightmap_files.save(ground, tmp_path / "field", kind="rough", seed=3)
    same(heightmap_files.load(path), ground)
    first = path.read_bytes()
    heightmap_files.save(ground, path, kind="rough", seed=3)
    assert path.read_bytes() == first  # same content, same bytes
    sidecar = json.loads(path.with_suffix(".json").read_text())
    assert sidecar["extra"] == {"kind": "rough", "seed": 3}
    assert sidecar["content_sha256"] == ground.sha256

    path.write_bytes(first[:-1] + b"x")
    with expect_error(HeightMapError, field="sha256"):
        heightmap_files.load(path)
    path.with_suffix(".json").write_text("{}")
    with expect_error(HeightMapError, field="sidecar"):
        heightmap_files.load(path)


def test_npz_without_an_array(tmp_path: Path) -> None:
    path = tmp_path / "wrong.npz"
    np.savez(path, z=np.zeros((2, 2)))
    with expect_error(HeightMapError, field="file"):
        heightmap_files.load(path)


def test_npz_that_unpacks_to_too_much(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = heightmap_files.save(with_hole(), tmp_path / "field")
    monkeypatch.setattr(heightmap_files, "MAX_FILE_BYTES", 1000 + path.stat().st_size)
    np.savez_compressed(path, z=np.zeros((100, 100)))
    path.with_suffix(".json").unlink()
    with pytest.raises(HeightMapError, match="unpacks"):
        heightmap_files.load(path)


def test_npz_whose_packed_bytes_are_damaged(tmp_path: Path) -> None:
    heightmap = HeightMap(z=np.random.default_rng(0).normal(size=(20, 30)).astype(np.float32), cell=0.1)
    good = heightmap_files.save(heightmap, tmp_path / "good").read_bytes()
    damaged = tmp_path / "damaged.npz"
    for place in range(60, 2000, 97):
        damaged.write_bytes(good[:place] + bytes(8) + good[place + 8 :])
        with expect_error(HeightMapError):
            heightmap_files.load(damaged)


@pytest.mark.parametrize(("key", "half"), [("corner", 0.5), ("center", 0.0)])
def test_esri_grid_runs_from_north(tmp_path: Path, key: str, half: float) -> None:
    path = tmp_path / "dem.asc"
    path.write_text(f"ncols 3\nnrows 2\nxll{key} 10\nyll{key} 20\ncellsize 0.5\nNODATA_value -9999\n1 2 3\n4 -9999 6\n")
    ground = heightmap_files.load(path)
    np.testing.assert_array_equal(ground.z, np.array([[4, np.nan, 6], [1, 2, 3]], dtype=np.float32))
    assert ground.origin == (10 + half * 0.5, 20 + half * 0.5)


@pytest.mark.parametrize(
    ("name", "content", "field"),
    [
        ("wrong.npz", b"", "file"),
        ("wrong.npz", b"no zip at all", "file"),
        ("wrong.npz", b"PK\x03\x04 half a zip", "file"),
        ("dem.asc", b"nrows 2\ncellsize 1\n1 2\n", "ncols"),
        ("dem.asc", b"ncols 2\nnrows 2\ncellsize 1\n1 2 3\n", "z"),
        ("dem.asc", b"ncols 2\nnrows 1\ncellsize 1\n1 wet\n", "z"),
        ("dem.asc", b"ncols two\nnrows 1\ncellsize 1\n1 1\n", "ncols"),
        ("dem.asc", b"", "ncols"),
    ],
)
def test_files_that_are_no_map(tmp_path: Path, name: str, content: bytes, field: str) -> None:
    path = tmp_path / name
    path.write_bytes(content)
    with expect_error(HeightMapError, field=field):
        heightmap_files.load(path)


def kept(folder: Path, **changes: object) -> Path:
    """Return a map file with some of its arrays changed, without a sidecar."""
    arrays = {"z": np.zeros((2, 3), np.float32), "cell": 0.1, "origin": np.zeros(2), "version": 1, "frame": "map"}
    path = folder / "field.npz"
    np.savez(path, **(arrays | changes))
    return path


@pytest.mark.parametrize(("field", "value"), [("frame", "odom"), ("origin", np.zeros(3))])
def test_arrays_that_mean_something_else(tmp_path: Path, field: str, value: object) -> None:
    assert heightmap_files.load(kept(tmp_path)).version == 1
    with expect_error(HeightMapError, field=field):
        heightmap_files.load(kept(tmp_path, **{field: value}))


def test_a_sidecar_of_another_kind_of_file(tmp_path: Path) -> None:
    path = save(with_hole(), tmp_path / "field")
    sidecar = path.with_suffix(".json")
    sidecar.write_text(json.dumps(json.loads(sidecar.read_text()) | {"schema": "other/1"}))
    with expect_error(HeightMapError, field="schema"):
        heightmap_files.load(path)


@pytest.mark.parametrize("kind", ["npz", "asc", "png", "json"])
def test_files_that_are_too_large_are_not_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, kind: str) -> None:
    path = tmp_path / f"field.{kind}"
    if kind == "npz":
        kept(tmp_path)
    elif kind == "asc":
        save_asc(made(), path)
    elif kind == "png":
        Image.fromarray(np.zeros((4, 4), dtype=np.uint8)).save(path)
    else:
        small = save(with_hole(), path)
        path.write_text(path.read_text() + " " * 3 * small.stat().st_size)
    monkeypatch.setattr(heightmap_files, "MAX_FILE_BYTES", path.stat().st_size - 1)
    source = path.with_suffix(".npz") if kind == "json" else path
    with pytest.raises(HeightMapError, match=f"{path.name} has .* bytes, more than"):
        heightmap_files.load(source) if kind != "png" else heightmap_files.load_png(source, CELL, 0.0, 1.0)


def test_a_folder_is_no_text_grid(tmp_path: Path) -> None:
    (tmp_path / "dem.asc").mkdir()
    with pytest.raises(HeightMapError, match="no regular file"):
        heightmap_files.load(tmp_path / "dem.asc")


@pytest.mark.parametrize("pixels", [np.zeros((2, 2, 3), np.uint8), np.zeros((2, 2), np.bool_)], ids=["colours", "bits"])
def test_images_that_are_not_grey(tmp_path: Path, pixels: np.ndarray) -> None:
    path = tmp_path / "dem.png"
    Image.fromarray(pixels).save(path)
    with pytest.raises(HeightMapError, match="must be grey"):
        heightmap_files.load_png(path, CELL, 0.0, 1.0)


def test_png_of_16_bits(tmp_path: Path) -> None:
    path = tmp_path / "dem.png"
    Image.fromarray(np.array([[0, 65535], [32768, 0]], dtype=np.uint16)).save(path)
    ground = heightmap_files.load_png(path, CELL, -0.1, 0.3, origin=(1.0, 2.0))
    assert ground.z[0] == pytest.approx([-0.1 + 0.4 * 32768 / 65535, -0.1])
    assert ground.z[1] == pytest.approx([-0.1, 0.3])
    path.write_bytes(b"no image")
    with expect_error(HeightMapError, field="file"):
        heightmap_files.load_png(path, CELL, 0.0, 1.0)


def made(seed: int = 0) -> HeightMap:
    rng = np.random.default_rng(seed)
    z = rng.uniform(-0.05, 0.1, (6, 9)).astype(np.float32)
    z[2, 3] = np.nan
    return HeightMap(z=z, cell=0.005, origin=(-0.31, 0.12), version=4)


def test_text_grid_comes_back_exactly(tmp_path: Path) -> None:
    heights = made()
    again = load_asc(save_asc(heights, tmp_path / "m.asc"), version=4)
    np.testing.assert_array_equal(again.z, heights.z)
    assert again.sha256 == heights.sha256


@pytest.mark.parametrize("word", ["1e999", "inf", "nan", "many"])
@pytest.mark.parametrize("key", ["ncols", "cellsize"])
def test_a_text_grid_of_no_size_is_refused(key: str, word: str, tmp_path: Path) -> None:
    path = save_asc(made(), tmp_path / "m.asc")
    lines = [f"{key} {word}" if line.lower().startswith(key) else line for line in path.read_text().splitlines()]
    path.write_text("\n".join(lines))
    with pytest.raises(HeightMapError, match=key):
        load_asc(path)


def test_any_format_comes_back(tmp_path: Path) -> None:
    heights = made()
    for path in (save(heights, tmp_path / "a.npz"), save_asc(heights, tmp_path / "b.asc")):
        np.testing.assert_array_equal(load_any(path).z, heights.z)


def grey(path: Path, scale: str | None) -> Path:
    Image.fromarray(np.array([[0, 65535], [13107, 0]], dtype=np.uint16)).save(path)
    if scale is not None:
        path.with_suffix(".json").write_text(scale)
    return path


def test_a_png_of_others_has_its_scale_beside_it(tmp_path: Path) -> None:
    found = load_any(grey(tmp_path / "a.png", '{"cell": 0.005, "z_low": -0.1, "z_high": 0.4, "origin": [1, 2]}'))
    np.testing.assert_allclose(found.z, [[0.0, -0.1], [-0.1, 0.4]], atol=1e-6)  # the top row of an image is y-max
    assert (found.cell, found.origin) == (0.005, (1.0, 2.0))


@pytest.mark.parametrize(
    "scale",
    [
        None,
        "no json",
        "[]",
        '{"cell": 0.005, "z_low": 0}',
        '{"cell": 0.005, "z_low": 0, "z_high": NaN}',
        '{"cell": -1, "z_low": 0, "z_high": 1}',
        '{"cell": 0.005, "z_low": 0, "z_high": 1, "origin": [0]}',
        '{"cell": "wide", "z_low": 0, "z_high": 1}',
    ],
)
def test_a_png_without_a_scale_is_refused(tmp_path: Path, scale: str | None) -> None:
    with pytest.raises(HeightMapError):
        load_any(grey(tmp_path / "a.png", scale))
