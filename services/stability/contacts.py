"""Contact sets: what stands on the ground, checked once at the border."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]

MAX_CONTACTS = 64
MAX_COORDINATE = 1e6  # m; beyond it lengths lose the digits the answers promise


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


def contact_set(position: ArrayLike, normal: ArrayLike, mu: ArrayLike) -> ContactSet:
    """Check and normalise.

    Args:
        position: (n, 3) m, gravity-aligned frame, n <= 64.
        normal: (n, 3), any length but zero.
        mu: (n,) or one number for all; inf = unlimited friction (the cone becomes the half-space n'f >= 0).

    Raises:
        StabilityError: the field and what is wrong with it.
    """
    p = np.ascontiguousarray(position, dtype=np.float64).reshape(-1, 3)
    n = len(p)
    if n > MAX_CONTACTS:
        raise StabilityError("too_many", "contacts", f"got {n} contacts, at most {MAX_CONTACTS} are allowed")
    v = np.array(normal, dtype=np.float64).reshape(-1, 3)
    m = np.array(np.broadcast_to(np.asarray(mu, dtype=np.float64), (n,)))
    if v.shape != p.shape:
        raise StabilityError("shape", "contacts", f"got {n} positions and {len(v)} normals, numbers must agree")
    for name, values in (("position", p), ("normal", v)):
        for i in np.flatnonzero(~np.isfinite(values).all(axis=1)):
            raise StabilityError("not_finite", f"contacts.{i}.{name}", f"got {values[i].tolist()}, must be finite")
    for i in np.flatnonzero(np.abs(p).max(axis=1, initial=0.0) > MAX_COORDINATE):
        raise StabilityError("too_large", f"contacts.{i}.position", f"got {p[i].tolist()}, must be within 1e6 m")
    for i in np.flatnonzero(~(m >= 0.0)):
        raise StabilityError("negative_mu", f"contacts.{i}.mu", f"got {m[i]}, must be 0 or more")
    largest = np.abs(v).max(axis=1, initial=0.0)  # first, so that the square of a huge normal does not overflow
    for i in np.flatnonzero(largest == 0.0):
        raise StabilityError("zero_normal", f"contacts.{i}.normal", "got the zero vector, a direction is needed")
    v /= largest[:, None]
    v /= np.sqrt(np.einsum("ij,ij->i", v, v))[:, None]
    return ContactSet(p, v, m)
