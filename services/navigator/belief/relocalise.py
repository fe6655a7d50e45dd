"""Relocalisation: the pose of a standing robot anywhere in the map by its camera, or the reason why there is none.

Sightings that look alike in several places (copied textures) do no harm: every place that explains the sightings gets
its evidence, and a pose is returned only if one place has nearly all of it; see `places`.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from .landmarks import FloorLandmarks
from .matching import Detections, MatchLimits, SightNoise, check_length
from .places import COV, EVIDENCE, EXPLAINED, Evidence, candidates, gather, search

Array = NDArray[np.float64]
Reason = Literal["", "unseen", "unknown", "ambiguous", "unsure"]
"""Reason for no pose. unseen: fewer than two sightings look like landmarks of the map; unknown: no place explains
them, or chance explains them as well; ambiguous: another place explains them as well; unsure: too few of them."""


@dataclass(frozen=True)
class Glance:
    """One frame of a robot that stands or turns on the spot."""

    seen: Detections
    """Detections of the frame."""
    pose: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Pose of base_link then, x, y (m) and heading (rad), in the frame whose pose is searched."""


@dataclass(frozen=True)
class RelocaliseLimits:
    """Conditions under which a pose is returned."""

    sure: float = 0.999
    """Least probability of the best place."""
    heading_sd: float = 0.15
    """Largest standard deviation of its heading, rad: one false sighting bends a looser one."""
    least: int = 3
    """Least number of sightings that the best place has to explain."""
    false: float = 0.1
    """Share of false detections."""
    elsewhere: float = 0.05
    """Probability, before anything was seen, that the robot is not on the map at all."""
    view: float = 0.8
    """Area that the camera overlooks, m^2."""
    ratio: float = 0.7
    """Distance of the descriptors to the most alike landmark over that to another candidate."""
    candidates: int = 24
    """Largest number of landmarks that a sighting may be; one that looks like more is left out."""
    sightings: int = 64
    """Largest number of sightings; those seen most often are used."""
    tries: int = 20_000
    """Largest number of poses that are tried; a search that reaches it returns no pose."""
    places: int = 16
    """Largest number of places that are compared."""


@dataclass(frozen=True, eq=False)
class Relocation:
    """Result of a relocalisation."""

    pose: tuple[float, float, float] | None
    """Pose of the reference frame, x, y in m and heading in rad, frame map; None = none is sure."""
    covariance: Array
    """Covariance of the best place, (3, 3), m and rad; zeros if there is none."""
    probability: float
    """Probability of the best place."""
    runner_up: float
    """Probability of the second best place."""
    reason: Reason
    """Reason why there is no pose; empty = there is one."""
    sightings: int
    """Number of different sightings that look like landmarks."""
    explained: int
    """Number of sightings that the best place explains."""
    best: tuple[float, float, float] | None = None
    """The best place, however unsure; for reports, not for use."""


def relocalise(
    glances: Sequence[Glance], world: FloorLandmarks, noise: SightNoise, limits: RelocaliseLimits | None = None
) -> Relocation:
    """Return the pose from which the camera sees the glances.

    Args:
        glances: frames of the standing robot, or of one that turned, each with its pose by odometry.
        world: landmarks.
        noise: of the camera.
        limits: None = the defaults of `RelocaliseLimits`.

    Raises:
        DetectionError: descriptors of another length than the map's.
    """
    limits = limits or RelocaliseLimits()
    for glance in glances:
        check_length(glance.seen, world)
    place, spread, looks, count, total = _sightings(glances, world, noise, limits)
    look = MatchLimits().look(noise, world.descriptor_length)
    starts, members = candidates(looks, world.columns, look, limits.ratio, limits.candidates)
    known = np.flatnonzero(np.diff(starts) > 0)
    if known.size < 2:
        return Relocation(None, np.zeros((3, 3)), 0.0, 0.0, "unseen", int(known.size), 0)
    false = np.where(count > 1, limits.false, max(limits.false, min(0.9, limits.false * total / len(count))))
    x0, y0, x1, y1 = world.bounds
    area = max((x1 - x0) * (y1 - y0), limits.view)
    places, tried = search(
        Evidence(place, spread, false, starts, members, world.positions, limits.view, area),
        limits.places,
        limits.tries,
    )
    return _decided(places, int(known.size), tried, noise, limits)


def _sightings(
    glances: Sequence[Glance], world: FloorLandmarks, noise: SightNoise, limits: RelocaliseLimits
) -> tuple[Array, Array, Array, NDArray[np.int64], int]:
    """Return place, covariance, descriptor and number of detections of each sighting, and of all detections."""
    k, parts = world.descriptor_length, [glance for glance in glances if len(glance.seen)]
    ranges = np.concatenate([np.zeros(0), *(g.seen.ranges for g in parts)])
    bearings = np.concatenate([np.zeros(0), *(g.seen.bearings for g in parts)])
    looks = np.concatenate([np.zeros((0, k)), *(g.seen.looks for g in parts)])
    poses = np.concatenate([np.zeros((0, 3)), *(np.tile(g.pose, (len(g.seen), 1)) for g in parts)])
    shortest, longest = MatchLimits().shortest, MatchLimits().longest
    good = np.isfinite(ranges) & np.isfinite(bearings) & np.isfinite(looks).all(axis=1) & np.isfinite(poses).all(axis=1)
    good &= (ranges >= shortest) & (ranges <= longest)
    look = MatchLimits().look(noise, k)
    own = noise.array()
    own[3:] = 0.0  # errors common to a frame do not average out: added below
    place, spread, mean, count = gather(
        ranges[good], bearings[good], looks[good], poses[good], own, look, 4 * limits.sightings
    )
    order = np.argsort(-count, kind="stable")[: limits.sightings]
    place, spread, mean, count = place[order], spread[order], mean[order], count[order]
    spread = spread / count[:, None]
    x, y = place[:, 0], place[:, 1]
    r2 = np.maximum(x * x + y * y, 1e-6)
    along, across = noise.common_range_sd**2 / r2, noise.common_bearing_sd**2
    spread[:, 0] += along * x * x + across * y * y
    spread[:, 1] += (along - across) * x * y
    spread[:, 2] += along * y * y + across * x * x
    return place, spread, mean, count, int(good.sum())


def _decided(places: Array, known: int, tried: int, noise: SightNoise, limits: RelocaliseLimits) -> Relocation:
    """Compare the places with each other and with chance."""
    places = places[np.isfinite(places[:, EVIDENCE])]
    if not len(places):
        return Relocation(None, np.zeros((3, 3)), 0.0, 0.0, "unknown", known, 0)
    order = np.argsort(-places[:, EVIDENCE], kind="stable")
    places = places[order]
    chance = math.log(limits.elsewhere)
    logs = [math.log1p(-limits.elsewhere) + float(value) for value in places[:, EVIDENCE]]
    top = max(chance, logs[0])
    weights = [math.exp(value - top) for value in logs]
    whole = sum(weights) + math.exp(chance - top)
    first, second = weights[0] / whole, weights[1] / whole if len(weights) > 1 else 0.0
    best = places[0]
    cov = best[COV:].reshape(3, 3).copy()
    cov[0, 0] += noise.common_range_sd**2
    cov[1, 1] += noise.common_range_sd**2
    cov[2, 2] += noise.common_bearing_sd**2
    pose = (float(best[0]), float(best[1]), float(best[2]))
    reason: Reason = ""
    if tried >= limits.tries:
        reason = "ambiguous"
    elif first < limits.sure or best[EXPLAINED] < limits.least or cov[2, 2] > limits.heading_sd**2:
        none = math.exp(chance - top) / whole
        reason = "ambiguous" if second > 0.5 * (1.0 - first) else "unknown" if none > first else "unsure"
    explained = int(best[EXPLAINED])
    return Relocation(None if reason else pose, cov, first, second, reason, known, explained, pose)
