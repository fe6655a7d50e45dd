"""Static stability of a robot on its contacts: where its centre of mass may be, and how far it is from falling.

    feet = stability.contacts([[0.1, 0.1, 0.0], [0.1, -0.1, 0.0], [-0.1, 0.0, 0.05]], friction=0.5)
    stability.margin(feet, com=[0.02, 0.0])

Lengths in m, in a gravity-aligned frame (z up). The region is that of Bretl and Lall (2008), as an inner and an outer
polygon with certificates.
"""

import math

import numpy as np
from numpy.typing import ArrayLike

from surefoot.arguments import array, instance, number, shape_of, whole
from surefoot.arrays import Array
from surefoot.errors import FieldError
from surefoot.schemas.stability import MAX_CONTACTS
from surefoot.services.stability.programs.contacts import MAX_COORDINATE, MAX_MU, ContactSet, contact_set
from surefoot.services.stability.regions import margin as margins
from surefoot.services.stability.regions.equilibrium import equilibrium, least_forces
from surefoot.services.stability.regions.many import STATUSES, what_if
from surefoot.services.stability.regions.model import Region, RegionStatus
from surefoot.services.stability.regions.region import region as region_of

__all__ = ["ContactSet", "Region", "contacts", "forces", "lifts", "margin", "region"]

WIDEST = 10.0
"""Largest distance between two contacts along an axis, and of the centre of mass from the nearest contact, m; larger
ones are refused."""
UNIT = 1e-6
"""Largest difference of the squared length of a unit normal from 1; normals of another length are refused in a
`ContactSet`."""
MOST_DIRECTIONS = 4096
"""Largest number of search directions for the border of a support region; more are refused."""


def contacts(points: ArrayLike, normals: ArrayLike | None = None, friction: ArrayLike = 0.5) -> ContactSet:
    """Return the contacts of a robot with the ground.

    Args:
        points: places of contact, (n, 3) m, gravity-aligned frame.
        normals: normals of the ground, towards the robot, (n, 3), any length but zero; None = level ground.
        friction: static coefficients, (n,) or one for all, 0 to 1e4; inf = unlimited.

    Raises:
        FieldError: shape, NaN, range, a zero normal, or points so far apart that they cannot be metres.
    """
    p = array(points, "points", ("n", 3), "m")
    n = len(p)
    _together(p, "points")
    up = np.tile([0.0, 0.0, 1.0], (n, 1)) if normals is None else array(normals, "normals", (n, 3))
    one = shape_of(friction) == ()
    mu = array(friction, "friction", () if one else (n,), low=0.0, high=MAX_MU, inf=True)
    return contact_set(p, up, mu)


def region(
    contacts: ContactSet, *, directions: ArrayLike | None = None, tolerance: float = 1e-4, limit: int = 128
) -> Region:
    """Return the region in which the centre of mass may be: `status`, `inner` and `outer` polygons (m, 2) m, `gap` m.

    Args:
        contacts: result of the function `contacts`.
        directions: directions in which the region is bounded, (k, 2); None = as many as the tolerance needs.
        tolerance: largest distance of the outer from the inner polygon, m.
        limit: largest number of directions.

    Raises:
        FieldError: an argument that cannot be used.
    """
    wanted = None if directions is None else array(directions, "directions", ("k", 2))
    if wanted is not None:
        length = np.hypot(wanted[:, 0], wanted[:, 1])
        if not len(wanted) or (length == 0.0).any():
            raise FieldError("zero_direction", "directions", "got none or a zero vector, expected directions")
        wanted /= length[:, None]
    return region_of(
        _checked(contacts), wanted, tolerance=number(tolerance, "tolerance", "m", low=1e-9, high=1.0),
        limit=whole(limit, "limit", low=1, high=MOST_DIRECTIONS),
    )  # fmt: skip


def margin(where: ContactSet | Region, com: ArrayLike) -> float:
    """Return the distance of the centre of mass from the edge of the region, m: negative outside of it.

    -inf: the robot falls, and the distance to the edge is unknown, as there is no region or it has no bounds. inf: the
    contacts hold the robot at any place. In a region without bounds, as between walls, rays search the nearest edge.

    Args:
        where: contacts, or their region, which saves its computation.
        com: place of the centre of mass, (2,) m; (3,) is taken without its height.

    Raises:
        FieldError: an argument that cannot be used.
    """
    found = where if isinstance(where, Region) else region_of(_checked(where, "where"))
    value = margins.margin(found, _place(com, found.contacts)).value
    return _defined(found.status, math.nan if value is None else value)


def _defined(status: RegionStatus, value: float) -> float:
    """Return the margin of a region of a status, m, where `value` is NaN without a region or an edge."""
    if status == "unbounded":
        return math.inf if math.isnan(value) else value if value >= 0.0 else -math.inf
    return -math.inf if math.isnan(value) else value


def lifts(contacts: ContactSet, com: ArrayLike) -> Array:
    """Return the margin that is left when one contact is lifted, for each contact, (n,) m.

    Each is the distance of the centre of mass from the edge of the region without that contact: -inf where the robot
    falls and no edge is known, inf where it falls nowhere.

    `com`: place of the centre of mass, (2,) m; (3,) is taken without its height.

    Raises:
        FieldError: an argument that cannot be used.
    """
    known = _checked(contacts)
    found = what_if(known, _place(com, known))
    statuses: list[int] = found.status[1:].tolist()
    values: list[float] = found.margin[1:].tolist()
    left = [_defined(STATUSES[status], value) for status, value in zip(statuses, values, strict=True)]
    return np.array(left, dtype=np.float64)


def forces(contacts: ContactSet, com: ArrayLike, weight: float = 1.0) -> Array | None:
    """Return the contact forces of least sum of squares that hold the robot, (n, 3) in the unit of `weight`.

    None: no forces within the friction cones hold it.

    Args:
        contacts: result of the function `contacts`.
        com: place of the centre of mass, (2,) m.
        weight: weight of the robot, N; 1 = forces as shares of the weight.

    Raises:
        FieldError: an argument that cannot be used.
    """
    load = number(weight, "weight", "N", low=1e-9, high=1e9)
    known = _checked(contacts)
    place = _place(com, known)
    least = least_forces(known, place) if equilibrium(known, place).held else None
    return None if least is None else load * least


def _place(com: ArrayLike, contacts: ContactSet) -> Array:
    flat = shape_of(com)[-1:] == (2,)
    place = array(com, "com", (2,) if flat else (3,), "m", low=-1e6, high=1e6)[:2].copy()
    if len(contacts):
        away = float(np.hypot(*(contacts.position[:, :2] - place).T).min())
        if away > WIDEST:
            text = f"got a place {away:g} m from the nearest contact, allowed are {WIDEST:g} m; is it in millimetres?"
            raise FieldError("range", "com", text)
    return place


def _checked(given: ContactSet, field: str = "contacts") -> ContactSet:
    """Return a contact set, which may be made by hand, after the checks of `contacts` (raises FieldError)."""
    instance(given, field, ContactSet, "the result of `stability.contacts`")
    mu = array(given.mu, f"{field}.mu", ("n",), low=0.0, high=MAX_MU, inf=True)
    n = len(mu)
    if n > MAX_CONTACTS:
        raise FieldError("too_many", field, f"got {n} contacts, at most {MAX_CONTACTS} are allowed")
    p = array(given.position, f"{field}.position", (n, 3), "m", low=-MAX_COORDINATE, high=MAX_COORDINATE)
    _together(p, f"{field}.position")
    v = array(given.normal, f"{field}.normal", (n, 3))
    for i in np.flatnonzero(np.abs(np.square(v.clip(-2.0, 2.0)).sum(axis=1) - 1.0) > UNIT):
        text = f"got {v[i].tolist()}, expected a unit normal; `stability.contacts` takes any length"
        raise FieldError("not_unit", f"{field}.normal", text)
    return ContactSet(p, v, mu)


def _together(points: Array, field: str) -> None:
    """Check that contacts (n, 3) m are not farther apart than a robot is long (raises FieldError)."""
    if len(points) and np.ptp(points, axis=0).max() > WIDEST:
        text = f"got points {np.ptp(points, axis=0).max():g} apart, allowed are {WIDEST:g} m; are these millimetres?"
        raise FieldError("range", field, text)
