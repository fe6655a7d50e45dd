"""Programs over the contact forces of several regions at once, for regions of which some have no bound.

Each region has forces of its own, which hold the CoM at a place c_k. With a common place c, min t s.t. |c - c_k| <= t
is the distance by which the regions must widen to meet. With t given, max a'c is the support value of what they share.
"""

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from surefoot.arrays import Array
from surefoot.geometry.linear import dot, product

from ..programs.clarabel_tools import clarabel_and_sparse
from ..programs.contacts import StabilityError
from .model import Region

PLACE = np.eye(2, 3)  # the first unknowns: x, y of the common place and the distance t


class _Part(NamedTuple):
    """Unknowns of one region: places of the CoM are `place` unknowns + `zero`, with `balance` unknowns = `load`."""

    place: Array  # (2, u)
    zero: Array  # (2,) m
    balance: Array  # (m, u)
    load: Array  # (m,)
    cones: int  # second-order cones of three unknowns each; the unknowns after these are free
    weights: int  # unknowns that are not negative


def apart(regions: Sequence[Region], place: Array | None = None) -> float:
    """Return the distance from each of several regions within which one common place lies, at the least, m.

    Args:
        regions: none of them infeasible, in one frame.
        place: the common place, (2,) m; None = the best one.

    Raises:
        StabilityError: no_convergence, by field `contacts`.
    """
    parts = [_part(region) for region in regions]
    goal = np.array([0.0, 0.0, 1.0])
    fixed = (np.empty((0, 3)), np.empty(0)) if place is None else (PLACE, place)
    return max(0.0, float(_solved(parts, goal, *fixed)[2]))


def farthest(regions: Sequence[Region], direction: Array, within: float, start: Array | None = None) -> Array | None:
    """Return the farthest place (2,) m in a unit direction (2,) that all regions share; None: it has no end that way.

    Args:
        regions: none of them infeasible, in one frame.
        direction: the direction.
        within: distance from each region that counts as shared, m, at least that of `apart`.
        start: only places on the line through this one, (2,) m, along the direction; None = all.

    Raises:
        StabilityError: no_convergence, by field `contacts`.
    """
    goal, rows, values = np.array([-direction[0], -direction[1], 0.0]), np.eye(3)[2:], np.array([within])
    if start is not None:
        across = np.array([-direction[1], direction[0], 0.0])
        rows, values = np.vstack((rows, across)), np.append(values, dot(across[:2], start))
    found = _solved([_part(region) for region in regions], goal, rows, values)
    return found[:2] if math.isfinite(found[0]) else None


def _part(region: Region) -> _Part:
    """Return the unknowns of a region: forces in cone coordinates, or weights of the corners of an exact one."""
    s = region.solved
    if s is None:
        corners = len(region.inner)
        return _Part(region.inner.T, np.zeros(2), np.ones((1, corners)), np.ones(1), 0, corners)
    r, n = s.reduced, len(s.reduced.a)
    drift = np.empty((0, 2)) if s.drift is None else s.drift
    place = r.length * np.concatenate((r.h.reshape(3 * n, 2), drift)).T
    balance = np.concatenate((r.a.reshape(3 * n, -1), np.zeros((len(drift), r.a.shape[2])))).T
    zero = s.anchor
    if s.plane is not None:
        place, zero = product(s.plane.matrix, place), product(s.plane.matrix, zero) + s.plane.zero
    return _Part(place, zero, balance, r.c, n, 0)


def _solved(parts: Sequence[_Part], goal: Array, fixed: Array, values: Array) -> Array:
    """Return x, y of the common place and t, (3,) m, of least goal'(x, y, t); infinite if there is no least one.

    Rows of `fixed` (k, 3) times (x, y, t) are set to `values` (k,).

    Raises:
        StabilityError: no_convergence, by field `contacts`.
    """
    clarabel, sparse = clarabel_and_sparse()
    equal: list[list[Any]] = [[sparse.csc_matrix(fixed)] + [None] * len(parts)]
    signs, near = list[list[Any]](), list[list[Any]]()
    right, offset, cones = [values], list[Array](), list[Any]()
    for k, part in enumerate(parts):
        before, after = [None] * k, [None] * (len(parts) - k - 1)
        size = part.place.shape[1]
        equal.append([None, *before, sparse.csc_matrix(part.balance), *after])
        right.append(part.load)
        limited = part.weights or 3 * part.cones
        signs.append([None, *before, -sparse.eye(limited, size, format="csc"), *after])
        cones += [clarabel.SecondOrderConeT(3)] * part.cones
        cones += [clarabel.NonnegativeConeT(part.weights)] if part.weights else []
        shift = np.vstack((np.zeros(size), part.place))
        near.append([sparse.csc_matrix(-np.roll(np.eye(3), 1, axis=0)), *before, sparse.csc_matrix(shift), *after])
        offset += [np.zeros(1), -part.zero]
    balanced = np.concatenate(right)
    limits = np.concatenate([np.zeros(part.weights or 3 * part.cones) for part in parts])
    matrix = sparse.bmat([*equal, *signs, *near], format="csc")
    cones = [clarabel.ZeroConeT(len(balanced)), *cones, *[clarabel.SecondOrderConeT(3)] * len(parts)]
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = 1e-11
    unknowns = matrix.shape[1]
    cost = np.concatenate((goal, np.zeros(unknowns - 3)))
    b = np.concatenate((balanced, limits, *offset))
    found = clarabel.DefaultSolver(sparse.csc_matrix((unknowns, unknowns)), cost, matrix, b, cones, settings).solve()
    if "DualInfeasible" in str(found.status):
        return np.full(3, math.inf)
    if abs(float(found.obj_val) - float(found.obj_val_dual)) > 1e-7 or "Infeasible" in str(found.status):
        raise StabilityError("no_convergence", "contacts", f"clarabel ended with {found.status}")
    return np.array(found.x)[:3]
