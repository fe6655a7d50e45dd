"""Proofs of a static margin, checked without a solver and without the code that found them.

Forces prove that a centre of mass is held: each in its friction cone, |f_t| <= mu n'f, together of weight 1 and of its
moment, sum f = e_z and sum r x f = c x e_z. Twists prove that one is not held: a rigid u(r) = v + Om x r with
Om = w_z e_z - a x e_z and n'u >= mu |u_t| at every contact does no work against any force of the contacts, so that
a'c <= v_z (Farkas' lemma for cones; Bretl & Lall, IEEE T-RO 2008). Lengths in m, forces in units of the weight.
"""

import math
from collections.abc import Sequence

import numpy as np

from surefoot.arrays import Array

EXACT = 1e-6
"""Tolerance of a proof, m or weights: residual of its equations and friction cones up to which these count as met."""


def tangential(vectors: Array, normals: Array) -> tuple[Array, Array]:
    """Return the components of vectors along unit normals, (n,), and the lengths of their tangential parts, (n,).

    `vectors`, `normals`: (n, 3) each, in the same axes; the unit is that of `vectors`.
    """
    along = (vectors * normals).sum(axis=1)
    return along, np.sqrt(((vectors - along[:, None] * normals) ** 2).sum(axis=1))


def holds(points: Array, normals: Array, mu: float, forces: Array, com: Array) -> bool:
    """Return True if contact forces prove static equilibrium of a robot with its centre of mass at `com`, else False.

    Args:
        points: contacts, (n, 3) m, z up.
        normals: unit normals of the ground, (n, 3).
        mu: friction coefficient.
        forces: forces of the ground on the robot, (n, 3), in units of the weight.
        com: x, y of the centre of mass, (2,) m.
    """
    along, across = tangential(forces, normals)
    if (across > mu * along + EXACT).any():
        return False
    balance = forces.sum(axis=0) - (0.0, 0.0, 1.0)
    moment = np.cross(points, forces).sum(axis=0) - (com[1], -com[0], 0.0)
    return bool(max(np.abs(balance).max(), np.abs(moment).max()) <= EXACT)


def bounds(points: Array, normals: Array, mu: float, twist: Array, direction: Array) -> float:
    """Return the bound h, m, for which a twist proves a'c <= h for the CoM c in equilibrium; inf = no proof.

    Args:
        points: contact points, (n, 3) m, z up.
        normals: unit normals of the ground, (n, 3).
        mu: friction coefficient.
        twist: (v_x, v_y, v_z, w_z), (4,), v in m.
        direction: horizontal unit vector a, (2,).
    """
    spin = np.array([-direction[1], direction[0], twist[3]])
    along, across = tangential(twist[:3] + np.cross(spin, points), normals)
    return float(twist[2]) if (along >= mu * across - EXACT).all() else math.inf


def inside(held: Sequence[Array], com: Array) -> float:
    """Return the distance, m, of a CoM `com` (2,) m from the edge of the convex hull of points `held` (n, 2) m.

    `held`: places of the CoM proved to be in equilibrium. The stability region is convex, so the hull lies in it and
    the distance is a proved margin. -inf = the CoM is not inside of the hull.
    """
    rows = np.array(sorted({(float(x), float(y)) for x, y in held}))
    if len(rows) < 3:
        return -math.inf
    closest = math.inf
    for p in rows:  # an edge of the hull has all points on its left
        for q in rows:
            edge = q - p
            length = math.hypot(*edge)
            if length < EXACT:
                continue
            left = (edge[0] * (rows[:, 1] - p[1]) - edge[1] * (rows[:, 0] - p[0])) / length
            if (left >= -EXACT).all():
                closest = min(closest, (edge[0] * (com[1] - p[1]) - edge[1] * (com[0] - p[0])) / length)
    return closest if 0.0 <= closest < math.inf else -math.inf
