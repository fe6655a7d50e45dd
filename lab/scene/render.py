"""A recording as a moving picture (WebP, GIF, MP4) or a still one (PNG)."""

import subprocess
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np
from PIL import Image

from surefoot.disk import whole
from surefoot.errors import SurefootError
from surefoot.record.recording import open_readable
from surefoot.record.robots import robot_of

from .endings import ANIMATED, kind_of
from .film import Film, film_of_recording
from .painter import Painter

GAP_S, MOST_GAPS = 1.0, 5
"""`GAP_S`: time without a pose, s, above which a moving picture leaves it out; `MOST_GAPS`: largest number of such gaps
that the notes list."""


class Shot(NamedTuple):
    """Settings for rendering a recording as a moving picture.

    Attributes:
        size: width and height, pixels.
        fps: frame rate of the moving picture, Hz.
        speed: simulated time per playing time.
        start, end: part of the recording, s of simulated time; end None = until its end.
        still: True: the camera is fixed; False: it follows the robot.
        quality: quality of WebP, 1 to 100.
    """

    size: tuple[int, int] = (960, 540)
    fps: float = 15.0
    speed: float = 1.0
    start: float = 0.0
    end: float | None = None
    still: bool = False
    quality: int = 60


class Rendered(NamedTuple):
    """Result of rendering: number of pictures, and notes.

    Attributes:
        frames: number of pictures.
        notes: what the pictures lack, one sentence each.
    """

    frames: int
    notes: tuple[str, ...]


def render(recording: Path, out: Path, shot: Shot, progress: Callable[[float], None] = lambda share: None) -> Rendered:
    """Write a moving or still picture of a recording; stretches of more than `GAP_S` without a pose are left out.

    Raises:
        SurefootError: the recording cannot be read, shows no robot in that time, or the kind of file is not known.
    """
    kind = kind_of(out)
    opened = open_readable(recording)
    film = film_of_recording(opened, robot_of(opened))
    notes = (*((opened.damage,) if opened.damage else ()), *film.notes)
    end = np.inf if shot.end is None else shot.end
    shown = [each.time for each in film.snapshots if shot.start <= each.time <= end]
    if not shown:
        until = "its end" if shot.end is None else f"{shot.end:g} s"
        why = "".join(f"; {note}" for note in notes)
        raise SurefootError("invalid", f"{recording} shows no robot from {shot.start:g} s to {until}{why}", "start")
    times, gaps = _times(shown, shot) if kind in ANIMATED else (shown[:1], [])
    notes += tuple(f"no pose from {a:.2f} s to {b:.2f} s: left out" for a, b in gaps[:MOST_GAPS])
    pictures = _pictures(film, shot, times, progress)
    with whole(out) as part:
        if kind == ".mp4":
            _encode(part, pictures, shot)
        elif kind == ".png":
            next(pictures).save(part, "PNG", optimize=True)
        else:
            first, pause = next(pictures), round(1000.0 / shot.fps)
            more = {"quality": shot.quality, "method": 2} if kind == ".webp" else {}
            first.save(part, kind[1:].upper(), save_all=True, append_images=pictures, duration=pause, loop=0, **more)
    return Rendered(len(times), notes)


def _times(shown: list[float], shot: Shot) -> tuple[list[float], list[tuple[float, float]]]:
    """Return the times of the pictures, s, and begin and end, s, of the gaps without a pose, which get no picture."""
    step, times, gaps = shot.speed / shot.fps, list[float](), list[tuple[float, float]]()
    begin = shown[0]
    for before, after in zip(shown, [*shown[1:], np.inf], strict=True):
        if after - before > GAP_S:
            times += np.arange(begin, before + 1e-9, step).tolist()
            begin = after
            gaps += [(before, after)] if np.isfinite(after) else []
    return times, gaps


def _pictures(film: Film, shot: Shot, times: list[float], progress: Callable[[float], None]) -> Iterator[Image.Image]:
    stamps = np.array([each.time for each in film.snapshots])
    still = None
    if shot.still:
        way = np.array([each.position for each in film.snapshots if times[0] <= each.time <= times[-1]])
        low, high = way.min(axis=0), way.max(axis=0)
        width = float(np.linalg.norm(high - low)) + 2.6 * film.scene.body.extent
        still = (np.array([*(0.5 * (low + high))[:2], 0.3 * high[2]]), width)
    painter = Painter(film.scene, shot.size, still=still)
    for number, time in enumerate(times):
        index = max(0, int(np.searchsorted(stamps, time + 1e-6)) - 1)
        yield painter.paint(film.snapshots[index], film.snapshots[: index + 1 : 3])
        progress((number + 1) / len(times))


def _encode(path: Path, pictures: Iterable[Image.Image], shot: Shot) -> None:
    """Write an MP4 with ffmpeg (raises SurefootError when it fails)."""
    size, rate = f"{shot.size[0]}x{shot.size[1]}", f"{shot.fps:g}"
    raw = ["-f", "rawvideo", "-pix_fmt", "rgb24", "-s", size, "-r", rate, "-i", "-"]
    made = ["-pix_fmt", "yuv420p", "-movflags", "+faststart", "-f", "mp4", str(path)]
    with subprocess.Popen(["ffmpeg", "-loglevel", "error", "-y", *raw, *made], stdin=subprocess.PIPE) as coder:
        assert coder.stdin is not None
        for picture in pictures:
            coder.stdin.write(picture.tobytes())
        coder.stdin.close()
    if coder.returncode:
        raise SurefootError("failed", f"ffmpeg ended with {coder.returncode}")
