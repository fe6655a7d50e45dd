"""Status and margin of many contact sets at once: what-if questions and batches, in one kernel and on all cores.

The kernel takes the ordinary sets, by the very functions that `region` and `margin` use, without the interpreter and
without its lock: sets on other threads, ticks on the main one. What it leaves (no friction or unlimited friction, and
what no solver settles at once) goes the long way. No set depends on another, so the answers do not depend on how many
threads share the work.
"""

import math
import os
import threading
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray

from surefoot.geometry.polygon import hull, signed_distance
from surefoot.kernels.jit import free_kernel, row_kernel

from ..programs.contacts import Array, ContactSet
from ..programs.directions import edge_normals
from ..programs.fan import ANSWER, APPROACH, Goal, explore, new_fan
from ..programs.interior import NO_PRIMAL
from ..programs.lanes import LANES
from ..programs.reduced import RANK, SMALL_MU, matrices
from . import flat
from .margin import MARGIN_DIRECTIONS, MARGIN_TOLERANCE, ON_EDGE, margin, settled
from .region import RegionStatus, region, wide
from .thin import POINT, WIDE, along, flat_ends, line_of

Ints = NDArray[np.int64]

STATUSES: tuple[RegionStatus, ...] = ("ok", "infeasible", "unbounded", "point", "segment")
_OK, _INFEASIBLE, _UNBOUNDED, _POINT, _SEGMENT = range(5)
_HARD = -1
COARSE = 1e6  # m; margins find their own directions, so the region need not be refined
SHARE = 64  # sets a thread takes at once
NICE = 5  # of the threads: ticks go first


@dataclass(frozen=True, slots=True)
class Variants:
    """Answers in the order of the sets."""

    status: Ints
    """(s,) index into STATUSES."""
    margin: Array
    """(s,) m, signed distance of the CoM to the edge; NaN: there is no region, or no edge."""

    @property
    def stable(self) -> NDArray[np.bool_]:
        """(s,) the region has an area and the CoM lies in it."""
        return (self.status == _OK) & (self.margin >= 0.0)


def assess(contacts: ContactSet, index: Ints, begin: Ints, com: Array, *, threads: int = 1) -> Variants:
    """Status and margin of many sets of contacts.

    Args:
        contacts: pool of any number of contacts that the sets share.
        index: (k,) contacts of all sets, one set after the other.
        begin: (s + 1,) where each set begins in `index`, and the end.
        com: (s, 2) m, one for each set.
        threads: how many share the work.
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
    """Report whether the kernel is there, so that an answer takes no longer than its sets do."""
    return bool(_assess.signatures)  # pyright: ignore[reportFunctionMemberAccess] - of numba's object


def be_nice() -> None:
    """Let the other threads of the process go first (Linux: niceness belongs to a thread)."""
    os.setpriority(os.PRIO_PROCESS, threading.get_native_id(), NICE)


def _share(contacts: ContactSet, index: Ints, begin: Ints, com: Array, first: int, last: int, out: Variants) -> None:
    _assess(contacts.position, contacts.normal, contacts.mu, index, begin, com, first, last, out.status, out.margin)
    for s in first + np.flatnonzero(out.status[first:last] == _HARD):
        chosen = index[begin[s] : begin[s + 1]]
        found = region(
            ContactSet(contacts.position[chosen], contacts.normal[chosen], contacts.mu[chosen]), tolerance=COARSE
        )
        value = margin(found, com[s]).value
        out.status[s], out.margin[s] = STATUSES.index(found.status), math.nan if value is None else value


@free_kernel
def _assess(
    position: Array,
    normal: Array,
    mu: Array,
    index: Ints,
    begin: Ints,
    com: Array,
    first: int,
    last: int,
    status: Ints,
    distance: Array,
) -> None:
    """Sets first .. last - 1; status _HARD where the kernel does not decide."""
    for s in range(first, last):
        n = begin[s + 1] - begin[s]
        p, v, m = np.empty((n, 3)), np.empty((n, 3)), np.empty(n)
        for i in range(n):
            k = index[begin[s] + i]
            m[i] = mu[k]
            for q in range(3):
                p[i, q], v[i, q] = position[k, q], normal[k, q]
        status[s], distance[s] = _one(p, v, m, com[s, 0], com[s, 1])


@row_kernel
def _one(position: Array, normal: Array, mu: Array, x: float, y: float) -> tuple[int, float]:
    """Status and margin of a set, as `region` and `margin` tell them."""
    n = mu.size
    if n == 0:
        return _INFEASIBLE, math.nan
    if n == 1:
        if not flat.holds(normal[0], mu[0]):
            return _INFEASIBLE, math.nan
        return _POINT, _from(position[:, :2].copy(), x, y)
    if n > 2:
        exact, _, _ = flat.plane(position, normal, mu)
        if exact:
            return _OK, _from(hull(position[:, :2].copy()), x, y)
    if not (mu.min() > SMALL_MU and mu.max() < math.inf):
        return _HARD, math.nan
    a, h, origin, length, spread = matrices(position, normal, mu)
    if spread <= RANK * length:
        return _HARD, math.nan
    on_line, line = line_of(position)
    begin = along(line) if on_line else edge_normals(position)
    count, c = begin.shape[0], np.array([0.0, 0.0, 1.0, 0.0])
    fan = new_fan(count + MARGIN_DIRECTIONS, n)
    fan.direction[:count] = begin
    px, py = (x - origin[0]) / length, (y - origin[1]) / length
    goal = Goal(ANSWER if on_line else APPROACH, MARGIN_TOLERANCE, px, py)
    count, fine, outlook = explore(a, h, c, fan, 0, count, goal, fan.value.size, LANES)
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
    """Verdict where not every direction has a value: nothing holds the weight, or the long way has to tell."""
    for k in range(status.size):
        if status[k] == NO_PRIMAL:
            return _INFEASIBLE, math.nan
    return _HARD, math.nan


@row_kernel
def _from(polygon: Array, x: float, y: float) -> float:
    value = signed_distance(polygon, x, y)
    return 0.0 if abs(value) < ON_EDGE else value
