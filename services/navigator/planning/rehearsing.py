"""A dry run of planning on a made-up floor: calls every kernel that it uses."""

import contextlib

import numpy as np

from .costs import prepare
from .grid import OCCUPIED, FloorGrid
from .route import RouteError, plan

LARGE_SIDE = 560
"""Cells; from about this size on a map gets marks, see `costs.LARGE`."""


def rehearse_planning(*, large: bool = False) -> None:
    """Plan a route around a wall, and one into the wall.

    Args:
        large: on a map so large that it gets marks; else on a small one.
    """
    for side in (LARGE_SIDE if large else 40,):
        cells = np.zeros((side, side), dtype=np.int8)
        cells[:-15, 20:22] = OCCUPIED
        costs = prepare(FloorGrid(cells, 0.05))
        plan(costs, (0.4, 0.4), (1.7, 0.4))
        with contextlib.suppress(RouteError):
            plan(costs, (0.4, 0.4), (1.05, 0.4))
