"""Margins that allow for what is not known exactly, and their gradients (design note 2.11)."""

import math
from dataclasses import dataclass

import numpy as np

from services.stability.contacts import Array, ContactSet
from services.stability.margin import margin
from services.stability.oracle import Support
from services.stability.region import region

FINEST = 1e-4  # rad; directions around the best one are refined down to that


@dataclass(frozen=True, slots=True)
class Uncertainty:
    """What is not known exactly; standard deviations count `kappa` times, bounds fully."""

    com: Array
    """(2, 2) m^2, covariance of the CoM."""
    foot: Array
    """(n, 3, 3) m^2, covariance of each contact point."""
    friction: float = 0.0
    """Bound: every coefficient may be less by that, no unit."""
    normal: float = 0.0
    """Bound: every normal may be off by that, rad."""
    kappa: float = 3.0


@dataclass(frozen=True, slots=True)
class Gradient:
    """How h(a) in one direction changes, per unit."""

    mu: Array
    """(n,) d h / d mu_i = - u_i'f_t,i / mu_i >= 0, m."""
    position: Array
    """(n, 3) d h / d r_i = Om x f_i, no unit."""


def gradient(contacts: ContactSet, support: Support, k: int) -> Gradient:
    """Gradient of the k-th support value; of a margin when k is its direction (and - a for the CoM itself)."""
    twist, force, a = support.twist[k], support.force[k], support.direction[k]
    spin = np.array([-a[1], a[0], twist[3]])
    u = twist[:3] + np.cross(spin, contacts.position)
    tangential = force - np.einsum("ij,ij->i", contacts.normal, force)[:, None] * contacts.normal
    with np.errstate(divide="ignore", invalid="ignore"):
        by_mu = -np.einsum("ij,ij->i", u, tangential) / contacts.mu
    return Gradient(np.where(np.isfinite(by_mu), np.maximum(by_mu, 0.0), 0.0), np.cross(spin, force))


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
    start = margin(found, com)
    angles = 2.0 * np.pi * np.arange(64) / 64.0
    if start.direction is not None:
        angles = np.append(angles, math.atan2(start.direction[1], start.direction[0]))
    best, at, width = math.inf, 0.0, float(2.0 * np.pi / 64.0)
    while width > FINEST:
        directions = np.column_stack((np.cos(angles), np.sin(angles)))
        value = _left(careful, directions, com, unknown)
        k = int(np.argmin(value))
        if value[k] < best:
            best, at = float(value[k]), float(angles[k])
        angles, width = at + width * np.linspace(-1.0, 1.0, 17), width / 8.0
    return best


def _left(contacts: ContactSet, directions: Array, com: Array, unknown: Uncertainty) -> Array:
    support = region(contacts, directions).support
    variance = np.einsum("ki,ij,kj->k", directions, unknown.com, directions)
    for k in range(len(directions)):
        slope = gradient(contacts, support, k).position
        variance[k] += np.einsum("ni,nij,nj->", slope, unknown.foot, slope)
    return support.value - directions @ com - unknown.kappa * np.sqrt(variance)
