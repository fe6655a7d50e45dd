"""Conditions under which an image shows nothing reliable, found in its pixels."""

import numpy as np
from numpy.typing import NDArray

Greys = NDArray[np.uint8]

DARK, WHITE_FROM = 12.0, 250
"""`DARK`: mean grey, 0 to 255, below which an image or block is dark; `WHITE_FROM`: grey from which on a pixel is
white."""
BLOCKS = 8
"""Number of blocks along each side of an image, in which a covered lens is searched."""
MOST_COVERED, MOST_WHITE = 0.25, 0.5
"""`MOST_COVERED`: share of dark blocks above which an image is `covered`; `MOST_WHITE`: share of white pixels above
which it is `bright`."""


def conditions(pixels: Greys, before: Greys | None) -> tuple[str, ...]:
    """Return the faults of an image by name: `dark`, `bright`, `covered`, `frozen`; empty = none.

    Args:
        pixels: greys 0 to 255, (height, width).
        before: the image before, (height, width); None = there is none. Real images have noise: equal ones are frozen.
    """
    found: list[str] = []
    if before is not None and np.array_equal(before, pixels):
        found.append("frozen")
    if float(np.mean(pixels, dtype=np.float64)) < DARK:
        return (*found, "dark")
    if np.count_nonzero(pixels >= WHITE_FROM) > MOST_WHITE * pixels.size:
        found.append("bright")
    if min(pixels.shape) < BLOCKS:
        return tuple(found)
    height, width = (n // BLOCKS * BLOCKS for n in pixels.shape)
    parts = pixels[:height, :width].reshape(BLOCKS, height // BLOCKS, BLOCKS, width // BLOCKS)
    blocks = np.mean(parts, axis=(1, 3), dtype=np.float64)
    if np.count_nonzero(blocks < DARK) > MOST_COVERED * blocks.size:
        found.append("covered")
    return tuple(found)
