"""Textures of the floor for a camera: procedural ones, and photographs.

A texture is a grey picture of the floor seen from above, light included, with smaller copies of itself (each half as
wide) for what lies far away. Walls are part of it: a ray that meets the floor behind the foot of a wall has met the
wall before, so the floor behind a wall has the wall's grey. This is exact for walls of one grey that are higher than
the camera.
"""

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from surefoot.disk import regular_size

from ..ground.grid import random_stream
from ..ground.shapes import inside
from ..ground.terrain import Terrain, TerrainError

Array = NDArray[Any]
"""Grey values as float32, (rows, cols), 0 = black, 1 = white; rows along y, columns along x."""
Painter = Callable[[tuple[int, int], np.random.Generator], Array]

TEXEL = 0.0015
"""Edge of a pixel of a floor texture at full size, m."""
MARGIN = 1.5
"""Width of the strip around the map of open ground that the texture covers too, m; beyond it the texture repeats."""
LEVELS = 6
"""Number of sizes in which a texture is stored, each half as wide as the one before."""
WALL_GREY, LAMP_GREY = 0.62, 0.25
"""`WALL_GREY`: grey of walls, 0 = black, 1 = white; `LAMP_GREY`: share of the light that comes from lamps, 0..1, the
rest is uniform."""
LAMP_HEIGHT, LAMP_SPACING = 2.4, 3.0
"""`LAMP_HEIGHT`: height of the lamps over the floor, m; `LAMP_SPACING`: distance between neighbouring lamps, m."""
LARGEST_LEVEL = 0.002
"""Largest absolute height of a floor, m, up to which it counts as a plane; a texture on a rougher floor is refused."""
MOST_PIXELS = 64_000_000


class Texture(NamedTuple):
    """Grey picture of the floor from above in several sizes, as arrays for kernels."""

    texels: NDArray[np.uint8]
    """Grey values of the pixels of all sizes one after the other, (n,), 0..255."""
    levels: NDArray[np.int64]
    """Index of the first element in `texels`, rows and columns of each size, (LEVELS, 3)."""
    place: NDArray[np.float64]
    """x and y of the lower-left corner, frame `map`, m; edge of a pixel of the first size, m; 1 if the texture repeats
    beyond its edges, 0 if there are walls; (4,)."""


def _noise(shape: tuple[int, int], cell: tuple[float, float], rng: np.random.Generator) -> Array:
    """Return smooth noise of unit standard deviation, (rows, cols), with features of `cell` pixels (rows, cols)."""
    size = [max(2, math.ceil(n / c) + 2) for n, c in zip(shape, cell, strict=True)]
    grid = rng.standard_normal(size).astype(np.float32)
    for axis, (n, c) in enumerate(zip(shape, cell, strict=True)):
        at = np.arange(n, dtype=np.float32) / np.float32(c)
        low = at.astype(np.int64)
        part = (at - low).reshape((-1, 1) if axis == 0 else (1, -1))
        grid = grid.take(low, axis) * (1 - part) + grid.take(low + 1, axis) * part
    return grid


def _speckle(shape: tuple[int, int], rng: np.random.Generator) -> Array:
    """Return smooth noise of many sizes, of a shape (rows, cols), about zero."""
    cells = ((3.0, 0.5), (6.0, 0.7), (12.0, 0.7), (30.0, 0.5))
    return sum((w * _noise(shape, (c, c), rng) for c, w in cells), np.zeros(shape, np.float32))


def _random(shape: tuple[int, int], rng: np.random.Generator) -> Array:
    return 0.5 + 0.17 * _speckle(shape, rng)


def _carpet(shape: tuple[int, int], rng: np.random.Generator) -> Array:
    fibres = _noise(shape, (2.0, 5.0), rng) + _noise(shape, (5.0, 2.0), rng)
    flecks = (_noise(shape, (5.0, 5.0), rng) > 2.0).astype(np.float32)
    return 0.42 + 0.035 * fibres + 0.03 * _noise(shape, (20.0, 20.0), rng) + 0.16 * flecks


def _tiles(shape: tuple[int, int], rng: np.random.Generator) -> Array:
    edge, joint = round(0.2 / TEXEL), 3
    rows, cols = (np.arange(n) for n in shape)
    shade = 0.04 * rng.standard_normal((shape[0] // edge + 1, shape[1] // edge + 1)).astype(np.float32)
    chips = (_noise(shape, (3.5, 3.5), rng) > 1.4).astype(np.float32) - (_noise(shape, (5.0, 5.0), rng) > 1.7)
    grey = 0.6 + shade[rows[:, None] // edge, cols[None] // edge] + 0.13 * chips + 0.01 * _speckle(shape, rng)
    grey[rows % edge < joint] = 0.3
    grey[:, cols % edge < joint] = 0.3
    return grey


def _boards(shape: tuple[int, int], rng: np.random.Generator, printed: int) -> Array:
    """Return greys of boards of 7 x 49 cm; with `printed` > 0 only so many look different, in an order that repeats."""
    high, long = round(0.07 / TEXEL), round(0.49 / TEXEL)
    rows, cols = shape[0] // high + 1, shape[1] // long + 2
    count = printed or rows * cols
    grain = 0.05 * _noise((count * high, long), (2.5, 40.0), rng) + 0.03 * _noise(
        (count * high, long), (9.0, 90.0), rng
    )
    knots = (_noise((count * high, long), (7.0, 10.0), rng) > 2.4).astype(np.float32)
    board = (0.5 + grain - 0.18 * knots).reshape(count, high, long)
    board += 0.05 * rng.standard_normal((count, 1, 1)).astype(np.float32)
    board[:, 0], board[:, :, 0] = 0.22, 0.22
    grey = np.empty((rows * high, shape[1]), np.float32)
    for row in range(rows):
        shift = (row % 3) * long // 3 if printed else int(rng.integers(long))
        kinds = [(row + k) % printed if printed else row * cols + k for k in range(cols)]
        grey[row * high : (row + 1) * high] = np.hstack(list(board[kinds]))[:, shift : shift + shape[1]]
    return grey[: shape[0]]


PAINTERS: dict[str, Painter] = {
    "random": _random,
    "carpet": _carpet,
    "tiles": _tiles,
    "parquet": lambda shape, rng: _boards(shape, rng, 0),
    "laminate": lambda shape, rng: _boards(shape, rng, 4),
}
"""Functions that paint each procedural texture; laminate repeats four printed boards, so that many places look
alike."""


def _photograph(path: Path, width: float, shape: tuple[int, int]) -> Array:
    """Return the greys of a picture file laid on the floor `width` m wide, mirrored at its edges, (rows, cols).

    Raises:
        TerrainError: the file is no picture, or too large.
    """
    from PIL import Image, UnidentifiedImageError

    try:
        if "\0" in str(path):
            raise OSError
        regular_size(path)
        with Image.open(path) as file:
            if file.width * file.height > MOST_PIXELS:
                raise TerrainError("texture", f"{path.name} has {file.width} x {file.height} pixels, too many")
            size = max(8, round(width / TEXEL))
            tall = max(8, round(size * file.height / file.width))
            if 4 * size * tall > MOST_PIXELS:
                text = f"{path.name} on {width:g} x {tall * TEXEL:.1f} m of floor is too large for one"
                raise TerrainError("texture_width", text)
            grey = file.convert("L").resize((size, tall))
            tile = np.asarray(grey, dtype=np.float32)[::-1] / np.float32(255.0)
    except (OSError, UnidentifiedImageError, Image.DecompressionBombError) as error:
        known = ", ".join(PAINTERS)
        raise TerrainError("texture", f"got {str(path)!r}: no picture that can be read, and none of {known}") from error
    mirrored = np.vstack((np.hstack((tile, tile[:, ::-1])), np.hstack((tile[::-1], tile[::-1, ::-1]))))
    rows, cols = (-(-n // m) for n, m in zip(shape, mirrored.shape, strict=True))
    return np.tile(mirrored, (rows, cols))[: shape[0], : shape[1]]


def paint(terrain: Terrain, name: str, width: float, light: float, seed: int) -> Texture:
    """Return the texture of a terrain's floor.

    Args:
        terrain: the ground; level.
        name: name of a procedural texture (random, carpet, tiles, parquet, laminate), or path of a picture.
        width: width of a picture on the floor, m.
        light: brightness, 1 = as usual.
        seed: seed of a procedural texture.

    Raises:
        TerrainError: no such texture, or the ground is no plane.
    """
    x0, y0, x1, y1 = terrain.map.bounds
    flat = terrain.map.z[terrain.on_floor(_centres(terrain)).reshape(terrain.map.z.shape)]
    if float(np.abs(flat).max()) > LARGEST_LEVEL:
        raise TerrainError("texture", f"goes with a level floor only; {terrain.kind} is up to {flat.max():.3f} m high")
    more = 0.0 if terrain.floor else MARGIN
    x0, y0, x1, y1 = x0 - more, y0 - more, x1 + more, y1 + more
    step = 1 << (LEVELS - 1)
    rows, cols = (step * math.ceil(side / TEXEL / step) for side in (y1 - y0, x1 - x0))
    if rows * cols > MOST_PIXELS:
        raise TerrainError("texture", f"a floor of {x1 - x0:.1f} x {y1 - y0:.1f} m is too large for one")
    painter = PAINTERS.get(name)
    if painter is None:
        grey = _photograph(Path(name), width, (rows, cols))
    else:
        grey = painter((rows, cols), random_stream(seed, f"texture/{name}"))
    xs, ys = x0 + TEXEL * (np.arange(cols) + 0.5), y0 + TEXEL * (np.arange(rows) + 0.5)
    if terrain.floor:
        grey[
            ~inside(terrain.floor, np.asarray(xs[None], dtype=np.float64), np.asarray(ys[:, None], dtype=np.float64))
        ] = WALL_GREY
    lamps = [_lamp(along, middle) for along, middle in ((xs, 0.5 * (x0 + x1)), (ys, 0.5 * (y0 + y1)))]
    shade = (1.0 - LAMP_GREY) + LAMP_GREY * lamps[1][:, None] * lamps[0][None]
    return _sizes(np.clip(light * shade * grey, 0.0, 1.0), (x0, y0, TEXEL, float(not terrain.floor)))


def _centres(terrain: Terrain) -> NDArray[np.float64]:
    height = terrain.map
    x, y = np.meshgrid(height.xs(), height.ys())
    return np.stack((x.ravel(), y.ravel()), axis=1)


def _lamp(along: Array, middle: float) -> Array:
    """Return the light of a row of lamps at places `along` m, (n,), 0 to 1; the nearest counts: h^2 / (h^2 + d^2).

    h is the height of the lamps, d the distance from the nearest, one of which stands at `middle` m.
    """
    away = (along - middle + 0.5 * LAMP_SPACING) % LAMP_SPACING - 0.5 * LAMP_SPACING
    return (LAMP_HEIGHT**2 / (LAMP_HEIGHT**2 + away**2)).astype(np.float32)


def _sizes(grey: Array, place: tuple[float, ...]) -> Texture:
    parts: list[NDArray[np.uint8]] = []
    table, first = np.zeros((LEVELS, 3), dtype=np.int64), 0
    for level in range(LEVELS):
        if level > 0:
            grey = 0.25 * (grey[::2, ::2] + grey[1::2, ::2] + grey[::2, 1::2] + grey[1::2, 1::2])
        parts.append(np.rint(255.0 * grey).astype(np.uint8).ravel())
        table[level] = first, *grey.shape
        first += grey.size
    return Texture(np.concatenate(parts), table, np.array(place))
