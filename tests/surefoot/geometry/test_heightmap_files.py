"""Files of height maps: our own, ESRI grids, images."""

import json
from pathlib import Path

import numpy as np
import pytest

from surefoot.geometry import heightmap_files
from surefoot.geometry.heightmap import HeightMapError
from tests.surefoot.geometry.maps import CELL, same, with_hole


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
    with pytest.raises(HeightMapError) as error:
        heightmap_files.load(path)
    assert error.value.field == "sha256"
    path.with_suffix(".json").write_text("{}")
    with pytest.raises(HeightMapError) as error:
        heightmap_files.load(path)
    assert error.value.field == "sidecar"


@pytest.mark.parametrize("content", [b"", b"no zip at all", b"PK\x03\x04 half a zip"])
def test_files_that_are_no_map(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "wrong.npz"
    path.write_bytes(content)
    with pytest.raises(HeightMapError) as error:
        heightmap_files.load(path)
    assert error.value.field == "file"


def test_npz_without_an_array(tmp_path: Path) -> None:
    path = tmp_path / "wrong.npz"
    np.savez(path, z=np.zeros((2, 2)))
    with pytest.raises(HeightMapError) as error:
        heightmap_files.load(path)
    assert error.value.field == "file"


def test_npz_that_unpacks_to_too_much(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = heightmap_files.save(with_hole(), tmp_path / "field")
    monkeypatch.setattr(heightmap_files, "MAX_FILE_BYTES", 1000 + path.stat().st_size)
    np.savez_compressed(path, z=np.zeros((100, 100)))
    path.with_suffix(".json").unlink()
    with pytest.raises(HeightMapError, match="unpacks"):
        heightmap_files.load(path)


@pytest.mark.parametrize(("key", "half"), [("corner", 0.5), ("center", 0.0)])
def test_esri_grid_runs_from_north(tmp_path: Path, key: str, half: float) -> None:
    path = tmp_path / "dem.asc"
    path.write_text(f"ncols 3\nnrows 2\nxll{key} 10\nyll{key} 20\ncellsize 0.5\nNODATA_value -9999\n1 2 3\n4 -9999 6\n")
    ground = heightmap_files.load(path)
    np.testing.assert_array_equal(ground.z, np.array([[4, np.nan, 6], [1, 2, 3]], dtype=np.float32))
    assert ground.origin == (10 + half * 0.5, 20 + half * 0.5)


@pytest.mark.parametrize(
    ("text", "field"),
    [
        ("nrows 2\ncellsize 1\n1 2\n", "ncols"),
        ("ncols 2\nnrows 2\ncellsize 1\n1 2 3\n", "z"),
        ("ncols 2\nnrows 1\ncellsize 1\n1 wet\n", "z"),
        ("ncols two\nnrows 1\ncellsize 1\n1 1\n", "ncols"),
        ("", "ncols"),
    ],
)
def test_wrong_esri_grids(tmp_path: Path, text: str, field: str) -> None:
    path = tmp_path / "dem.asc"
    path.write_text(text)
    with pytest.raises(HeightMapError) as error:
        heightmap_files.load(path)
    assert error.value.field == field


def test_png_of_16_bits(tmp_path: Path) -> None:
    from PIL import Image

    path = tmp_path / "dem.png"
    Image.fromarray(np.array([[0, 65535], [32768, 0]], dtype=np.uint16)).save(path)
    ground = heightmap_files.load_png(path, CELL, -0.1, 0.3, origin=(1.0, 2.0))
    assert ground.z[0] == pytest.approx([-0.1 + 0.4 * 32768 / 65535, -0.1])
    assert ground.z[1] == pytest.approx([-0.1, 0.3])
    path.write_bytes(b"no image")
    with pytest.raises(HeightMapError) as error:
        heightmap_files.load_png(path, CELL, 0.0, 1.0)
    assert error.value.field == "file"
