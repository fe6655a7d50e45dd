"""Painted pictures of a recording."""

import shutil
import subprocess

import numpy as np
import pytest
from PIL import Image

from surefoot.errors import SurefootError
from surefoot.lab.scene.film import film_of_recording
from surefoot.lab.scene.painter import Painter, Viewpoint
from surefoot.lab.scene.render import Shot, render
from surefoot.lab.scene.shapes import TRUNK, DrawnGround
from surefoot.record.recording import open_readable
from surefoot.robot.reader import load_robot

SIZE = (320, 180)


@pytest.fixture(scope="module")
def film(recorded):
    film = film_of_recording(open_readable(recorded), load_robot("ragno"))
    film.scene.ground = film.scene.ground.coarse(1500)
    return film


def near_colour(image, colour, within=60.0):
    """Places (n, 2) of pixels near a colour `#rrggbb`."""
    wanted = [int(colour[i : i + 2], 16) for i in (1, 3, 5)]
    away = np.linalg.norm(np.asarray(image, dtype=float) - wanted, axis=2)
    return np.argwhere(away < within)[:, ::-1]


def test_the_trunk_is_painted_in_the_middle_and_moves_in_a_still_view(film):
    begin, end = film.snapshots[20], film.snapshots[-1]
    middle = near_colour(Painter(film.scene, SIZE).paint(end, []), TRUNK).mean(axis=0)
    assert np.linalg.norm(middle - [0.5 * SIZE[0], 0.5 * SIZE[1]]) < 0.12 * SIZE[0]
    painter = Painter(film.scene, SIZE, still=(np.array([0.05, 0.0, 0.04]), 1.0))
    first, last = (near_colour(painter.paint(shown, []), TRUNK).mean(axis=0) for shown in (begin, end))
    camera = Viewpoint(painter.scale, painter.still[0], painter.size)
    seen = camera.see(np.array([begin.position, end.position]))[:, 0] * SIZE[0] / painter.size[0]
    assert seen[1] - seen[0] > 10.0
    assert last[0] - first[0] == pytest.approx(seen[1] - seen[0], rel=0.5)  # legs hide parts of the trunk


def test_unknown_ground_leaves_a_hole_and_no_black(film):
    heights = np.zeros((40, 40))
    heights[5:8, 5:8] = np.nan
    film.scene.ground, before = DrawnGround(heights, 0.05, (-1.0, -1.0)), film.scene.ground
    picture = Painter(film.scene, SIZE, still=(np.zeros(3), 6.0))._painted_ground(Viewpoint(100.0, np.zeros(3), SIZE))[
        0
    ]
    film.scene.ground = before
    painted = np.asarray(picture)
    solid = painted[painted[..., 3] > 0]
    assert solid[:, :3].min() > 100


def test_a_moving_picture_has_a_frame_for_each_step_of_time(recorded, tmp_path):
    shares = []
    frames, notes = render(recorded, tmp_path / "walk.webp", Shot(SIZE, fps=2.0, speed=2.0), shares.append)
    assert notes == ()
    with Image.open(tmp_path / "walk.webp") as image:
        assert (image.n_frames, image.size) == (frames, SIZE)
    assert frames == 5
    assert shares == pytest.approx([0.2, 0.4, 0.6, 0.8, 1.0])


def test_a_still_picture_is_the_same_each_time(recorded, tmp_path):
    for name in ("a.png", "b.png"):
        assert render(recorded, tmp_path / name, Shot(SIZE, start=2.0)).frames == 1
    assert (tmp_path / "a.png").read_bytes() == (tmp_path / "b.png").read_bytes()


@pytest.mark.parametrize(("name", "shot"), [("a.bmp", Shot()), ("a.png", Shot(start=99.0))])
def test_what_cannot_be_painted_is_refused_and_leaves_no_file(recorded, tmp_path, name, shot):
    with pytest.raises(SurefootError) as refused:
        render(recorded, tmp_path / name, shot)
    assert refused.value.code == "invalid"
    assert not list(tmp_path.iterdir())


@pytest.mark.skipif(shutil.which("ffmpeg") is None, reason="no ffmpeg here: apt-get install ffmpeg")
def test_an_mp4_has_a_frame_for_each_step_of_time(recorded, tmp_path):
    frames, _ = render(recorded, tmp_path / "walk.mp4", Shot(SIZE, fps=5.0, start=1.0, end=2.9))
    assert frames == 10
    back = [
        "ffmpeg",
        "-loglevel",
        "error",
        "-i",
        str(tmp_path / "walk.mp4"),
        "-f",
        "rawvideo",
        "-pix_fmt",
        "rgb24",
        "-",
    ]
    pictures = np.frombuffer(subprocess.run(back, check=True, capture_output=True).stdout, np.uint8)
    pictures = pictures.reshape(frames, SIZE[1], SIZE[0], 3).astype(float)
    render(recorded, tmp_path / "first.png", Shot(SIZE, start=1.0))
    with Image.open(tmp_path / "first.png") as image:
        first = np.asarray(image.convert("RGB"), dtype=float)
    assert np.abs(pictures[0] - first).mean() < 6.0  # of 255
    assert np.abs(pictures[0] - pictures[-1]).mean() > np.abs(pictures[0] - first).mean()  # it walks
    assert [path.name for path in tmp_path.iterdir() if path.suffix == ".mp4"] == ["walk.mp4"]


def test_an_mp4_without_ffmpeg_is_refused_with_what_needs_nothing(recorded, tmp_path, monkeypatch):
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(SurefootError, match="the program ffmpeg on the path") as refused:
        render(recorded, tmp_path / "a.mp4", Shot())
    assert refused.value.code == "not_installed"
    assert not list(tmp_path.iterdir())
