"""Images of the floor: the exposure of a camera that moves, computed pixel by pixel.

The floor is the plane z = 0, so a pixel at (x, y, 1) in camera axes (x right, y down, z ahead) sees the floor at p + k
R (x, y, 1), k = -p_z / (R (x, y, 1))_z, with p and R the camera's place and rotation in the map. Each row is exposed
for its own time (rolling shutter), in 8 parts whose poses lie on the camera's real path; blur is their mean. Greys of
the texture are interpolated between pixels; the parts of an exposure share the two sizes whose pixels are as large as
the camera's, so that their mean lies between both.
"""

import math
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from io import BytesIO
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from surefoot.arrays import Array
from surefoot.kernels.jit import kernel
from surefoot.robot.profiles import CameraFile
from surefoot.schemas.topics import HW_IMAGE, TICK_NS, TICK_S

from ..ground.grid import random_stream
from ..physics.faults import FaultBank
from .floors import LEVELS, WALL_GREY, Texture
from .landmarks import CameraPose
from .rate import period_ms

SUBFRAMES = 8
"""Number of instants of an exposure whose pictures are averaged into one blurred image."""
JPEG_QUALITY = 85
WHITE = 255.0
SOFT_HORIZON = -1e-3
"""z of a ray's direction in the map, no unit, above which the ray is too close to the horizon to meet the floor."""


@dataclass(frozen=True)
class Optics:
    """Properties of a camera that determine its images, SI."""

    width: int
    height: int
    focal: float  # px
    period_ms: int
    exposure: float  # s
    readout: float  # s, from the first row to the last
    delay: float  # s, from the end of the exposure
    jitter: float  # s, standard deviation of the delay
    noise: float  # standard deviation in the dark, part of white
    shot: float  # the same of a white pixel
    vignetting: float  # part of the light that the corners lack

    @classmethod
    def of(cls, file: CameraFile) -> "Optics":
        """Return the optics of a camera from its file."""
        return cls(
            file.width_px, file.height_px, 0.5 * file.width_px / math.tan(0.5 * math.radians(file.field_deg)),
            period_ms(file.period_ms, HW_IMAGE), 1e-3 * file.exposure_ms, 1e-3 * file.readout_ms,
            1e-3 * file.delay_ms, 1e-3 * file.jitter_ms, file.image_noise, file.shot_noise, file.vignetting,
        )  # fmt: skip


class View(NamedTuple):
    """Times and focal length of one exposure, for the kernel."""

    numbers: Array
    """Focal length px; exposure s; readout s; time from the first pose to the middle of the exposure s; time between
    poses s; (5,)."""
    poses: Array
    """Poses of the camera along its path: position m (3), rotation from camera to map row by row (9), frame `map`, (k,
    12)."""


class TakenImage(NamedTuple):
    """One image of a simulated camera, with its time, place and exposure."""

    seq: int
    stamp_ns: int
    """Simulated time of the middle of the exposure, ns."""
    pixels: NDArray[np.uint8]
    """Grey values of the pixels, (height, width)."""
    position: Array
    """Position of the camera in base_link by kinematics from joint angles, (3,) m."""
    look: Array
    """Rotation matrix from the camera to base_link by kinematics from joint angles, (3, 3)."""
    focal: float
    """Focal length that the camera driver reports, px."""
    exposure: float
    """Exposure time of each row of the image, s."""
    readout: float
    """Time between the readout of the first and of the last row of a rolling shutter, s."""
    format: Literal["gray8", "jpeg"]


@kernel
def _grey(texture: Texture, level: int, x: float, y: float) -> float:
    """Return the grey, 0..255, of a texture at (x, y) of its size `level` (each half as wide as the one before).

    x, y: from the lower-left corner, pixels of the first size.
    """
    first, rows, cols = texture.levels[level, 0], texture.levels[level, 1], texture.levels[level, 2]
    scale = 1.0 / (1 << level)
    u, v = x * scale - 0.5, y * scale - 0.5
    c, r = math.floor(u), math.floor(v)
    a, b = u - c, v - r
    c0, r0 = int(c), int(r)
    if c0 < 0 or c0 >= cols or r0 < 0 or r0 >= rows:
        if texture.place[3] == 0.0:
            return WHITE * WALL_GREY
        c0 %= cols
        r0 %= rows
    c1 = c0 + 1 if c0 + 1 < cols else 0
    r1 = r0 + 1 if r0 + 1 < rows else 0
    at0, at1 = first + r0 * cols, first + r1 * cols
    t = texture.texels
    low = (1.0 - a) * t[at0 + c0] + a * t[at0 + c1]
    high = (1.0 - a) * t[at1 + c0] + a * t[at1 + c1]
    return float((1.0 - b) * low + b * high)


@kernel
def expose(view: View, texture: Texture, sky: float, out: Array) -> None:
    """Write the light of every pixel, greys 0..255, before noise, into `out` (height, width).

    Args:
        view: times of the exposure and poses of the camera.
        texture: picture of the floor.
        sky: grey of rays that do not meet the floor.
        out: result.
    """
    height, width = out.shape
    focal, exposure, readout, middle, step = view.numbers
    edge, x0, y0 = texture.place[2], texture.place[0], texture.place[1]
    last = view.poses.shape[0] - 2
    p = np.empty(12)
    for row in range(height):
        out[row] = 0.0
        y = (row + 0.5 - 0.5 * height) / focal
        for part in range(SUBFRAMES):
            t = middle + exposure * ((part + 0.5) / SUBFRAMES - 0.5) + readout * ((row + 0.5) / height - 0.5)
            i = min(max(int(t / step), 0), last)
            a = t / step - i
            for k in range(12):
                p[k] = (1.0 - a) * view.poses[i, k] + a * view.poses[i + 1, k]
            bx, by, bz = p[4] * y + p[5], p[7] * y + p[8], p[10] * y + p[11]
            level = LEVELS - 1
            if bz < SOFT_HORIZON:
                ahead = math.sqrt(bx * bx + by * by + bz * bz)
                size = -p[2] / bz / focal * math.sqrt(ahead / -bz) / edge
                fine = min(max(math.log2(max(size, 1.0)), 0.0), LEVELS - 1.0 - 0.5 / SUBFRAMES)
                level = int(fine + (part + 0.5) / SUBFRAMES)
            for col in range(width):
                x = (col + 0.5 - 0.5 * width) / focal
                dz = p[9] * x + bz
                if dz > SOFT_HORIZON:
                    out[row, col] += sky
                    continue
                k = -p[2] / dz
                u = (p[0] + k * (p[3] * x + bx) - x0) / edge
                v = (p[1] + k * (p[6] * x + by) - y0) / edge
                out[row, col] += _grey(texture, level, u, v)
        out[row] /= SUBFRAMES


def _covered(pixels: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Return an image (h, w), grey, whose left half something dark covers."""
    return np.hstack((pixels[:, : pixels.shape[1] // 2] // 16, pixels[:, pixels.shape[1] // 2 :]))


PIXEL_FAULTS: dict[str, Callable[[NDArray[np.uint8]], NDArray[np.uint8]]] = {
    "camera_dark": lambda pixels: pixels // 64,
    "camera_bright": lambda pixels: np.maximum(pixels, 250 + pixels // 64),
    "camera_flip": lambda pixels: pixels[::-1, ::-1].copy(),
    "camera_cover": _covered,
}
"""Functions that change the pixels of an image, (height, width), by kind of fault."""
SPOILT = (*PIXEL_FAULTS, "camera_freeze", "camera_repeat", "camera_late", "camera_zoom")


class ImageSensor:
    """Camera that takes images of the floor; one seeded random stream.

    Args:
        optics: properties of the camera.
        texture: picture of the floor.
        seed: seed of the run.
        form: format of the images.
    """

    def __init__(self, optics: Optics, texture: Texture, seed: int, form: Literal["gray8", "jpeg"] = "gray8") -> None:
        self.optics, self.texture = optics, texture
        self.form: Literal["gray8", "jpeg"] = form
        self.rng = random_stream(seed, "image")
        kept = math.ceil((optics.exposure + optics.readout) / TICK_S) + 2
        self.path: deque[CameraPose] = deque(maxlen=kept)
        self.waiting: list[tuple[int, TakenImage]] = []
        """Images not yet released, each with the tick in which it is released."""
        self._ticks, self._delayed = 0, -1
        self._held: TakenImage | None = None
        x, y = (np.arange(n) + 0.5 - 0.5 * n for n in (optics.width, optics.height))
        away = (x[None] ** 2 + y[:, None] ** 2) / (x[-1] ** 2 + y[-1] ** 2)
        self._light = 1.0 - optics.vignetting * away
        self._out = np.zeros((optics.height, optics.width))

    def look(self, ticks: int, now: CameraPose) -> TakenImage | None:
        """Store the camera's pose at the end of a tick; return the image that is released in it, None = none is due.

        Args:
            ticks: control ticks since the run began.
            now: pose of the camera then.
        """
        self.path.append(now)
        self._ticks = ticks
        o, every = self.optics, self.optics.period_ms * 1_000_000 // TICK_NS
        if ticks % every == 0 and ticks > 0:
            late = max(0.0, o.delay + o.jitter * float(self.rng.standard_normal()))
            self.waiting.append((ticks + max(1, round(late / TICK_S)), self.take(ticks // every, ticks)))
        due = [image for arrival, image in self.waiting if arrival <= ticks]
        if not due:
            return None
        self.waiting = [item for item in self.waiting if item[0] > ticks]
        return due[-1]

    def take(self, seq: int, ticks: int) -> TakenImage:
        """Return the image whose exposure ends at the last stored pose; `ticks`: that tick, since the run began."""
        o, poses = self.optics, list(self.path)
        poses = [poses[0]] * (len(poses) < 2) + poses
        table = np.array([[*p.position, *p.rot.ravel()] for p in poses])
        before = 0.5 * (o.exposure + o.readout)
        middle = max(0.0, (len(poses) - 1) * TICK_S - before)
        expose(View(np.array([o.focal, o.exposure, o.readout, middle, TICK_S]), table), self.texture,
               WHITE * WALL_GREY, self._out)  # fmt: skip
        light = self._out * self._light
        spread = np.sqrt((WHITE * o.noise) ** 2 + WHITE * o.shot**2 * light)
        greys = light + spread * self.rng.standard_normal(light.shape)
        at = poses[min(len(poses) - 1, round(middle / TICK_S))]
        stamp = ticks * TICK_NS - round(before * 1e9)
        pixels = np.rint(np.clip(greys, 0.0, WHITE)).astype(np.uint8)
        return TakenImage(seq, stamp, pixels, at.mount, at.look, o.focal, o.exposure, o.readout, self.form)

    def spoil(self, faults: FaultBank, tick: int, image: TakenImage | None) -> TakenImage | None:
        """Return the image of this tick as the broken camera gives it, None = none; `tick`: of the world."""
        if image is None:
            return None
        held, self._held = self._held, image
        for fault in faults.on(tick, *SPOILT):
            if fault.kind == "camera_late" and image.seq > self._delayed:
                self._delayed = image.seq
                self.waiting.append((self._ticks + round(fault.value), image))
                return None
            if held is not None and fault.kind in ("camera_freeze", "camera_repeat"):
                self._held = held
                image = held if fault.kind == "camera_repeat" else image._replace(pixels=held.pixels)
            elif fault.kind == "camera_zoom":
                image = image._replace(focal=image.focal * (1.0 + fault.value))
            elif fault.kind in PIXEL_FAULTS:
                image = image._replace(pixels=PIXEL_FAULTS[fault.kind](image.pixels))
        return image

    def state(self) -> dict[str, Any]:
        """Return random stream and stored poses, for a checkpoint; images not yet released are lost."""
        return {"rng": self.rng.bit_generator.state, "path": [[part.tolist() for part in pose] for pose in self.path]}

    def restore(self, state: dict[str, Any]) -> None:
        """Set random stream and stored poses to a `state` that was returned earlier."""
        self.rng.bit_generator.state = state["rng"]
        self.path.clear()
        self.path.extend(CameraPose(*(np.array(part) for part in pose)) for pose in state["path"])
        self.waiting.clear()


def jpeg(pixels: NDArray[np.uint8]) -> bytes:
    """Return an image, (h, w) grey or (h, w, 3) RGB, 0..255, as the bytes of a JPEG file."""
    from PIL import Image

    file = BytesIO()
    Image.fromarray(pixels).save(file, "JPEG", quality=JPEG_QUALITY)
    return file.getvalue()


def rehearse() -> None:
    """Call the kernel `expose` once with made-up arguments, so that it is not loaded in a tick."""
    levels = np.array([[4 * i, 2, 2] for i in range(LEVELS)], dtype=np.int64)
    texture = Texture(np.zeros(4 * LEVELS, np.uint8), levels, np.array([0.0, 0.0, 1.0, 1.0]))
    poses = np.tile(np.array([0, 0, 1.0, 1, 0, 0, 0, -1, 0, 0, 0, -1]), (2, 1))
    expose(View(np.array([1.0, 0.0, 0.0, 0.0, 1.0]), poses), texture, 0.0, np.zeros((2, 2)))
