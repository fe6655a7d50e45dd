"""Contact sets: what stands on the ground, checked once at the border."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from surefoot.kernels.jit import row_kernel

Array = NDArray[np.float64]

MAX_CONTACTS = 64
MAX_COORDINATE = 1e6  # m; beyond it lengths lose the digits the answers promise
MAX_MU = 1e4  # of a steeper cone regions reach kilometres, and lose the digits; what does not slip at all has inf


class StabilityError(ValueError):
    """An input that cannot be used.

    Attributes:
        code: `shape`, `not_finite`, `zero_normal`, `negative_mu`, `too_many`, `too_large`, `zero_direction`, `missing`,
            `unknown_robot`, `unknown_leg`, `duplicate_leg`, `not_positive`, `not_unit`, `unsupported` or
            `no_convergence`.
        field: path of the field, as in `contacts.2.normal`.
    """

    def __init__(self, code: str, field: str, message: str) -> None:
        super().__init__(f"{field}: {message}")
        self.code = code
        self.field = field
        self.message = message


def refuse(given: bool, field: str, other: str) -> None:
    """Refuse a field that cannot be combined with another."""
    if given:
        raise StabilityError("unsupported", field, f"cannot be asked for together with {other}")


def within(given: ArrayLike, field: str, limit: float = MAX_COORDINATE, unit: str = "m") -> Array:
    """Numbers of a request as an array, refused where one of them is beyond what answers can be computed for."""
    numbers = np.array(given, dtype=np.float64)
    if not (np.abs(numbers) <= limit).all():
        raise StabilityError("too_large", field, f"got {numbers.tolist()}, must be within {limit:g} {unit}")
    return numbers


@dataclass(frozen=True, slots=True)
class ContactSet:
    """Points of contact in a gravity-aligned frame."""

    position: Array
    """(n, 3) m."""
    normal: Array
    """(n, 3) unit, from the ground towards the robot."""
    mu: Array
    """(n,) static friction coefficient; inf = unlimited."""

    def __len__(self) -> int:
        return self.mu.size

    def without(self, index: int) -> "ContactSet":
        """The set with one contact lifted."""
        keep = np.arange(len(self)) != index
        return ContactSet(self.position[keep], self.normal[keep], self.mu[keep])


def contact_set(position: ArrayLike, normal: ArrayLike, mu: ArrayLike, *, limit: int = MAX_CONTACTS) -> ContactSet:
    """Check and normalise.

    Args:
        position: (n, 3) m, gravity-aligned frame, n <= limit.
        normal: (n, 3), any length but zero.
        mu: (n,) or one number for all, up to 1e4; inf = unlimited friction (the cone becomes the half-space n'f >= 0).
        limit: of a pool that many sets share, the size of the pool.

    Raises:
        StabilityError: the field and what is wrong with it.
    """
    p = np.array(position, dtype=np.float64, order="C").reshape(-1, 3)  # kernels want arrays of one kind only
    n = len(p)
    if n > limit:
        raise StabilityError("too_many", "contacts", f"got {n} contacts, at most {limit} are allowed")
    v = np.array(normal, dtype=np.float64, order="C").reshape(-1, 3)
    m = np.array(np.broadcast_to(np.asarray(mu, dtype=np.float64), (n,)))
    if v.shape != p.shape:
        raise StabilityError("shape", "contacts", f"got {n} positions and {len(v)} normals, numbers must agree")
    wrong, i = _normalise(p, v, m)
    if wrong:
        code, name, rule = _FAULTS[wrong - 1]
        got = (p, v, m)[("position", "normal", "mu").index(name)][i]
        raise StabilityError(code, f"contacts.{i}.{name}", f"got {got.tolist()}, {rule}")
    return ContactSet(p, v, m)


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
    """Make normals unit, in place; the first fault, counted from 1 as in _FAULTS, and its contact; (0, 0) if none."""
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
