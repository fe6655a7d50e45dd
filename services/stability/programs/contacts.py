"""Contact sets and horizontal directions of requests, checked once where they enter the service."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike

from surefoot.arguments import shown, whole
from surefoot.arrays import Array
from surefoot.errors import FieldError
from surefoot.kernels.jit import row_kernel
from surefoot.schemas.stability import MAX_CONTACTS

MAX_COORDINATE = 1e6  # m; beyond it lengths lose the digits the answers promise
MAX_MU = 1e4  # of a steeper cone regions reach kilometres, and lose the digits; what does not slip at all has inf


class StabilityError(FieldError):
    """Error of an input that cannot be used, with the field that is wrong.

    Attributes:
        code: `shape`, `not_finite`, `zero_normal`, `negative_mu`, `too_many`, `too_large`, `zero_direction`, `missing`,
            `unknown_robot`, `unknown_leg`, `duplicate_leg`, `not_positive`, `not_unit`, `unsupported` or
            `no_convergence`.
        field: path of the field, as in `contacts.2.normal`.
    """


def within(given: ArrayLike, field: str, limit: float = MAX_COORDINATE, unit: str = "m") -> Array:
    """Return numbers of a request as an array of their own shape and unit.

    Args:
        given: numbers of any shape, in `unit`.
        field: name of the field, for the refusal.
        limit: largest absolute value.
        unit: unit of the numbers, for the refusal.

    Raises:
        StabilityError: `too_large`, one is beyond `limit`, for which no answer can be computed.
    """
    numbers = np.array(given, dtype=np.float64)
    if not (np.abs(numbers) <= limit).all():
        raise StabilityError("too_large", field, f"got {numbers.tolist()}, must be within {limit:g} {unit}")
    return numbers


@dataclass(frozen=True, slots=True)
class ContactSet:
    """Points of contact in a gravity-aligned frame (z up), checked, with unit normals and friction coefficients."""

    position: Array
    """Points of contact, frame of the request (z up), (n, 3) m."""
    normal: Array
    """Unit normals of the contacts, from the ground towards the robot, (n, 3)."""
    mu: Array
    """Coefficients of static friction, (n,); inf = unlimited."""

    def __len__(self) -> int:
        return self.mu.size

    def without(self, index: int) -> "ContactSet":
        """Return the set without one contact, 0 <= index < n (raises FieldError: another index)."""
        keep = np.arange(len(self)) != whole(index, "index", low=0, high=len(self) - 1)
        return ContactSet(self.position[keep], self.normal[keep], self.mu[keep])


def contact_set(
    position: ArrayLike, normal: ArrayLike, mu: ArrayLike, *, limit: int = MAX_CONTACTS, field: str = "contacts"
) -> ContactSet:
    """Return the contacts of a request, checked, with normals of length one.

    Args:
        position: points of contact, (n, 3) m, gravity-aligned frame, n <= limit.
        normal: normals of the ground, (n, 3), any length but zero.
        mu: friction coefficients, (n,) or one for all, up to 1e4; inf = unlimited (the cone becomes n'f >= 0).
        limit: largest number of contacts; for a pool that many sets share, the size of the pool.
        field: name of the set in refusals.

    Raises:
        StabilityError: the field and what is wrong with it.
    """
    p = _triples(position, f"{field}.position")
    n = len(p)
    if n > limit:
        raise StabilityError("too_many", field, f"got {n} contacts, at most {limit} are allowed")
    v = _triples(normal, f"{field}.normal")
    try:
        m = np.array(np.broadcast_to(np.asarray(mu, dtype=np.float64), (n,)))
    except (TypeError, ValueError):
        text = f"got {shown(mu)}, expected one number, or one for each of {n} contacts"
        raise StabilityError("shape", f"{field}.mu", text) from None
    if v.shape != p.shape:
        raise StabilityError("shape", field, f"got {n} positions and {len(v)} normals, numbers must agree")
    wrong, i = _normalise(p, v, m)
    if wrong:
        code, name, rule = _FAULTS[wrong - 1]
        got = (p, v, m)[("position", "normal", "mu").index(name)][i]
        raise StabilityError(code, f"{field}.{i}.{name}", f"got {got.tolist()}, {rule}")
    return ContactSet(p, v, m)


def _triples(given: ArrayLike, field: str) -> Array:
    """Return vectors (n, 3) as an array of the one kind that kernels take (raises StabilityError: another shape)."""
    try:
        found = np.array(given, dtype=np.float64, order="C")
    except (TypeError, ValueError):
        raise StabilityError("shape", field, f"got {shown(given)}, expected numbers of shape (n, 3)") from None
    if found.shape[1:] != (3,) and found.shape != (0,):
        raise StabilityError("shape", field, f"got shape {found.shape}, expected (n, 3)")
    return found.reshape(-1, 3)


class ContactPoint(Protocol):
    """One contact of a request, as a protocol: point, normal and friction coefficient."""

    @property
    def position(self) -> tuple[float, float, float]:
        """Point of contact, frame world, m, (3,)."""
        ...

    @property
    def normal(self) -> tuple[float, float, float]:
        """Normal of the ground, of any length but zero, frame world, no unit, (3,)."""
        ...

    @property
    def mu(self) -> float | None:
        """Coefficient of static friction, no unit; None = unlimited."""
        ...


def contacts_of(points: Sequence[ContactPoint], field: str = "contacts") -> ContactSet:
    """Return the contact set of the points of a request, with unit normals; None as friction becomes unlimited.

    Raises:
        StabilityError: what is wrong with which field; paths of fields begin with `field`.
    """
    mu = [math.inf if c.mu is None else c.mu for c in points]
    return contact_set([c.position for c in points], [c.normal for c in points], mu, field=field)


_FAULTS = (
    ("not_finite", "position", "must be finite"),
    ("not_finite", "normal", "must be finite"),
    ("too_large", "position", f"must be within {MAX_COORDINATE:g} m"),
    ("negative_mu", "mu", "must be 0 or more"),
    ("zero_normal", "normal", "a direction is needed"),
    ("too_large", "mu", f"must be within {MAX_MU:g}, or unlimited (null; raw: inf)"),
)


@row_kernel
def _normalise(position: Array, normal: Array, mu: Array) -> tuple[int, int]:
    """Normalise normals, in place; return the first fault, 1 to 6 as in _FAULTS, and its contact, or (0, 0) if none.

    position (n, 3) m, normal (n, 3) of any length but zero, mu (n,).
    """
    n = mu.size
    for fault in range(1, 7):
        for i in range(n):
            px, py, pz = abs(position[i, 0]), abs(position[i, 1]), abs(position[i, 2])
            vx, vy, vz = abs(normal[i, 0]), abs(normal[i, 1]), abs(normal[i, 2])
            if (
                (fault == 1 and not (px < math.inf and py < math.inf and pz < math.inf))
                or (fault == 2 and not (vx < math.inf and vy < math.inf and vz < math.inf))
                or (fault == 3 and max(px, max(py, pz)) > MAX_COORDINATE)
                or (fault == 4 and not mu[i] >= 0.0)
                or (fault == 5 and vx + vy + vz == 0.0)
                or (fault == 6 and MAX_MU < mu[i] < math.inf)
            ):
                return fault, i
    for i in range(n):
        largest = max(abs(normal[i, 0]), max(abs(normal[i, 1]), abs(normal[i, 2])))
        for q in range(3):
            normal[i, q] /= largest  # first, so that the square of a huge normal does not overflow
        x, y, z = normal[i, 0], normal[i, 1], normal[i, 2]
        length = math.sqrt(x * x + y * y + z * z)
        for q in range(3):
            normal[i, q] /= length
    return 0, 0


def equally_spaced(count: int) -> Array:
    """Return `count` unit directions from +x counter-clockwise, (count, 2), no unit.

    Mirror images are bit-exact and multiples of 45 degrees are made of 0, 1 and sqrt(1/2): cos(pi/2) = 6e-17 would flip
    the answer for facing walls.
    """
    out = np.empty((count, 2))
    for k in range(count):
        octant, rest = divmod(8 * k, count)
        if octant % 2:  # odd octants run backwards from the next multiple of 90 degrees
            rest = count - rest
        if rest == count:
            x = y = math.sqrt(0.5)
        else:
            x, y = math.cos(rest * math.pi / (4 * count)), math.sin(rest * math.pi / (4 * count))
        x, y = ((x, y), (y, x), (-y, x), (-x, y), (-x, -y), (-y, -x), (y, -x), (x, -y))[octant]
        out[k] = x + 0.0, y + 0.0  # no negative zero
    return out


def unit(directions: ArrayLike) -> Array:
    """Return directions (k, 2), of any length but zero, as unit vectors (k, 2).

    Raises:
        StabilityError: a direction is zero or not finite.
    """
    a = np.array(directions, dtype=np.float64).reshape(-1, 2)
    for i in np.flatnonzero(~np.isfinite(a).all(axis=1)):
        raise StabilityError("not_finite", f"directions.{i}", f"got {a[i].tolist()}, must be finite")
    largest = np.abs(a).max(axis=1, initial=0.0)
    for i in np.flatnonzero(largest == 0.0):
        raise StabilityError("zero_direction", f"directions.{i}", "got the zero vector, a direction is needed")
    a /= largest[:, None]
    return np.ascontiguousarray(a / np.hypot(a[:, 0], a[:, 1])[:, None])


def directions_of(given: int | ArrayLike | None) -> Array | None:
    """Return unit directions (k, 2), no unit: equally spaced (int), or those given; None = chosen by the solver.

    Raises:
        StabilityError: a direction is zero or not finite.
    """
    return None if given is None else equally_spaced(given) if isinstance(given, int) else unit(given)


AXES = equally_spaced(8)
