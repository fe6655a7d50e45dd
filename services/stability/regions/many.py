"""Status and margin of many contact sets at once: what-if questions and batches, in one kernel and on all cores.

The kernel takes the ordinary sets, by the very functions that `region` and `margin` use, without the interpreter and
without its lock: sets on other threads, ticks on the main one. Sets that it leaves (no friction or unlimited friction,
and those that the solver does not settle at once) are solved by `region`. No set depends on another, so the answers do
not depend on how many threads share the work.
"""

import math
import os
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cache
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from surefoot.arrays import Array, Ints
from surefoot.background import be_nice
from surefoot.geometry.polygon import hull, signed_distance
from surefoot.kernels.jit import free_kernel, row_kernel

from ..programs.contacts import MAX_CONTACTS, MAX_COORDINATE, ContactSet, StabilityError, contact_set, within
from ..programs.fan import ANSWER, APPROACH, FanGoal, explore, new_fan, settled, wide
from ..programs.interior import NO_PRIMAL
from ..programs.lanes import LANES
from ..programs.outline import edge_normals
from ..programs.reduced import RANK, SMALL_MU, Reduced, matrices
from ..programs.reference import MARGIN_DIRECTIONS, MARGIN_TOLERANCE
from .careful import POINT, WIDE, along, flat_ends, holds, line_of
from .margin import ON_EDGE, margin
from .model import RegionStatus
from .region import plane, region

STATUSES: tuple[RegionStatus, ...] = ("ok", "infeasible", "unbounded", "point", "segment")
_OK, _INFEASIBLE, _UNBOUNDED, _POINT, _SEGMENT = range(5)
_HARD = -1
COARSE = 1e6  # m; margins find their own directions, so the region need not be refined
SHARE = 64  # sets a thread takes at once


@dataclass(frozen=True, slots=True)
class Variants:
    """Status and margin of each of several contact sets, in their order."""

    status: Ints
    """Status of each set as index into `STATUSES` (ok, infeasible, unbounded, point, segment), (s,)."""
    margin: Array
    """Signed distance of each CoM to its region's edge, (s,) m, positive inside; NaN: there is no region or edge."""

    @property
    def stable(self) -> NDArray[np.bool_]:
        """True for each set whose region has an area in which the CoM lies, (s,)."""
        return (self.status == _OK) & (self.margin >= 0.0)


def assess(contacts: ContactSet, index: Ints, begin: Ints, com: Array, *, threads: int = 1) -> Variants:
    """Return status and margin of many sets of contacts out of one pool.

    Args:
        contacts: the pool.
        index: indices in the pool of the contacts of all sets, one set after the other, (n,).
        begin: position in `index` at which each set begins, and the end, (k + 1,).
        com: centre of mass of each set, (k, 2) m.
        threads: number of threads that work at a time.

    Raises:
        StabilityError: no_convergence, by field `contacts`.
    """
    count = len(com)
    out = Variants(np.empty(count, dtype=np.int64), np.empty(count))
    shares = [(first, min(first + SHARE, count)) for first in range(0, count, SHARE)]
    if threads > 1 and len(shares) > 1:
        list(_pool(threads).map(lambda ends: _share(contacts, index, begin, com, ends[0], ends[1], out), shares))
    else:
        _share(contacts, index, begin, com, 0, count, out)
    return out


@cache
def _pool(threads: int) -> ThreadPoolExecutor:
    return ThreadPoolExecutor(threads, "stability", initializer=be_nice)


def loaded() -> bool:
    """Return True if the kernel of `assess` is compiled, so that a call does not wait for the compiler."""
    return bool(_assess.signatures)  # pyright: ignore[reportFunctionMemberAccess] - of numba's object


def _share(contacts: ContactSet, index: Ints, begin: Ints, com: Array, first: int, last: int, out: Variants) -> None:
    pool = Pool(contacts.position, contacts.normal, contacts.mu, index, begin, com)
    _assess(pool, first, last, out.status, out.margin)
    for s in first + np.flatnonzero(out.status[first:last] == _HARD):
        chosen = index[begin[s] : begin[s + 1]]
        found = region(
            ContactSet(contacts.position[chosen], contacts.normal[chosen], contacts.mu[chosen]), tolerance=COARSE
        )
        value = margin(found, com[s]).value
        out.status[s], out.margin[s] = STATUSES.index(found.status), math.nan if value is None else value


class Pool(NamedTuple):
    """Several sets of contacts out of one pool, as arrays for the kernel."""

    position: Array
    """Points of contact of the pool, (n, 3) m."""
    normal: Array
    """Unit normals of the contacts of the pool, from the ground towards the robot, (n, 3)."""
    mu: Array
    """Coefficients of static friction of the contacts of the pool, (n,)."""
    member: Ints
    """Indices in the pool of the contacts of all sets, one set after the other, (k,)."""
    begin: Ints
    """Position in `member` at which each set begins, and the end, (s + 1,)."""
    com: Array
    """Coordinates x, y of the CoM of each set, (s, 2) m."""


@free_kernel
def _assess(pool: Pool, first: int, last: int, status: Ints, distance: Array) -> None:
    """Write status and margin of sets first .. last - 1 of a pool, one number per set of the pool in both arrays.

    Status: index into STATUSES, or _HARD (-1) where the kernel gives up; margin in `distance`, m.
    """
    for s in range(first, last):
        n = pool.begin[s + 1] - pool.begin[s]
        p, v, m = np.empty((n, 3)), np.empty((n, 3)), np.empty(n)
        for i in range(n):
            k = pool.member[pool.begin[s] + i]
            m[i] = pool.mu[k]
            for q in range(3):
                p[i, q], v[i, q] = pool.position[k, q], pool.normal[k, q]
        status[s], distance[s] = _one(p, v, m, pool.com[s, 0], pool.com[s, 1])


@row_kernel
def _one(position: Array, normal: Array, mu: Array, x: float, y: float) -> tuple[int, float]:
    """Return status and margin (m) of a CoM at x, y over a set of n contacts, equal to those of `region` and `margin`.

    position (n, 3) m, unit normal (n, 3), friction mu (n,). Status: index into STATUSES, or _HARD (-1), not solved
    here.
    """
    n = mu.size
    if n == 0:
        return _INFEASIBLE, math.nan
    if n == 1:
        if not holds(normal[0], mu[0]):
            return _INFEASIBLE, math.nan
        return _POINT, _from(position[:, :2].copy(), x, y)
    if n > 2:
        exact, _, _ = plane(position, normal, mu)
        if exact:
            return _OK, _from(hull(position[:, :2].copy()), x, y)
    if not (mu.min() > SMALL_MU and mu.max() < math.inf):
        return _HARD, math.nan
    a, h, origin, length, spread = matrices(position, normal, mu)
    if spread <= RANK * length:
        return _HARD, math.nan
    on_line, line = line_of(position)
    begin = along(line) if on_line else edge_normals(hull(position[:, :2].copy()))
    count, r = begin.shape[0], Reduced(a, h, np.array([0.0, 0.0, 1.0, 0.0]), origin, length)
    fan = new_fan(count + MARGIN_DIRECTIONS, n)
    fan.direction[:count] = begin
    px, py = (x - origin[0]) / length, (y - origin[1]) / length
    goal = FanGoal(ANSWER if on_line else APPROACH, MARGIN_TOLERANCE, px, py)
    count, fine, outlook = explore(r, fan, 0, count, goal, fan.value.size, LANES)
    if not fine:
        return _without_end(fan.status[: begin.shape[0]])
    if on_line:
        kind, ends = flat_ends(fan)
        if kind == WIDE:
            return _HARD, math.nan
        for k in range(ends.shape[0]):
            ends[k, 0], ends[k, 1] = origin[0] + length * ends[k, 0], origin[1] + length * ends[k, 1]
        return _POINT if kind == POINT else _SEGMENT, _from(ends, x, y)
    if not wide(fan, begin.shape[0])[0]:
        return _HARD, math.nan
    if not settled(fan, count, outlook):
        return _HARD, math.nan
    return _OK, outlook.best * length


@row_kernel
def _without_end(status: Ints) -> tuple[int, float]:
    """Return status and margin (NaN) where not every direction has a value: infeasible, or _HARD, left to `region`.

    `status`: status of each direction, (k,): 0 failed, 1 solved, 2 no forces exist, 3 no bound.
    """
    for k in range(status.size):
        if status[k] == NO_PRIMAL:
            return _INFEASIBLE, math.nan
    return _HARD, math.nan


@row_kernel
def _from(polygon: Array, x: float, y: float) -> float:
    value = signed_distance(polygon, x, y)
    return 0.0 if abs(value) < ON_EDGE else value


@dataclass(frozen=True, slots=True)
class PackedSets:
    """Contact sets laid one after the other, each with its CoM."""

    contacts: ContactSet
    """Contacts of all sets, one set after the other."""
    begin: Ints
    """Index in `contacts` at which each set begins, and the end, (s + 1,)."""
    com: Array
    """Coordinates x, y of the CoM of each set, (s, 2) m."""


def pack(position: ArrayLike, normal: ArrayLike, mu: ArrayLike, counts: ArrayLike, com: ArrayLike) -> PackedSets:
    """Return many contact sets in one pool, checked and with unit normals.

    Args:
        position: contact points of all sets, one set after the other, (n, 3) m.
        normal: normals of the ground, (n, 3), any length but zero.
        mu: friction coefficients, (n,) or one for all; inf = unlimited friction.
        counts: number of contacts of each set, (s,).
        com: x, y of the CoM of each set, (s, 2) m.

    Raises:
        StabilityError: names the set and its contact, as in `sets.7.contacts.2.normal`.
    """
    c, each = np.array(com, dtype=np.float64).reshape(-1, 2), np.array(counts, dtype=np.int64).reshape(-1)
    begin = np.concatenate((np.zeros(1, dtype=np.int64), np.cumsum(each)))
    p = np.asarray(position, dtype=np.float64).reshape(-1, 3)
    if each.size != len(c) or begin[-1] != len(p) or (each < 0).any():
        raise StabilityError("shape", "counts", f"{each.size} counts of {begin[-1]} contacts, got {len(c)}, {len(p)}")
    for i in np.flatnonzero(each > MAX_CONTACTS):
        allowed = f"at most {MAX_CONTACTS} are allowed"
        raise StabilityError("too_many", f"sets.{i}.contacts", f"got {each[i]} contacts, {allowed}")
    for i in np.flatnonzero(~np.isfinite(c).all(axis=1)):
        raise StabilityError("not_finite", f"sets.{i}.com", f"got {c[i].tolist()}, must be finite")
    if not (np.abs(c) <= MAX_COORDINATE).all():
        for i, place in enumerate(c):
            within(place, f"sets.{i}.com")
    try:
        return PackedSets(contact_set(p, normal, mu, limit=len(p)), begin, c)
    except StabilityError as error:
        raise StabilityError(error.code, _place(error.field, begin), error.message) from None


def _place(field: str, begin: Ints) -> str:
    """Return the field of one set for a field of the pool: `contacts.17.normal` becomes `sets.3.contacts.2.normal`.

    `begin`: first contact of each set in the pool, and their number at the end, (sets + 1,).
    """
    parts = field.split(".")
    if len(parts) < 2:
        return field
    k = int(parts[1])
    s = int(np.searchsorted(begin, k, side="right")) - 1
    return ".".join((f"sets.{s}.contacts", str(k - int(begin[s])), *parts[2:]))


def batch(sets: PackedSets, threads: int | None = None) -> Variants:
    """Return status and margin of every set, on all cores or on `threads` of them.

    The answers do not depend on the number of threads.
    """
    index = np.arange(len(sets.contacts))
    return assess(sets.contacts, index, sets.begin, sets.com, threads=threads or os.cpu_count() or 1)


def what_if(contacts: ContactSet, com: Array, candidates: ContactSet | None = None) -> Variants:
    """Return status and margin of a set as it is, without each contact, and with each candidate added, in this order.

    Args:
        contacts: n contacts now.
        com: x, y of the CoM, (2,) m.
        candidates: m contacts of one more foot, each tried alone; None = none.
    """
    n, m, pool = len(contacts), 0, contacts
    if candidates is not None and len(candidates):
        m = len(candidates)
        pool = ContactSet(
            np.concatenate((contacts.position, candidates.position)),
            np.concatenate((contacts.normal, candidates.normal)),
            np.concatenate((contacts.mu, candidates.mu)),
        )
    all_of = np.arange(n)
    left = np.tile(all_of, (n, 1))[~np.eye(n, dtype=np.bool_)]
    more = np.column_stack((np.tile(all_of, (m, 1)), n + np.arange(m))).ravel()
    size = np.concatenate(([0, n], np.full(n, n - 1), np.full(m, n + 1)))
    return assess(pool, np.concatenate((all_of, left, more)), np.cumsum(size), np.tile(com, (1 + n + m, 1)))
