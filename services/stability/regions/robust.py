"""Margins that allow for uncertain inputs, and their gradients."""

import math
from dataclasses import dataclass

import numpy as np

from ..programs.contacts import Array, ContactSet
from .equilibrium import equilibrium
from .margin import margin, nearest_edge
from .model import Support
from .region import region

INSIDE = 1e-6  # of the way to the middle of the region: forces are asked for so far inside the edge
FINEST = 1e-4  # rad; directions around the lowest ones are refined down to that
GRID, BASINS = 64, 8  # directions to begin with beside the normals of the edges; local minima that are looked into
TURN = 2.0 * math.pi


@dataclass(frozen=True, slots=True)
class Uncertainty:
    """Uncertainty of the inputs; standard deviations count `kappa` times, bounds fully."""

    com: Array
    """(2, 2) m^2, covariance of the CoM."""
    foot: Array
    """(n, 3, 3) m^2, covariance of each contact point."""
    friction: float = 0.0
    """Bound by which every coefficient may be less, no unit."""
    normal: float = 0.0
    """Bound by which every normal may be off, rad."""
    kappa: float = 3.0


@dataclass(frozen=True, slots=True)
class Gradient:
    """Gradient of the support value h(a) in one direction."""

    mu: Array
    """(n,) d h / d mu_i = - u_i'f_t,i / mu_i >= 0, m."""
    position: Array
    """(n, 3) d h / d r_i = Om x f_i, no unit."""


def gradient(contacts: ContactSet, support: Support, k: int) -> Gradient:
    """Gradient of the k-th support value, with the forces of its support point."""
    return _slope(contacts, support.twist[k], support.force[k], support.direction[k])


def _slope(contacts: ContactSet, twist: Array, force: Array, a: Array) -> Gradient:
    spin = np.array([-a[1], a[0], twist[3]])
    u = twist[:3] + np.cross(spin, contacts.position)
    tangential = force - np.einsum("ij,ij->i", contacts.normal, force)[:, None] * contacts.normal
    with np.errstate(divide="ignore", invalid="ignore"):
        by_mu = -np.einsum("ij,ij->i", u, tangential) / contacts.mu
    return Gradient(np.where(np.isfinite(by_mu), np.maximum(by_mu, 0.0), 0.0), np.cross(spin, force))


@dataclass(frozen=True, slots=True)
class RobustGradient:
    """Gradient of the signed margin of a CoM."""

    value: float
    """m, the margin."""
    com: Array
    """(2,) d margin / d com = - a, no unit."""
    mu: Array
    """(n,) m."""
    position: Array
    """(n, 3) no unit."""


def margin_gradient(contacts: ContactSet, com: Array) -> RobustGradient | None:
    """Gradient of the margin of a CoM (2,) m: that of h(a) in the direction of the nearest edge.

    The forces are those that hold the CoM at the nearest point of the edge: along a straight edge support points are
    not unique, and each foot counts by its lever. Where two edges are equally near there is only a one-sided slope.
    None when there is no region, or no edge.
    """
    found = region(contacts)
    here = margin(found, com)
    if here.value is None or found.status != "ok":
        return None
    a = nearest_edge(found.inner, com) if here.direction is None else here.direction
    answer = region(contacts, a[None]).support
    if answer.status[-1] != "ok":
        return None
    edge = com + here.value * a
    inside = found.inner.mean(axis=0) - edge
    held = equilibrium(contacts, edge + INSIDE * inside)
    if held.force is None:
        return None
    slope = _slope(contacts, answer.twist[-1], held.force, a)
    return RobustGradient(here.value, -a, slope.mu, slope.position)


def shrunk(contacts: ContactSet, friction: float, normal: float) -> ContactSet:
    """Contacts with the least friction the bounds allow: tan(atan(mu - friction) - normal), not below zero.

    A cone of half angle atan(mu) - eps about n lies in every cone of half angle atan(mu) about a normal within eps.
    """
    mu = np.maximum(contacts.mu - friction, 0.0)
    angle = np.maximum(np.arctan(mu) - normal, 0.0)
    return ContactSet(contacts.position, contacts.normal, np.tan(angle) if normal > 0.0 else mu)


def robust_margin(contacts: ContactSet, com: Array, unknown: Uncertainty) -> float | None:
    """min over a of h(a) - a'c - kappa sqrt(a'S a + sum (Om x f_i)'S_i (Om x f_i)), with the friction that is left.

    None when even the most cautious set has no region, or no edge.
    """
    careful = shrunk(contacts, unknown.friction, unknown.normal)
    found = region(careful)
    if found.status in ("infeasible", "unbounded"):
        return None
    along = np.roll(found.inner, -1, axis=0) - found.inner
    # h(a) - a'c has its minima at the normals of the edges, and the forces that give the slope jump there
    edges = (np.arctan2(-along[:, 0], along[:, 1])[:, None] + [-FINEST, 0.0, FINEST]).ravel()
    angles = np.unique(np.concatenate((edges % TURN, np.arange(GRID) * TURN / GRID)))
    value = _left(careful, _unit(angles), com, unknown)
    behind, ahead = np.roll(value, 1), np.roll(value, -1)
    lowest = np.flatnonzero((value <= behind) & (value <= ahead))
    best = float(value.min())
    for k in lowest[np.argsort(value[lowest])][:BASINS]:
        at, width, low = float(angles[k]), TURN / GRID, float(value[k])
        while width > FINEST:
            near = at + width * np.linspace(-1.0, 1.0, 17)
            tried = _left(careful, _unit(near), com, unknown)
            if tried.min() < low:
                low, at = float(tried.min()), float(near[int(tried.argmin())])
            width /= 8.0
        best = min(best, low)
    return best


def _unit(angles: Array) -> Array:
    return np.column_stack((np.cos(angles), np.sin(angles)))


def _left(contacts: ContactSet, directions: Array, com: Array, unknown: Uncertainty) -> Array:
    support = region(contacts, directions).support
    variance = np.einsum("ki,ij,kj->k", directions, unknown.com, directions)
    for k in range(len(directions)):
        slope = gradient(contacts, support, k).position
        variance[k] += np.einsum("ni,nij,nj->", slope, unknown.foot, slope)
    return support.value - directions @ com - unknown.kappa * np.sqrt(variance)
