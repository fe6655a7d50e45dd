"""Margins that allow for uncertain inputs, and their gradients."""

import math
from dataclasses import dataclass

import numpy as np

from surefoot.arrays import Array

from ..programs.contacts import ContactSet
from .equilibrium import equilibrium
from .margin import Margin
from .model import Region, Support
from .region import region

INSIDE = 1e-6  # of the way to the middle of the region: forces are asked for so far inside the edge
FINEST = 1e-4  # rad; directions around the lowest ones are refined down to that
GRID, BASINS = 64, 8  # directions to begin with beside the normals of the edges; local minima that are looked into
TURN = 2.0 * math.pi


@dataclass(frozen=True, slots=True)
class Uncertainty:
    """Uncertainty of the inputs of a margin: covariances, whose standard deviations count `kappa` times, and bounds."""

    com: Array
    """Covariance of the position x, y of the CoM, (2, 2) m^2."""
    foot: Array
    """Covariance of the position of each contact point, (n, 3, 3) m^2."""
    friction: float = 0.0
    """Largest amount by which every friction coefficient may be below its stated value, no unit."""
    normal: float = 0.0
    """Largest angle between every true contact normal and its stated value, rad."""
    kappa: float = 3.0


@dataclass(frozen=True, slots=True)
class MarginSlope:
    """Gradient of the signed margin of a CoM by the CoM, the friction coefficients and the contact points."""

    com: Array
    """Derivative of the margin by the CoM, (2,), no unit: -a, a the outward unit normal of the nearest edge."""
    mu: Array
    """Derivative of the margin by the friction coefficient of each contact, (n,) m."""
    position: Array
    """Derivative of the margin by the position of each contact, (n, 3), m per m."""


def gradient(contacts: ContactSet, twist: Array, force: Array, a: Array) -> tuple[Array, Array]:
    """Return the gradient of the support value h(a) of a region in one direction a, by its certificate and its forces.

    Args:
        contacts: n contacts at r_i, friction coefficients mu_i.
        twist: (4,) certificate of the value: (v m, w_z), about the origin.
        force: (n, 3) forces f_i that hold the CoM at the support point, in units of the weight.
        a: unit direction, (2,).

    Returns:
        dh / dmu_i = - u_i'f_t,i / mu_i >= 0, (n,) m, and dh / dr_i = Om x f_i, (n, 3), no unit: Om = (-a_y, a_x, w_z),
        u_i = v + Om x r_i the velocity of the twist at contact i, f_t,i the tangential part of f_i.
    """
    spin = np.array([-a[1], a[0], twist[3]])
    u = twist[:3] + np.cross(spin, contacts.position)
    tangential = force - np.einsum("ij,ij->i", contacts.normal, force)[:, None] * contacts.normal
    with np.errstate(divide="ignore", invalid="ignore"):
        by_mu = -np.einsum("ij,ij->i", u, tangential) / contacts.mu
    return np.where(np.isfinite(by_mu), np.maximum(by_mu, 0.0), 0.0), np.cross(spin, force)


def margin_gradient(found: Region, com: Array, here: Margin) -> MarginSlope | None:
    """Return the gradient of the margin `here` of a CoM (2,) m: that of the support value towards the nearest edge.

    The forces are those that hold the CoM at the nearest point of the edge: along a straight edge support points are
    not unique, and each foot counts by its lever. Where two edges are equally near there is only a one-sided slope.
    None when the region has no area (or no bound), or no edge is near.
    """
    if here.value is None or found.status != "ok":
        return None
    contacts, a = found.contacts, _nearest_edge(found.inner, com) if here.direction is None else here.direction
    answer = _supports(contacts, a[None])
    if answer.status[-1] != "ok":
        return None
    edge = com + here.value * a
    inside = found.inner.mean(axis=0) - edge
    held = equilibrium(contacts, edge + INSIDE * inside)
    if held.force is None:
        return None
    return MarginSlope(-a, *gradient(contacts, answer.twist[-1], held.force, a))


def _nearest_edge(polygon: Array, point: Array) -> Array:
    """Return the unit direction (2,) from a point (2,) m inside a polygon (e, 2) m to its nearest edge.

    Outside of the polygon it is the direction from the nearest point of the edge to the point.
    """
    along = np.roll(polygon, -1, axis=0) - polygon
    out = np.column_stack((along[:, 1], -along[:, 0])) / np.hypot(along[:, 0], along[:, 1])[:, None]
    slack = np.add.reduce(out * (polygon - point), axis=1)
    if slack.min() >= 0.0:
        return out[int(slack.argmin())]
    share = np.clip(np.add.reduce((point - polygon) * along, axis=1) / np.add.reduce(along * along, axis=1), 0.0, 1.0)
    away = point - (polygon + share[:, None] * along)
    length = np.hypot(away[:, 0], away[:, 1])
    k = int(length.argmin())
    return away[k] / length[k]


def shrunk(contacts: ContactSet, friction: float, normal: float) -> ContactSet:
    """Return contacts with the least friction the bounds allow: tan(atan(mu - friction) - normal), not below zero.

    A cone of half angle atan(mu) - eps about n lies in every cone of half angle atan(mu) about a normal within eps.
    `friction`: bound of every coefficient, no unit; `normal`: bound of every normal, rad.
    """
    mu = np.maximum(contacts.mu - friction, 0.0)
    angle = np.maximum(np.arctan(mu) - normal, 0.0)
    return ContactSet(contacts.position, contacts.normal, np.tan(angle) if normal > 0.0 else mu)


def robust_margin(contacts: ContactSet, com: Array, unknown: Uncertainty) -> float | None:
    """Return the smallest margin of a CoM c, (2,) m, that is left with uncertain inputs, m, inside positive.

    It is min over unit a of h(a) - a'c - kappa sqrt(a'S a + sum (Om x f_i)'S_i (Om x f_i)), with the least friction of
    the bounds: h the support value, S and S_i the covariances of CoM and contact points, f_i the forces and Om the turn
    of the certificate of h(a). None when even the most cautious set has no region, or no edge.
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


def _supports(contacts: ContactSet, directions: Array) -> Support:
    """Return the support values of the region in unit directions (k, 2), with proof."""
    return region(contacts, directions).support


def _left(contacts: ContactSet, directions: Array, com: Array, unknown: Uncertainty) -> Array:
    support = _supports(contacts, directions)
    variance = np.einsum("ki,ij,kj->k", directions, unknown.com, directions)
    for k in range(len(directions)):
        _, slope = gradient(contacts, support.twist[k], support.force[k], directions[k])
        variance[k] += np.einsum("ni,nij,nj->", slope, unknown.foot, slope)
    return support.value - directions @ com - unknown.kappa * np.sqrt(variance)
