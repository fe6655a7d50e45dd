"""Support regions in four modes: robot at rest, accelerating CoM, gravity that may lean, limited joint torques.

With a constant acceleration a of the CoM the balance of forces and moments at rest holds for g_eff = g - a in place of
g. In a frame whose z axis points along -g_eff it is the problem of rest again, weight m |g_eff|: the region is a
cylinder along g_eff, so where it cuts a horizontal plane depends on the height of the CoM.
"""

import math
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from surefoot.arrays import Array
from surefoot.geometry.constants import GRAVITY
from surefoot.geometry.linear import norm, product, solve
from surefoot.geometry.polygon import gap, half_planes, hull

from ..programs.contacts import ContactSet, StabilityError, equally_spaced
from ..programs.reduced import THIN
from .actuated import ServoLegs, actuated_region
from .joint import apart, farthest
from .model import Plane, Region, RegionStatus, Support
from .region import region

MET = 1e-9  # m, how far points and segments may lie apart and be met
BY_CORNERS: tuple[RegionStatus, ...] = ("infeasible", "point", "segment", "ok")
SHARED = 32  # directions in which what regions without bounds share is solved for, if it has an end
SIDES = 8  # directions to which gravity may lean
UPRIGHT = np.eye(3)


@dataclass(frozen=True, slots=True)
class AtRest:
    """Mode of a region: gravity is the only acceleration."""


@dataclass(frozen=True, slots=True)
class Moving:
    """Mode of a region: the centre of mass accelerates by a known vector."""

    acceleration: Array
    """Acceleration of the centre of mass, (3,) m/s^2, frame world."""
    height: float
    """Height of the centre of mass, z in frame world, m."""


@dataclass(frozen=True, slots=True)
class Tilted:
    """Mode of a region: gravity may lean by up to an angle to each of eight sides, or not at all."""

    angle: float
    """Largest angle between the true gravity and its stated direction, rad, above 0."""
    acceleration: Array
    """Acceleration of the centre of mass, (3,) m/s^2, frame world."""
    height: float
    """Height of the centre of mass, z in frame world, m."""


@dataclass(frozen=True, slots=True)
class Actuated:
    """Mode of a region: servos of limited torque hold the robot in a posture."""

    legs: ServoLegs
    """Legs that stand on the contacts, with their limits of torque."""


Mode = AtRest | Moving | Tilted | Actuated


class Refinement(NamedTuple):
    """Directions in which a region is solved for, and tolerance and limit of their refinement."""

    directions: Array | None = None
    """Unit directions to solve for, (k, 2), frame world; None = chosen by refinement."""
    adaptive: bool | None = None
    """True: refine until outer is within `tolerance` of inner; False: no; None: refine if no directions are given."""
    tolerance: float = 1e-4
    """Largest horizontal distance of outer from inner polygon at which the refinement of a region ends, m."""
    limit: int = 128
    """Largest number of directions of an adaptive region."""
    proofs: bool = True
    """True: forces and certificates of an accelerated robot are turned back to frame world; False: they are not."""


def regions_in(mode: Mode, contacts: ContactSet, wanted: Refinement) -> list[Region]:
    """Return the regions of a contact set under each gravity of a mode, m, in the plane of the CoM, frame world.

    Raises:
        StabilityError: the robot would fly, or no solver finds an answer.
    """
    if isinstance(mode, Actuated):
        return [actuated_region(contacts, mode.legs, wanted.directions)]
    seen, adaptive = leanings(mode, contacts), wanted.adaptive
    # a plane cuts lengths of the frame up to 1 / cosine of the lean
    tolerance = wanted.tolerance * (math.cos(mode.angle) if isinstance(mode, Tilted) else seen[0].rot[2, 2])
    if isinstance(mode, Tilted):  # no directions to choose
        adaptive = None
    out: list[Region] = []
    for each in seen:
        given = each.directions(wanted.directions)
        found = region(each.contacts, given, adaptive=adaptive, tolerance=tolerance, limit=wanted.limit)
        out.append(found if isinstance(mode, AtRest) else each.level(found, mode.height, wanted.proofs))
    return out


def in_common(found: list[Region]) -> Region:
    """Return the intersection of the regions of several gravities, m, in the plane of the CoM; of one, that region.

    Inner polygons are cut, so every point holds for each of these gravities (Audren and Kheddar do so in 3-D). The
    status is infeasible if one region is, or nothing is left; unbounded if what is left has no end on some side.

    Raises:
        StabilityError: no solver finds what regions without bounds share.
    """
    if len(found) == 1:
        return found[0]
    statuses, nothing = {each.status for each in found}, np.empty((0, 2))
    inner, outer, endless = nothing, nothing, False
    if "infeasible" not in statuses:
        if "unbounded" in statuses:
            inner, outer, endless = _without_bounds(found)
        else:
            inner = _common([each.inner for each in found])
            if len(inner):
                outer = _common([each.outer for each in found])
    status: RegionStatus = "unbounded" if endless else BY_CORNERS[min(len(inner), 3)]
    empty = Support(nothing, np.empty(0), nothing, (), np.empty(0), np.empty((0, 0)), np.empty((0, 0, 3)))
    widest = gap(inner, outer) if len(inner) else math.nan
    return Region(found[-1].contacts, status, inner, outer, empty, widest, True, sum(r.calls for r in found))


@dataclass(frozen=True, slots=True)
class Leaning:
    """Contact set in a frame along the effective gravity, and the rotation to that frame."""

    contacts: ContactSet
    """Contacts in the leaning frame, whose z axis points against the effective gravity."""
    rot: Array
    """Rotation from frame world into the frame whose z is against the effective gravity, (3, 3)."""
    strength: float
    """Magnitude of the effective gravity, m/s^2."""

    def directions(self, given: Array | None) -> Array | None:
        """Return unit directions (k, 2) of a level plane of the world as unit vectors of the leaning frame, or None."""
        if given is None or (self.strength == GRAVITY and self.rot[2, 2] == 1.0):
            return given
        turned = product(given, self.to_world())
        return np.ascontiguousarray(turned / np.hypot(turned[:, 0], turned[:, 1])[:, None])

    def at_height(self, points: Array, height: float) -> Array:
        """Return where lines along gravity through points of the leaning frame meet the plane z = `height`, m.

        points: x, y, (k, 2) m, leaning frame, whose z is against the effective gravity. Result: world x, y, (k, 2) m.
        """
        back = self.rot.T  # world_from_leaning; a point (x, y, t) of the cylinder has free t
        flat = product(points, back[2, :2])
        t = (height - flat) / back[2, 2]
        return product(points, back[:2, :2].T) + t[:, None] * back[:2, 2]

    def to_world(self) -> Array:
        """Return the derivative of world x, y by leaning x, y in a horizontal plane of the world, (2, 2), no unit."""
        back = self.rot.T
        return back[:2, :2] - np.outer(back[:2, 2], back[2, :2]) / back[2, 2]

    def seen(self, com: Array) -> Array:
        """Return x, y of the CoM in the leaning frame, (2,) m, from its position in the world, (3,) m."""
        return product(self.rot[:2], com)

    def level(self, found: Region, height: float, proofs: bool) -> Region:
        """Return a region of the leaning frame, cut by the plane z = height (m) of the world, frame world.

        A point p of the leaning frame lies at c = M p + c0 in that plane: with a = M'd / |M'd| the support value of the
        cut in direction d is |M'd| h(a) + d'c0, h(a) that of the region. `proofs`: True turns twists and forces of the
        supports, too; else twists are NaN, forces stay in the leaning frame.
        """
        s, k = found.support, len(found.support.direction)
        plane = Plane(self.to_world(), self.at_height(np.zeros((1, 2)), height)[0])
        direction = solve(plane.matrix.T, s.direction.T).T  # rows d' = a'M^-1
        size = np.hypot(direction[:, 0], direction[:, 1])
        direction = direction / size[:, None]
        value = s.value / size + product(direction, plane.zero)
        twist, force = np.full((k, 6), np.nan), s.force
        if proofs:
            twist = np.array([self._twist(s.twist[i], s.direction[i]) for i in range(k)]).reshape(k, 6)
            force = np.array([product(f, self.rot) * (self.strength / GRAVITY) for f in s.force]).reshape(s.force.shape)
        support = Support(direction, value, self.at_height(s.point, height), s.status, s.gap / size, twist, force)
        return Region(
            found.contacts,
            found.status,
            self.at_height(found.inner, height),
            self.at_height(found.outer, height),
            support,
            found.gap / self.rot[2, 2],
            found.exact,
            found.calls,
            None if found.sinking is None else self._twist(found.sinking, np.zeros(2)),
            None if found.solved is None else replace(found.solved, plane=plane),
        )

    def _twist(self, twist: Array, a: Array) -> Array:
        """Return the twist (v m, Om), (6,), world axes, from a twist (v m, w_z), (4,), and direction a (2,), leaning.

        In the leaning frame the turn of the twist is (-a_y, a_x, w_z).
        """
        spin = np.array([-a[1], a[0], twist[3]])
        return np.concatenate((product(self.rot.T, twist[:3]), product(self.rot.T, spin)))


def lean(contacts: ContactSet, up: Array) -> Leaning:
    """Return a contact set turned so that `up` (3,), m/s^2 or any length but zero, frame world, points along z.

    Raises:
        StabilityError: `up` is zero (free fall), not finite, or lies in the horizontal plane.
    """
    strength = norm(up)
    if not np.isfinite(strength) or strength < 1e-9:
        raise StabilityError("zero_direction", "up", f"got {up.tolist()}, effective gravity needs a direction")
    z = up / strength
    if abs(z[2]) < 1e-6:
        raise StabilityError("zero_direction", "up", f"got {up.tolist()}, effective gravity must not be horizontal")
    x = np.array([1.0, 0.0, 0.0]) - z[0] * z
    if norm(x) < 1e-3:
        x = np.array([0.0, 1.0, 0.0]) - z[1] * z
    x /= norm(x)
    y = np.array([z[1] * x[2] - z[2] * x[1], z[2] * x[0] - z[0] * x[2], z[0] * x[1] - z[1] * x[0]])
    rot = np.vstack((x, y, z))
    turned = ContactSet(product(contacts.position, rot.T), product(contacts.normal, rot.T), contacts.mu)
    return Leaning(turned, rot, strength)


def leanings(mode: AtRest | Moving | Tilted, contacts: ContactSet) -> list[Leaning]:
    """Return the contact set in a frame along each gravity of a mode: leaning to eight sides (Tilted), then upright.

    The frame's z is against the effective gravity, gravity less the acceleration of the centre of mass.

    Raises:
        StabilityError: with the mode's acceleration the robot would fly.
    """
    if isinstance(mode, AtRest):
        return [Leaning(contacts, UPRIGHT, GRAVITY)]
    sides = np.empty((0, 3))
    if isinstance(mode, Tilted):
        phi = 2.0 * np.pi * np.arange(SIDES) / SIDES
        s, c = np.sin(mode.angle), np.cos(mode.angle)
        sides = np.column_stack((s * np.cos(phi), s * np.sin(phi), np.full(SIDES, c)))
    return [
        lean(contacts, stays_down(GRAVITY * g_up + mode.acceleration, mode.acceleration))
        for g_up in np.vstack((sides, [[0.0, 0.0, 1.0]]))
    ]


def stays_down(up: Array, acceleration: Array) -> Array:
    """Return `up`, the effective gravity reversed, (3,) m/s^2, frame world, if the robot stays on the ground.

    `acceleration` (3,) m/s^2 of the centre of mass is quoted in the refusal.

    Raises:
        StabilityError: with this acceleration the robot would fly: `up` hardly points up any more.
    """
    if up[2] < 0.01 * GRAVITY:
        raise StabilityError("too_large", "acceleration", f"got {acceleration.tolist()}, the robot would fly")
    return up


def _without_bounds(found: list[Region]) -> tuple[Array, Array, bool]:
    """Return the polygons inside and around what regions share, m, and True if it has no end on some side.

    found: some have no bound, none is infeasible; polygons (p, 2), (q, 2): empty where nothing is shared, or no end is.
    """
    nothing, within = np.empty((0, 2)), apart(found)
    if within > THIN:
        return nothing, nothing, False
    directions = equally_spaced(SHARED)
    order = np.argsort(np.arange(SHARED) % (SHARED // 4), kind="stable")  # first along the axes
    places = np.empty((SHARED, 2))
    for k in order:
        place = farthest(found, directions[k], within + 0.1 * MET)
        if place is None:
            return nothing, nothing, True
        places[k] = place
    inner = _thinned(hull(places))
    if len(inner) < 3:
        return inner, inner, False
    values = np.add.reduce(directions * places, axis=1)
    return inner, hull(half_planes(directions, values, 4.0 * float(np.abs(values).max()) + 1.0)), False


def _common(polygons: list[Array]) -> Array:
    """Return the intersection (e, 2) m of convex polygons, counter-clockwise; points and segments meet within 1 nm."""
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
        offsets.append(product(outward, corners.T).max(axis=1) + (MET if len(corners) < 3 else 0.0))
    a, b = np.concatenate(normals), np.concatenate(offsets)
    size = 4.0 * float(np.abs(b).max()) + 1.0
    return _thinned(hull(half_planes(np.ascontiguousarray(a), np.ascontiguousarray(b), size)))


def _thinned(polygon: Array) -> Array:
    """Return a polygon (n, 2) m; its ends (2, 2) if it is narrower than 1e-7 m, its middle (1, 2) if also shorter."""
    if len(polygon) < 2:
        return polygon
    span = polygon[:, None] - polygon[None]
    far = np.hypot(span[..., 0], span[..., 1])
    i, j = np.unravel_index(int(far.argmax()), far.shape)
    if far[i, j] <= THIN:
        return polygon.mean(axis=0)[None]
    across = (span[:, j, 0] * span[i, j, 1] - span[:, j, 1] * span[i, j, 0]) / far[i, j]
    return polygon[[i, j]] if across.max() - across.min() <= THIN else polygon
