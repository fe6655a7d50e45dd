"""Regions without area: contacts on a line, and what the support values along and across it tell."""

import math

import numpy as np

from surefoot.kernels.jit import row_kernel

from ..programs.contacts import Array
from ..programs.fan import Fan
from ..programs.interior import SOLVED

THIN = 1e-7  # in units of the stance; a region narrower than that is a segment, a shorter one a point
LINE, LEVEL = 1e-9, 1e-6  # of the length of a line: how far contacts may lie off it, and how steep it may be


@row_kernel
def line_of(position: Array) -> tuple[bool, Array]:
    """Whether all contacts lie on one line that is not vertical, and its horizontal unit direction (2,)."""
    line, far, n = np.zeros(3), 0.0, position.shape[0]
    for i in range(1, n):
        x, y, z = position[i, 0] - position[0, 0], position[i, 1] - position[0, 1], position[i, 2] - position[0, 2]
        if x * x + y * y + z * z > far:
            far = x * x + y * y + z * z
            line[0], line[1], line[2] = x, y, z
    level = math.hypot(line[0], line[1])
    if level <= LEVEL * math.sqrt(far):
        return False, line[:2]
    for i in range(1, n):
        x, y, z = position[i, 0] - position[0, 0], position[i, 1] - position[0, 1], position[i, 2] - position[0, 2]
        t = (x * line[0] + y * line[1] + z * line[2]) / far
        x, y, z = x - t * line[0], y - t * line[1], z - t * line[2]
        if x * x + y * y + z * z > LINE * LINE * far:
            return False, line[:2]
    line[0], line[1] = line[0] / level, line[1] / level
    return True, line[:2]


@row_kernel
def along(line: Array) -> Array:
    """Directions (4, 2) that tell a region without area: both ways along a line, both ways across it."""
    x, y = line[0], line[1]
    return np.array([[x, y], [-x, -y], [-y, x], [y, -x]])


WIDE, POINT, SEGMENT = 0, 1, 2


@row_kernel
def flat_ends(probe: Fan) -> tuple[int, Array]:
    """What the answers to `along` say: an area (or no end), a point (1, 2), or a segment by its ends (2, 2); scaled."""
    for k in range(4):
        if probe.status[k] != SOLVED:
            return WIDE, probe.point[:0]
    if probe.value[2] + probe.value[3] > THIN:
        return WIDE, probe.point[:0]
    if probe.value[0] + probe.value[1] <= THIN:
        return POINT, 0.5 * (probe.point[:1] + probe.point[1:2])
    return SEGMENT, probe.point[:2].copy()
