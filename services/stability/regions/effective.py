"""Gravity that is not vertical: tilted frames, and a CoM that accelerates.

With a constant acceleration a of the CoM the balance (20), (21) holds for g_eff = g - a in place of g. In a frame
whose z axis points along -g_eff it is the problem of rest again, weight m |g_eff|: the region is a cylinder along
g_eff, so where it cuts a horizontal plane depends on the height of the CoM.
"""

from dataclasses import dataclass

import numpy as np

from surefoot.geometry.constants import GRAVITY
from surefoot.geometry.polygon import half_planes, hull

from ..programs.contacts import Array, ContactSet, StabilityError, within
from .margin import Plane
from .region import Region, RegionStatus, region

SLACK, THIN = 1e-9, 1e-7  # m: how far points and segments may lie apart and be met; what is narrower has no area
BY_CORNERS: tuple[RegionStatus, ...] = ("infeasible", "point", "segment", "ok")
MOST_ACCELERATION = 1e4  # m/s2; with more of it the effective gravity is level to the last digits


@dataclass(frozen=True, slots=True)
class Leaning:
    """A contact set seen along the effective gravity."""

    contacts: ContactSet
    """In the leaning frame: z against g_eff."""
    rot: Array
    """rot_leaning_from_world, (3, 3)."""
    strength: float
    """|g_eff|, m/s2."""

    def at_height(self, points: Array, height: float) -> Array:
        """Points (k, 2) of the leaning frame cut by the plane z = height of the world, (k, 2) world x, y."""
        back = self.rot.T  # world_from_leaning; a point (x, y, t) of the cylinder has free t
        flat = points @ back[2, :2]
        t = (height - flat) / back[2, 2]
        return points @ back[:2, :2].T + t[:, None] * back[:2, 2]

    def to_world(self) -> Array:
        """d (world x, y) / d (leaning x, y) in a horizontal plane, (2, 2)."""
        back = self.rot.T
        return back[:2, :2] - np.outer(back[:2, 2], back[2, :2]) / back[2, 2]

    def plane(self, height: float) -> Plane:
        """The horizontal plane of the world at a height, m."""
        return Plane(self.to_world(), self.at_height(np.zeros((1, 2)), height)[0])

    def seen(self, com: Array) -> Array:
        """The CoM (3,) m, world, as (2,) in the leaning frame."""
        return (self.rot @ com)[:2]


def upward(acceleration: Array, g: float = GRAVITY) -> Array:
    """-g_eff = g e_z + a for an acceleration (3,) m/s2 of the CoM in the world."""
    return np.array([acceleration[0], acceleration[1], g + acceleration[2]])


def lean(contacts: ContactSet, up: Array) -> Leaning:
    """Turn a contact set so that `up` (3,), any length but zero, points along z.

    Raises:
        StabilityError: `up` is zero (free fall), not finite, or lies in the horizontal plane.
    """
    strength = float(np.linalg.norm(up))
    if not np.isfinite(strength) or strength < 1e-9:
        raise StabilityError("zero_direction", "up", f"got {up.tolist()}, effective gravity needs a direction")
    z = up / strength
    if abs(z[2]) < 1e-6:
        raise StabilityError("zero_direction", "up", f"got {up.tolist()}, effective gravity must not be horizontal")
    x = np.array([1.0, 0.0, 0.0]) - z[0] * z
    if float(np.linalg.norm(x)) < 1e-3:
        x = np.array([0.0, 1.0, 0.0]) - z[1] * z
    x /= np.linalg.norm(x)
    y = np.array([z[1] * x[2] - z[2] * x[1], z[2] * x[0] - z[0] * x[2], z[0] * x[1] - z[1] * x[0]])
    rot = np.vstack((x, y, z))
    turned = ContactSet(
        np.ascontiguousarray(contacts.position @ rot.T), np.ascontiguousarray(contacts.normal @ rot.T), contacts.mu
    )
    return Leaning(turned, rot, strength)


def tilt_robust_directions(angle: float, count: int = 8) -> Array:
    """Unit vectors (count, 3) at `angle` rad about e_z: the directions gravity may have."""
    phi = 2.0 * np.pi * np.arange(count) / count
    s, c = np.sin(angle), np.cos(angle)
    return np.column_stack((s * np.cos(phi), s * np.sin(phi), np.full(count, c)))


@dataclass(frozen=True, slots=True)
class TiltRobust:
    """Where the CoM may be at one height although gravity may lean by an angle in any direction."""

    status: RegionStatus
    """unbounded: in some gravity, and none is infeasible; infeasible: in some gravity, or nothing is left."""
    polygon: Array
    """(p, 2) m, counter-clockwise, inside the region; empty when nothing is left, or unbounded."""
    outer: Array
    """(q, 2) m, around the region."""
    regions: tuple[Region, ...]


def tilt_robust(
    contacts: ContactSet,
    angle: float,
    height: float,
    count: int = 8,
    acceleration: Array | None = None,
    tolerance: float = 1e-4,
    limit: int = 128,
) -> TiltRobust:
    """Intersection of the regions for gravity leaning by `angle` in `count` directions, at one height of the CoM.

    Inner polygons are cut, so every point holds for each of these directions (Audren and Kheddar do so in 3-D).

    Args:
        contacts: the set.
        angle: rad.
        height: m.
        count: directions to which gravity may lean; upright gravity counts too.
        acceleration: (3,) m/s2 of the CoM; None = rest.
        tolerance: m, of each region, across its own axis.
        limit: directions of each region.

    Raises:
        StabilityError: with this acceleration the robot would fly.
    """
    found: list[Region] = []
    inner: list[Array] = []
    outer: list[Array] = []
    nothing = np.empty((0, 2))
    push = np.zeros(3) if acceleration is None else acceleration
    for leaning in leanings(contacts, push, angle, count):
        r = region(leaning.contacts, tolerance=tolerance, limit=limit)
        found.append(r)
        if r.status in ("infeasible", "unbounded"):
            continue
        inner.append(leaning.at_height(r.inner, height))
        outer.append(leaning.at_height(r.outer, height))
    statuses, left = {r.status for r in found}, nothing
    if not statuses & {"infeasible", "unbounded"}:
        left = _common(inner)
    status: RegionStatus = "unbounded" if "unbounded" in statuses else BY_CORNERS[min(len(left), 3)]
    if "infeasible" in statuses:
        status = "infeasible"
    return TiltRobust(status, left, _common(outer) if len(left) else nothing, tuple(found))


def leanings(contacts: ContactSet, acceleration: Array, angle: float, count: int = 8) -> list[Leaning]:
    """A contact set under every gravity that is possible: leaning by `angle` rad to `count` sides, and upright.

    Raises:
        StabilityError: with this acceleration (3,) m/s2 the robot would fly.
    """
    out: list[Leaning] = []
    sides = tilt_robust_directions(angle, count) if angle > 0.0 else np.empty((0, 3))
    for g_up in np.vstack((sides, [[0.0, 0.0, 1.0]])):
        up = GRAVITY * g_up + acceleration
        stays_down(up, acceleration)
        out.append(lean(contacts, up))
    return out


def stays_down(up: Array, acceleration: Array) -> None:
    """Refuse an acceleration (3,) with which -g_eff (3,) hardly points up any more.

    Raises:
        StabilityError: the robot would fly, or the acceleration is no robot's.
    """
    within(acceleration, "acceleration", MOST_ACCELERATION, "m/s^2")
    if up[2] < 0.01 * GRAVITY:
        raise StabilityError("too_large", "acceleration", f"got {acceleration.tolist()}, the robot would fly")


def _common(polygons: list[Array]) -> Array:
    """What convex polygons, counter-clockwise, have in common; points and segments count, to SLACK."""
    normals: list[Array] = []
    offsets: list[Array] = []
    for corners in polygons:
        edge = np.roll(corners, -1, axis=0) - corners
        length = np.hypot(edge[:, 0], edge[:, 1])
        along = edge[length > 0.0] / length[length > 0.0, None]
        if len(corners) == 1:
            along = np.array([[1.0, 0.0], [-1.0, 0.0]])
        outward = np.column_stack((along[:, 1], -along[:, 0]))
        if len(corners) < 3:  # its ends
            outward = np.concatenate((outward, along))
        normals.append(outward)
        offsets.append((outward @ corners.T).max(axis=1) + (SLACK if len(corners) < 3 else 0.0))
    a, b = np.concatenate(normals), np.concatenate(offsets)
    size = 4.0 * float(np.abs(b).max()) + 1.0
    return _thinned(hull(half_planes(np.ascontiguousarray(a), np.ascontiguousarray(b), size)))


def _thinned(polygon: Array) -> Array:
    """A polygon (n, 2), or its ends (2, 2) where it is thinner than THIN, its middle (1, 2) where it is shorter."""
    if len(polygon) < 2:
        return polygon
    span = polygon[:, None] - polygon[None]
    far = np.hypot(span[..., 0], span[..., 1])
    i, j = np.unravel_index(int(far.argmax()), far.shape)
    if far[i, j] <= THIN:
        return polygon.mean(axis=0)[None]
    across = (span[:, j, 0] * span[i, j, 1] - span[:, j, 1] * span[i, j, 0]) / far[i, j]
    return polygon[[i, j]] if across.max() - across.min() <= THIN else polygon
