"""Footholds for a four-legged robot that knows nothing of surefoot: heights in, footholds and free rectangles out.

Its feet are 20 mm in radius and its map has cells of 12.5 mm, both 2.5 times those the shipped model was learned with.
"""

import numpy as np

from surefoot.services.footholds.models.files import load, shipped
from surefoot.services.footholds.patch import PatchStep, choose_on_patch

CELL, FOOT, STROKE = 0.0125, 0.02, (-0.10, 0.0, 0.0)
FEET = {"FL": (0.35, 0.15), "FR": (0.35, -0.15), "RL": (-0.25, 0.15), "RR": (-0.25, -0.15)}


def height(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """A ditch under the left front foot, a ramp behind, m."""
    ditch = -0.10 * ((x > 0.34) & (x < 0.365) & (y > 0.05))
    return ditch + 0.5 * np.maximum(-0.2 - x, 0.0)


def main() -> None:
    """Choose a foothold for each leg on the patch about its nominal one."""
    path = shipped("ragno")
    assert path is not None
    model = load(path).scaled(CELL / 0.005)
    steps = CELL * (np.arange(21) - 10)
    for leg, (x, y) in FEET.items():
        patch = height(x + steps[None, :], y + steps[:, None])
        found = choose_on_patch(patch, CELL, model, PatchStep(STROKE, FOOT))
        if found.foothold is None or found.rectangle is None:
            print(f"{leg}: no foothold, {found.counts}")
            continue
        dx, dy, z = (1e3 * value for value in found.foothold)
        x0, y0, x1, y1 = (1e3 * value for value in found.rectangle)
        slip = 1e3 * abs(STROKE[0]) * found.slip
        print(f"{leg}: {dx:+.0f} {dy:+.0f} mm from nominal, foot centre at {z:.0f} mm, slips {slip:.1f} mm")
        print(f"    free from {x0:+.0f} to {x1:+.0f} mm along, {y0:+.0f} to {y1:+.0f} mm across")


if __name__ == "__main__":
    main()
