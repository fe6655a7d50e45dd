"""Sets whose region is exactly the hull of the contacts: no solver needed.

Contacts r_i in one plane that is not vertical, with upward unit normal n_p. If every cone contains e_z, each contact
alone can carry the weight, so the hull lies inside the region. If every cone lies in {f: n_p'f >= 0}, the rotation
about a line of that plane is a valid certificate for the hull's edge, so the region lies inside the hull. Contacts of
one plane with its normal and tilt <= atan mu are the everyday case.
"""

import math

import numpy as np

from surefoot.kernels.jit import row_kernel

from ..programs.contacts import Array
from ..programs.reduced import SPOT

PLANE = 1e-12  # of the unit of length; a larger distance from the plane is uneven ground
CONE = 1e-12  # slack of the two conditions on a cone


@row_kernel
def plane(position: Array, normal: Array, mu: Array) -> tuple[bool, float, float]:
    """Whether the hull is exact, and the plane's slopes: z = p x + q y + const."""
    n = mu.size
    if n < 3:
        return False, 0.0, 0.0
    cx, cy, cz = 0.0, 0.0, 0.0
    for i in range(n):
        cx, cy, cz = cx + position[i, 0] / n, cy + position[i, 1] / n, cz + position[i, 2] / n
    xx, xy, yy, xz, yz, size = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for i in range(n):
        x, y, z = position[i, 0] - cx, position[i, 1] - cy, position[i, 2] - cz
        xx, xy, yy, xz, yz = xx + x * x, xy + x * y, yy + y * y, xz + x * z, yz + y * z
        size = max(size, max(abs(x), abs(y)))
    det = xx * yy - xy * xy
    if size <= SPOT or det <= 1e-9 * (xx + yy) * (xx + yy):  # at one point, nearly on one line
        return False, 0.0, 0.0
    p, q = (xz * yy - yz * xy) / det, (yz * xx - xz * xy) / det
    inv = 1.0 / math.sqrt(1.0 + p * p + q * q)
    for i in range(n):
        height = position[i, 2] - cz - p * (position[i, 0] - cx) - q * (position[i, 1] - cy)
        if abs(height) > PLANE * size:
            return False, p, q
        nx, ny, nz = normal[i, 0], normal[i, 1], normal[i, 2]
        side = math.hypot(nx, ny)
        across = (nz - p * nx - q * ny) * inv  # n'n_p
        along = math.sqrt(max(0.0, 1.0 - across * across))
        if math.isinf(mu[i]):
            if nz < -CONE or math.hypot(math.hypot(-p * inv - nx, -q * inv - ny), inv - nz) > CONE:
                return False, p, q
        elif side > mu[i] * nz + CONE or (mu[i] > 0.0 and across < mu[i] * along - CONE) or across < -CONE:
            return False, p, q
    return True, p, q


@row_kernel
def holds(normal: Array, mu: float) -> bool:
    """Whether one contact alone can carry the weight: the vertical lies in its cone."""
    if math.isinf(mu):
        return normal[2] >= 0.0
    return normal[2] > 0.0 and mu * normal[2] >= math.hypot(normal[0], normal[1]) - CONE


@row_kernel
def support(position: Array, direction: Array, p: float, q: float) -> tuple[Array, Array, Array, Array]:
    """Value (k,), point (k, 2), twist (k, 4), forces (k, n, 3) for directions (k, 2): one contact carries all."""
    k, n = direction.shape[0], position.shape[0]
    value, point, twist, force = np.empty(k), np.empty((k, 2)), np.empty((k, 4)), np.zeros((k, n, 3))
    for s in range(k):
        ax, ay, best = direction[s, 0], direction[s, 1], 0
        for i in range(1, n):
            if ax * position[i, 0] + ay * position[i, 1] > ax * position[best, 0] + ay * position[best, 1]:
                best = i
        x, y, z = position[best, 0], position[best, 1], position[best, 2]
        w = q * ax - p * ay  # the axis of rotation lies in the plane
        value[s], point[s, 0], point[s, 1], force[s, best, 2] = ax * x + ay * y, x, y, 1.0
        twist[s, 0], twist[s, 1], twist[s, 2], twist[s, 3] = w * y - ax * z, -w * x - ay * z, value[s], w
    return value, point, twist, force
