"""Conditions under which an image shows nothing that can be trusted, found in its pixels."""

import numpy as np
from numpy.typing import NDArray

Greys = NDArray[np.uint8]

DARK, WHITE_FROM = 12.0, 250
"""Mean grey of a dark image, and least grey of a pixel without detail."""
BLOCKS = 8
"""Blocks of an image along each side."""
MOST_COVERED, MOST_WHITE = 0.25, 0.5
"""Shares of an image that may be dark, and white."""


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
