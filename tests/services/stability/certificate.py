"""Checks of an answer that trust nothing but the contacts: what a client can do with the proof it gets.

A rigid twist u(r) = v + Om x r with n'u >= mu |u_t| at every contact does work >= 0 against every force the contacts
can exert. With Om = w_z e_z - a x e_z and forces that balance the weight at a CoM c this reads 0 <= v_z - a'c.
"""

import numpy as np

from surefoot.arrays import Array
from surefoot.services.stability.programs.contacts import ContactSet


def twist_velocity(twist: Array, direction: Array, position: Array) -> Array:
    """u(r) = v + (w_z e_z - a x e_z) x r at positions (n, 3), for twist = (v, w_z) and direction a (2,)."""
    spin = np.array([-direction[1], direction[0], twist[3]])
    return twist[:3] + np.cross(spin, position)


def twist_violation(contacts: ContactSet, twist: Array, direction: Array) -> float:
    """Largest mu |u_t| - n'u over the contacts, divided by sqrt(1 + mu^2): <= 0 means that a'c <= v_z is proved."""
    u = twist_velocity(np.asarray(twist), np.asarray(direction), contacts.position)
    normal = np.einsum("ij,ij->i", contacts.normal, u)
    tangential = np.linalg.norm(u - normal[:, None] * contacts.normal, axis=1)
    finite = np.isfinite(contacts.mu)
    mu = np.where(finite, contacts.mu, 0.0)
    limited = (mu * tangential - normal) / np.hypot(1.0, mu)
    return float(np.max(np.where(finite, limited, np.maximum(tangential, -normal)), initial=-np.inf))


def force_violation(contacts: ContactSet, force: Array) -> float:
    """Largest |f_t| - mu n'f over the contacts (mu unlimited: -n'f), in units of the weight."""
    normal = np.einsum("ij,ij->i", contacts.normal, force)
    tangential = np.linalg.norm(force - normal[:, None] * contacts.normal, axis=1)
    finite = np.isfinite(contacts.mu)
    mu = np.where(finite, contacts.mu, 0.0)
    excess = np.where(finite, (tangential - mu * normal) / np.hypot(1.0, mu), -normal)
    return float(np.max(excess, initial=-np.inf))


def balance(contacts: ContactSet, force: Array, com: Array, weight: float = 1.0) -> float:
    """Largest residual of (20) and (21) with weight 1: sum f = e_z, sum r x f = c x e_z.

    weight 0: forces that hold nothing (a ray); then the moment equals com x e_z with com the shift per unit of force.
    """
    forces = force.sum(axis=0) - np.array([0.0, 0.0, weight])
    moment = np.cross(contacts.position, force).sum(axis=0) - np.array([com[1], -com[0], 0.0])
    return float(max(np.abs(forces).max(), np.abs(moment).max()))
