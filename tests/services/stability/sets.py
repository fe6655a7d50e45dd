"""Contact sets of the tests: named ones with a known answer, and seeded random ones."""

from typing import Any

import numpy as np

from surefoot.services.stability.programs.contacts import ContactSet, contact_set

UP = (0.0, 0.0, 1.0)
SQUARE = ((0.1, 0.1, 0.0), (-0.1, 0.1, 0.0), (-0.1, -0.1, 0.0), (0.1, -0.1, 0.0))


def tilted(slope_deg: float, heading_deg: float = 0.0) -> tuple[float, float, float]:
    """Normal of ground that rises by `slope_deg` towards `heading_deg`."""
    s, h = np.radians(slope_deg), np.radians(heading_deg)
    return (float(-np.sin(s) * np.cos(h)), float(-np.sin(s) * np.sin(h)), float(np.cos(s)))


def random_set(
    rng: np.random.Generator,
    n: int,
    slope_deg: float = 30.0,
    mu: tuple[float, float] = (0.3, 0.9),
    height: float = 0.05,
) -> ContactSet:
    """A stance of about 40 cm at an odd place, normals up to a slope, friction in a range."""
    position = np.array([1.0, 2.0, 0.3]) + rng.uniform(-1.0, 1.0, (n, 3)) * [0.2, 0.2, height]
    s, h = np.radians(rng.uniform(0.0, slope_deg, n)), rng.uniform(0.0, 2.0 * np.pi, n)
    normal = np.column_stack((np.sin(s) * np.cos(h), np.sin(s) * np.sin(h), np.cos(s)))
    return contact_set(position, normal, rng.uniform(*mu, n))


def feasible_sets(seed: int, count: int, contacts: tuple[int, int] = (3, 9)) -> list[ContactSet]:
    """Sets whose region has an inside: vertical ground would hold them, so would this."""
    rng = np.random.default_rng(seed)
    return [random_set(rng, int(rng.integers(*contacts)), 25.0, (0.5, 0.9)) for _ in range(count)]


def as_asked(contacts: ContactSet) -> list[dict[str, Any]]:
    """The contacts of a request, friction without a limit as null."""
    rows = zip(contacts.position.tolist(), contacts.normal.tolist(), contacts.mu.tolist(), strict=True)
    return [{"position": p, "normal": n, "mu": mu if np.isfinite(mu) else None} for p, n, mu in rows]
