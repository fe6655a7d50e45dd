"""Floors for the study of lost robots: landmarks of a corridor, holes, repetitions, maps that do not fit."""

from dataclasses import dataclass

import numpy as np

from surefoot.arrays import Array

LOW, HIGH = (-1.0, -1.0), (6.5, 1.0)
"""`LOW`, `HIGH`: corners of the corridor with the least and the largest coordinates, (x, y) m, map frame."""
MIDDLE = 0.5 * (np.array(LOW) + np.array(HIGH))
"""Centre of the corridor, (x, y) m, map frame."""


@dataclass(frozen=True)
class World:
    """Conditions of the study.

    Attributes:
        density: landmarks per m2.
        copied: share of landmarks that look like nine others.
        camera: easy (10 frames a second, odometry) or hard (one frame in 1.7 s, commands as control, drift).
        first: first seed.
        moved: share of landmarks that stand elsewhere than the map has them.
        hole: diameter of a disc in the middle without landmarks, into which robots are put down, m; 0 = there is none.
        twice: share of landmarks that stand twice, the floor turned by half about its middle.
        apart: distance from the ends of the corridor within which second ones look like no others, m.
    """

    density: float = 40.0
    copied: float = 0.5
    camera: str = "easy"
    first: int = 1000
    moved: float = 0.0
    hole: float = 0.0
    twice: float = 0.0
    apart: float = 0.0


def corridor(seed: int, density: float, copied: float, copies: int = 10) -> tuple[Array, Array]:
    """Return places (n, 2) m and descriptors (n, 8) of random landmarks; `copied` of them share theirs in groups.

    `density`: landmarks per m^2; `copied`: share, 0 to 1; `copies`: landmarks of a group.
    """
    rng = np.random.default_rng(seed)
    n = rng.poisson(density * (HIGH[0] - LOW[0]) * (HIGH[1] - LOW[1]))
    looks = rng.standard_normal((n, 8))
    looks /= np.linalg.norm(looks, axis=1, keepdims=True)
    many = int(copied * n)
    looks[:many] = looks[np.arange(many) // copies * copies]
    return rng.uniform(LOW, HIGH, (n, 2)), looks


def special(places: Array, looks: Array, world: World) -> tuple[Array, Array]:
    """Return places (m, 2) m and descriptors (m, 8) of a floor with a hole and with landmarks that stand twice.

    places, looks: landmarks of the plain floor, (n, 2) m and (n, 8), no unit.
    """
    twice = round(0.5 * world.twice * len(places))
    last = len(places) - twice
    places = np.vstack((places[:last], 2.0 * MIDDLE - places[:twice]))
    looks = np.vstack((looks[:last], looks[:twice]))
    far = np.flatnonzero(np.abs(places[:, 0] - MIDDLE[0]) > 0.5 * (HIGH[0] - LOW[0]) - world.apart)
    far = far[far >= last]
    own = np.random.default_rng(len(places)).standard_normal((far.size, looks.shape[1]))
    looks[far] = own / np.linalg.norm(own, axis=1, keepdims=True)
    keep = np.hypot(*(places - MIDDLE).T) >= 0.5 * world.hole
    return places[keep], looks[keep]


def wrong_map(kind: str, places: Array, looks: Array, seed: int) -> tuple[Array, Array]:
    """Return places (n, 2) m and descriptors (n, 8) of a map that does not fit the floor of the given landmarks.

    `kind`: mirrored, shuffled (looks), stretched (by 15 %); any other is right.
    """
    if kind == "mirrored":
        return places * (1.0, -1.0), looks
    if kind == "shuffled":
        return places, looks[np.random.default_rng(seed + 7).permutation(len(looks))]
    if kind == "stretched":
        return places * (1.15, 1.0), looks
    return places, looks
