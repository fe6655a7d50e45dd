"""Support region of a contact set: status, inner and outer polygon, support values with proof.

Three methods compute it: the hull where it is exact, one kernel for ordinary sets, and `careful` for
everything that can go wrong: no contact, walls, ceilings, no friction, no area, no solution.

The hull is exact for contacts r_i in one plane that is not vertical, with upward unit normal n_p, where every cone
contains e_z and lies in {f: n_p'f >= 0}. Each contact alone can then carry the weight, so the hull lies inside the
region; the rotation about a line of that plane is a valid certificate for the hull's edge, so the region lies inside
the hull. Contacts of one plane with its normal and tilt <= atan mu are the everyday case.
"""

import math

import numpy as np

from surefoot.arrays import Array
from surefoot.geometry.polygon import hull
from surefoot.kernels.jit import row_kernel

from ..programs.contacts import AXES, ContactSet
from ..programs.fan import ANSWER, ENCLOSE, FanGoal
from ..programs.outline import outline
from ..programs.reduced import CONE, SMALL_MU, SPOT, reduce
from .careful import careful, few
from .model import Region, Solved, Support

PLANE = 1e-12  # of the unit of length; a larger distance from the plane is uneven ground


def region(
    contacts: ContactSet,
    directions: Array | None = None,
    *,
    adaptive: bool | None = None,
    tolerance: float = 1e-4,
    limit: int = 128,
) -> Region:
    """Return the region of the centre of mass in which friction forces at the contacts hold the robot, m.

    Args:
        contacts: 0 to 64 contacts.
        directions: (k, 2) unit directions of the support values, frame of the contacts; None = adaptive.
        adaptive: refine until outer is within `tolerance` of inner; None: if no directions are given.
        tolerance: greatest distance of outer from inner polygon, m.
        limit: most directions when adaptive (not less than it begins with: 3 to 8, and those given).

    Raises:
        StabilityError: no_convergence, by field `contacts`.
    """
    refine = directions is None if adaptive is None else adaptive
    given = np.empty((0, 2)) if directions is None else directions
    n = len(contacts)
    exact, p, q = plane(contacts.position, contacts.normal, contacts.mu)
    complete = not refine and has_axes(given)
    if exact:
        return _hull_region(contacts, given if len(given) and not refine else AXES, p, q)
    first = given if complete else np.concatenate((AXES, given))
    skip = len(first) - len(given) if not refine else 0
    if n > 1:
        reduced, subspace = reduce(contacts)
        goal = FanGoal(ENCLOSE if refine else ANSWER, tolerance / reduced.length, 0.0, 0.0)
        if subspace is None and min(contacts.mu.tolist()) > SMALL_MU:
            drawn = outline(reduced, contacts.position, given if refine else first, goal, limit, skip)
            if drawn.fine:
                support = Support(
                    drawn.direction, drawn.twist[:, 2], drawn.point, ("ok",) * len(drawn.direction), drawn.slack,
                    drawn.twist, drawn.force,
                )  # fmt: skip
                solved = Solved(reduced, drawn.fan, drawn.answers, reduced.origin[:2])
                return Region(
                    contacts, "ok", drawn.inner, drawn.outer, support, drawn.gap, False, drawn.answers, None, solved
                )
        return careful(contacts, (reduced, subspace), first, goal, max(limit, len(first)), skip)
    return few(contacts, first[skip:])


def _hull_region(contacts: ContactSet, direction: Array, p: float, q: float) -> Region:
    """Return the hull of contacts in a plane z = p x + q y + const, in their frame, as their region.

    `direction`: unit directions of the support points, (k, 2).
    """
    value, point, twist, force = carried(contacts.position, direction, p, q)
    k = len(direction)
    support = Support(direction, value, point, ("ok",) * k, np.zeros(k), twist, force)
    polygon = hull(np.ascontiguousarray(contacts.position[:, :2]))
    return Region(contacts, "ok", polygon, polygon, support, 0.0, True, 0)


@row_kernel
def has_axes(directions: Array) -> bool:
    """Return True if the unit directions (k, 2) contain +-x and +-y, which decide if a region is bounded."""
    found = 0
    for k in range(directions.shape[0]):
        x, y = directions[k, 0], directions[k, 1]
        if y == 0.0:
            found |= 1 if x > 0.0 else 2
        elif x == 0.0:
            found |= 4 if y > 0.0 else 8
    return found == 15


@row_kernel
def plane(position: Array, normal: Array, mu: Array) -> tuple[bool, float, float]:
    """Return True if the region is exactly the hull of the contacts, and slopes p, q of their plane z = p x + q y + c.

    The slopes are 0 where they are not computed (less than 3 contacts, or nearly on one line). position, normal: (n,
    3), points in m and unit normals; mu: friction coefficients, (n,).
    """
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
def carried(position: Array, direction: Array, p: float, q: float) -> tuple[Array, Array, Array, Array]:
    """Return the support of contacts on a plane, whose outermost one carries all, for unit directions a (k, 2).

    position: contacts, (n, 3) m; direction: the a; p, q: slopes of their plane z = p x + q y + const. Returned are the
    value a'c (k,) m, the point c (k, 2) m, the twist (v m, w_z) that proves it (k, 4), and forces as shares of the
    weight (k, n, 3).
    """
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
