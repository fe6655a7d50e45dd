"""Regions of contact sets that are not ordinary: no contact, walls, ceilings, no friction, no area, no solution.

`Oracle` returns support values of one contact set, with proof, in the frame of the request. It is the one place where
statuses are decided: kernel first, clarabel where the kernel gives up, and a set is called unbounded only if it can
carry the weight at all.
"""

import math
from functools import cached_property

import numpy as np

from surefoot.arrays import Array, Ints
from surefoot.geometry.linear import combined, dot, product
from surefoot.geometry.polygon import gap, hull
from surefoot.kernels.jit import row_kernel

from ..programs.contacts import ContactSet, StabilityError
from ..programs.fan import (
    ASKED,
    ENCLOSE,
    FEW,
    FEW_AT_ONCE,
    Fan,
    FanGoal,
    enclose,
    explore,
    insert,
    new_fan,
    wide,
)
from ..programs.interior import FAILED, NO_DUAL, NO_PRIMAL, SOLVED
from ..programs.lanes import LANES
from ..programs.reduced import CONE, THIN, Reduced, Subspace
from ..programs.reference import Reference
from .line import line_region
from .model import Region, Solved, Support, SupportStatus

STATUS: dict[int, SupportStatus] = {SOLVED: "ok", NO_DUAL: "unbounded", NO_PRIMAL: "infeasible"}
FLAT = 1e-9  # of a direction's effect on free forces; below it they do not carry the CoM
LINE, LEVEL = 1e-9, 1e-6  # of the length of a line: how far contacts may lie off it, and how steep it may be
WIDE, POINT, SEGMENT = 0, 1, 2
"""Shapes of a region: `WIDE`: with an area; `POINT`: a single point; `SEGMENT`: a line segment."""


class Oracle:
    """Support function h(a) of the region of one contact or more: how far the CoM may go in direction a."""

    def __init__(self, contacts: ContactSet, reduced: Reduced, subspace: Subspace | None) -> None:
        self.contacts, self.reduced, self.subspace = contacts, reduced, subspace

    @cached_property
    def _reference(self) -> Reference:
        return Reference(self.reduced.a, self.reduced.c)

    @cached_property
    def sinking(self) -> Array | None:
        """Twist (v, w_z), (4,), scaled lengths, v_z = -1: a proof that the set carries no weight; None if it does."""
        if self.subspace is not None and self.subspace.sinking is not None:
            return self.subspace.sinking
        fan = self.fan(np.zeros((1, 2)), 1)
        return self.twist(fan.unknown[0], np.zeros(2)) if fan.status[0] == NO_PRIMAL else None

    def drift(self, direction: Array) -> Array:
        """Return the gain along each direction of each tangential force that nothing limits, (k, 2 j), no unit.

        Where one is not 0 the region has no bound. `direction`: unit vectors, (k, 2); j contacts have unlimited
        friction; (k, 0) with ordinary friction.
        """
        if self.subspace is None:
            return np.zeros((len(direction), 0))
        return product(direction, self.subspace.drift.T)

    def fan(self, direction: Array, capacity: int) -> Fan:
        """Return the answers for unit directions `direction`, (k, 2), as a fan with room for `capacity` or more.

        Raises:
            StabilityError: `no_convergence`, by field `contacts`.
        """
        count = len(direction)
        fan = new_fan(max(capacity, count), len(self.contacts))
        fan.direction[:count] = direction
        self._answer(fan, count)
        return fan

    def _answer(self, fan: Fan, count: int) -> None:
        r = self.reduced
        if explore(r, fan, 0, count, ASKED, count, LANES)[1]:
            return
        insert(fan, 0, count)
        for k in np.flatnonzero(fan.status[:count] == FAILED):
            if self._reference.answer(r, fan, int(k)) == FAILED:
                raise StabilityError(
                    "no_convergence", "contacts", "neither solver found an answer for this contact set"
                )

    # -- back to the frame of the request -----------------------------------------------------------------------------

    @property
    def anchor(self) -> Array:
        """Origin of the scaled frame in the frame of the request, (2,) m: position = anchor + length * scaled."""
        r = self.reduced
        return r.origin[:2] if self.subspace is None else r.origin[:2] + r.length * self.subspace.point

    def support(self, fan: Fan, chosen: Ints) -> Support:
        """Return answers of a fan as support values in metres, frame of the request, for its directions `chosen` (k,).

        A direction is unbounded where tangential forces without limit move the CoM along it.
        """
        r, n = self.reduced, len(self.contacts)
        direction = fan.direction[chosen]
        drift = self.drift(direction)
        drifting = np.abs(drift).max(axis=1, initial=0.0) > FLAT
        status = np.where(drifting, NO_DUAL, fan.status[chosen])
        value, gap = np.full(len(chosen), np.nan), np.full(len(chosen), np.nan)
        point, twist = np.full((len(chosen), 2), np.nan), np.full((len(chosen), 4), np.nan)
        force = np.zeros((len(chosen), n, 3))
        for i, k in enumerate(chosen):
            if status[i] == SOLVED:
                scaled = self.twist(fan.unknown[k], direction[i])
                twist[i] = self.moved(scaled, direction[i])
                value[i] = twist[i, 2]
                point[i] = self.anchor + r.length * fan.point[k]
                gap[i] = value[i] - dot(direction[i], point[i])
                force[i] = self.forces(fan.force[k], 1.0)
            elif status[i] == NO_DUAL:
                free = drift[i] / dot(drift[i], drift[i]) if drifting[i] else None
                force[i] = self.forces(np.zeros((n, 3)) if drifting[i] else fan.force[k], 0.0, free) / r.length
        return Support(direction, value, point, tuple(STATUS[int(s)] for s in status), gap, twist, force)

    def twist(self, unknown: Array, direction: Array) -> Array:
        """Return the twist (v, w_z), (4,), in scaled lengths, of a solution of the reduced dual.

        Args:
            unknown: solution, (4,): coordinates of the twist in the subspace of the set.
            direction: unit vector that it was solved for, (2,); zeros for a proof that nothing carries the weight.
        """
        if self.subspace is None:
            return unknown
        return product(self.subspace.basis, unknown) + product(self.subspace.offset, direction)

    def moved(self, scaled: Array, direction: Array) -> Array:
        """Return a twist (v, w_z), (4,), of the scaled frame as (v m, w_z) about the origin of the request's frame.

        `direction`: unit vector (2,) to which the twist belongs, (-a_y, a_x) being its turn about x, y.
        """
        (x, y, z), s, w = self.reduced.origin, self.reduced.length, scaled[3]
        ax, ay = direction  # v' = v - Om x origin, Om = (-a_y, a_x, w)
        return np.array(
            [s * scaled[0] - ax * z + w * y, s * scaled[1] - w * x - ay * z, s * scaled[2] + ay * y + ax * x, w]
        )

    def forces(self, cone: Array, weight: float, free: Array | None = None) -> Array:
        """Return forces (n, 3) in the frame of the request, in units of the weight; free ones balance the rest.

        Args:
            cone: forces in cone coordinates (normal, two tangents), (n, 3), weight 1.
            weight: share of the weight that the forces carry: 1, or 0 for forces that only shift the CoM.
            free: further amplitudes of the free tangential forces (unlimited friction), (2 j,); None = none.
        """
        a = self.reduced.a
        s = self.subspace
        if s is None:
            return combined(a[:, :, :3], cone)
        own = s.columns
        force = combined(own[:, :, :3], cone)
        if s.free.size:
            rest = np.array([0.0, 0.0, weight, 0.0]) - combined(own, cone).sum(axis=0)
            amount = np.linalg.pinv(s.free, rcond=1e-10) @ rest
            if free is not None:
                amount = amount + free
            unlimited = np.flatnonzero(np.isinf(self.contacts.mu))
            directions = s.free[:3].T.reshape(-1, 2, 3)
            force[unlimited] += combined(directions, amount.reshape(-1, 2))
        return force


def careful(
    contacts: ContactSet, programs: tuple[Reduced, Subspace | None], first: Array, goal: FanGoal, limit: int, skip: int
) -> Region:
    """Return the region of a set of two contacts or more, in any position and with any friction.

    Args:
        contacts: n contacts.
        programs: cone programs of the contacts, and the subspace of their unknowns (None with ordinary friction).
        first: (k, 2) unit directions to begin with.
        goal: ENCLOSE to refine, else ANSWER.
        limit: most directions.
        skip: without refinement, number of directions whose support values are left out.

    Raises:
        StabilityError: no_convergence, by field `contacts`.
    """
    oracle, refine, r = Oracle(contacts, *programs), goal.kind == ENCLOSE, programs[0]
    if oracle.subspace is not None and oracle.subspace.sinking is not None:
        return infeasible(contacts, first[skip:], oracle.moved(oracle.subspace.sinking, np.zeros(2)))
    fan, count = oracle.fan(first, limit if refine else len(first)), len(first)
    status = fan.status[:count]
    complete = bool(np.all(status == SOLVED))
    has_area = complete and wide(fan, count)[0]
    drifting = np.abs(oracle.drift(first)).max(initial=0.0) > FLAT
    if np.any(status == NO_PRIMAL):
        k = int(np.flatnonzero(status == NO_PRIMAL)[0])
        twist = oracle.twist(fan.unknown[k], np.zeros(2))
        return infeasible(contacts, first[skip:], oracle.moved(twist, np.zeros(2)))
    if drifting or not complete:
        if oracle.sinking is not None:
            return infeasible(contacts, first[skip:], oracle.moved(oracle.sinking, np.zeros(2)))
        support = oracle.support(fan, np.arange(skip, count))
        everything = oracle.support(fan, np.arange(count))
        found = everything.point[np.array([s == "ok" for s in everything.status])]
        solved = Solved(r, fan, count, oracle.anchor, None if oracle.subspace is None else oracle.subspace.drift)
        region = Region(
            contacts, "unbounded", hull(found), np.empty((0, 2)), support, math.nan, False, count, None, solved
        )
        return region if oracle.subspace is None else _on_line(oracle, region, first[skip:])
    if not has_area:
        ends = _ends(oracle, fan, count)
        if ends is not None:
            polygon = oracle.anchor + r.length * ends
            support = oracle.support(fan, np.arange(skip, count))
            kind = "point" if len(ends) == 1 else "segment"
            return Region(contacts, kind, polygon, polygon, support, 0.0, True, count)
    count, _, height, inner, outer = enclose(r, fan, count, count, goal, limit, FEW_AT_ONCE if limit <= FEW else LANES)
    inner, outer = oracle.anchor + r.length * inner, oracle.anchor + r.length * outer
    widest = height * r.length if refine and height <= goal.tolerance else gap(inner, outer)
    support = oracle.support(fan, fan.order[:count] if refine else np.arange(skip, count))
    return Region(
        contacts, "ok", inner, outer, support, widest, False, count, None, Solved(r, fan, count, oracle.anchor)
    )


def _ends(oracle: Oracle, fan: Fan, count: int) -> Array | None:
    """Return the point (1, 2) or the ends (2, 2) of a region without area, scaled frame; None if it has an area.

    `fan`: answers in its first `count` directions.
    """
    points = fan.point[:count]
    span = points[:, None, :] - points[None, :, :]
    distance = np.hypot(span[..., 0], span[..., 1])
    size = float(distance.max())
    if size <= THIN:
        width = fan.value[:8] + fan.value[[4, 5, 6, 7, 0, 1, 2, 3]] if count >= 8 else np.full(1, np.inf)
        if width.max() <= THIN:
            return points.mean(axis=0, keepdims=True)
    found, line = line_of(oracle.contacts.position)
    if not found:
        i, j = np.unravel_index(int(distance.argmax()), distance.shape)
        line = span[i, j] / max(size, 1e-300)
    probe = oracle.fan(along(line), 4)
    kind, ends = flat_ends(probe)
    return ends if kind != WIDE else None


def _on_line(oracle: Oracle, region: Region, direction: Array) -> Region:
    """Return the region of contacts on one line with support values in unit directions (k, 2), else `region`."""
    found, line = line_of(oracle.contacts.position)
    if not found or not np.isinf(oracle.contacts.mu).any():
        return region
    ends = oracle.support(oracle.fan(along(line)[:2], 2), np.arange(2))
    some = oracle.fan(np.zeros((1, 2)), 1)
    place = oracle.anchor + oracle.reduced.length * some.point[0]
    return line_region(region, ends, (place, oracle.forces(some.force[0], 1.0)), direction)


def few(contacts: ContactSet, direction: Array) -> Region:
    """Return the region of no contact (empty), or of one: its own point if the vertical lies in its friction cone.

    `direction`: unit directions of the support values, (k, 2), frame of the contacts.
    """
    if len(contacts) == 0:
        return infeasible(contacts, direction, np.array([0.0, 0.0, -1.0, 0.0]))
    normal, mu, position = contacts.normal[0], float(contacts.mu[0]), contacts.position[0]
    if not holds(normal, mu):
        side = math.hypot(normal[0], normal[1])
        downhill = normal[2] * normal - np.array([0.0, 0.0, 1.0])
        ceiling = math.isinf(mu) or side == 0.0
        v = normal if ceiling else mu * normal + downhill / side
        return infeasible(contacts, direction, np.array([v[0], v[1], v[2], 0.0]))
    k = len(direction)
    spin = np.column_stack((-direction[:, 1], direction[:, 0], np.zeros(k)))
    twist = np.column_stack((np.cross(position, spin).astype(np.float64), np.zeros(k)))
    force = np.zeros((k, 1, 3))
    force[:, 0, 2] = 1.0
    point = np.tile(position[:2], (k, 1))
    support = Support(direction, product(direction, position[:2]), point, ("ok",) * k, np.zeros(k), twist, force)
    return Region(contacts, "point", position[None, :2].copy(), position[None, :2].copy(), support, 0.0, True, 0)


def infeasible(contacts: ContactSet, direction: Array, sinking: Array) -> Region:
    """Return the empty region of a set that carries no weight anywhere.

    Args:
        contacts: n contacts.
        direction: unit directions of the supports, (k, 2); their values are NaN.
        sinking: twist (v m, w_z), (4,), v_z < 0, that proves it; it is scaled to v_z = -1.
    """
    k, n = len(direction), len(contacts)
    nan = np.full(k, np.nan)
    support = Support(
        direction, nan, np.full((k, 2), np.nan), ("infeasible",) * k, nan, np.full((k, 4), np.nan), np.zeros((k, n, 3))
    )
    empty = np.empty((0, 2))
    return Region(contacts, "infeasible", empty, empty, support, math.nan, True, 0, sinking / abs(sinking[2]))


@row_kernel
def holds(normal: Array, mu: float) -> bool:
    """Return True if one contact carries the weight: the vertical lies in its cone, unit normal (3,), friction mu."""
    if math.isinf(mu):
        return normal[2] >= 0.0
    return normal[2] > 0.0 and mu * normal[2] >= math.hypot(normal[0], normal[1]) - CONE


@row_kernel
def line_of(position: Array) -> tuple[bool, Array]:
    """Return True if contacts (n, 3) m lie on one line, not vertical, and then its horizontal unit vector (2,)."""
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
    """Return four unit directions (4, 2): along a unit `line` (2,) and back, then across it to the left and right."""
    x, y = line[0], line[1]
    return np.array([[x, y], [-x, -y], [-y, x], [y, -x]])


@row_kernel
def flat_ends(probe: Fan) -> tuple[int, Array]:
    """Return the shape of a region (WIDE 0, POINT 1, SEGMENT 2) and its ends, from its supports along a line.

    `probe`: answers in four directions: along the line, back, and across it both ways. Ends are in scaled lengths: (0,
    2) for an area or no end, (1, 2) for a point, (2, 2) for a segment.
    """
    for k in range(4):
        if probe.status[k] != SOLVED:
            return WIDE, probe.point[:0]
    if probe.value[2] + probe.value[3] > THIN:
        return WIDE, probe.point[:0]
    if probe.value[0] + probe.value[1] <= THIN:
        return POINT, 0.5 * (probe.point[:1] + probe.point[1:2])
    return SEGMENT, probe.point[:2].copy()
