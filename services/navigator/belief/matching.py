"""Data association: the landmark of the map that each detection of a frame shows.

Gate by the covariance of the pose, nearest descriptor with ratio test within the gate, two-point rigid motions
(RANSAC), a maximum per frame (Osswald et al., section III; their sizes are not printed, these are ours).
"""

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike

from surefoot.arrays import Array, Ints

from . import association
from .gate import FAR, UNLIKE, DetectionError, FrameTables, MatchLimits, SightNoise
from .landmarks import FloorLandmarks

MOST_DETECTIONS = 256
FATES = ("matched", "invalid", "far", "unlike", "ambiguous", "doubled", "outlier", "surplus")
"""Names of a detection's fates by number: matched; invalid range or bearing; far: no landmark in the gate; unlike: none
there is similar; ambiguous: two are; doubled: landmark matched by another detection; outlier to the common rigid
motion; surplus: beyond the maximum per frame."""


@dataclass(frozen=True, eq=False)
class Detections:
    """Landmarks that a camera recognised in one frame, seen from base_link in heading axes.

    Raises:
        DetectionError: shapes that do not fit each other, or more than 256 detections.
    """

    ranges: Array
    """Distances of the m detections from base_link along the floor, m, (m,)."""
    bearings: Array
    """Bearings of the m detections from the heading, rad, left positive, (m,)."""
    looks: Array
    """Descriptors (numbers that describe how a landmark looks) of the detections, (m, k), no unit."""

    def __post_init__(self) -> None:
        ranges, bearings = _floats(self.ranges), _floats(self.bearings)
        looks = _floats(self.looks)
        m = ranges.size
        if ranges.ndim != 1 or bearings.shape != ranges.shape or looks.ndim != 2 or looks.shape[0] != m:
            shapes = f"{ranges.shape}, {bearings.shape}, {looks.shape}"
            raise DetectionError("bad_detections", f"ranges, bearings, looks are (m,), (m,), (m, k), got {shapes}")
        if m > MOST_DETECTIONS:
            raise DetectionError("bad_detections", f"a frame has at most {MOST_DETECTIONS} detections, got {m}")
        object.__setattr__(self, "ranges", ranges)
        object.__setattr__(self, "bearings", bearings)
        object.__setattr__(self, "looks", looks)

    def __len__(self) -> int:
        return self.ranges.size

    @property
    def tables(self) -> FrameTables:
        """The detections as the arrays that kernels take."""
        return FrameTables(self.ranges, self.bearings, self.looks)


@dataclass(frozen=True, eq=False)
class Matches:
    """Result of matching the detections of one frame with the landmarks of a map."""

    detections: Ints
    """Indices in the frame of the matched detections, most similar to their landmark first, (k,)."""
    landmarks: Ints
    """Index in the map of the landmark of each matched detection, (k,)."""
    nis: Array
    """Normalised innovation squared of each match under the believed pose, 2 degrees of freedom, (k,)."""
    fates: Ints
    """Fate of every detection, index of `FATES`, (m,)."""
    counts: dict[str, int] = field(default_factory=dict[str, int])
    """Number of detections of the frame by name of their fate."""


def match(
    mean: Array,
    cov: Array,
    seen: Detections,
    world: FloorLandmarks,
    noise: SightNoise,
    limits: MatchLimits | None = None,
    seed: int = 0,
) -> Matches:
    """Associate the detections of one frame with the landmarks of a map.

    Args:
        mean: believed x, y (m, frame map) and heading (rad), (3,) or longer.
        cov: covariance of `mean`, (3, 3) or larger.
        seen: detections of the frame.
        world: landmarks.
        noise: standard deviations of range, bearing and descriptor.
        limits: None = the defaults of `MatchLimits`.
        seed: seed of the random pairs, which are drawn where there are more than `limits.pairs`.

    Raises:
        DetectionError: descriptors of another length than the map's.
    """
    limits = limits or MatchLimits()
    check_length(seen, world)
    fates, kept = association.match(
        np.ascontiguousarray(mean, dtype=np.float64), np.ascontiguousarray(cov, dtype=np.float64), seen.tables,
        world.tables, noise, limits, seed,
    )  # fmt: skip
    counts = np.bincount(fates.fate, minlength=len(FATES)).tolist()
    return Matches(kept, fates.landmark[kept], fates.nis[kept], fates.fate, dict(zip(FATES, counts, strict=True)))


def check_length(seen: Detections, world: FloorLandmarks) -> None:
    """Raise DetectionError for descriptors of another length than the map's; an empty set passes."""
    if len(seen) and seen.looks.shape[1] != world.descriptor_length:
        text = f"the map's descriptors have {world.descriptor_length} numbers, got {seen.looks.shape[1]}"
        raise DetectionError("bad_descriptor", text, "descriptor")


def look_alikes(matches: Matches, seen: Detections, world: FloorLandmarks, noise: SightNoise) -> Array:
    """Return for each of m detections the number of landmarks anywhere in the map that have a similar descriptor, (m,).

    It is at least 1 but where the gate holds no landmark or none that looks like the detection. The limit of likeness
    is that of the default `MatchLimits`.

    Args:
        matches: fates of the detections at the believed pose.
        seen: the m detections.
        world: landmarks of the map.
        noise: noise of the camera; only that of the descriptors counts.
    """
    look = MatchLimits().look(noise, world.descriptor_length)
    found = association.look_alikes(seen.looks, world.columns, look).astype(np.float64)
    here = (matches.fates != FAR) & (matches.fates != UNLIKE)
    return np.where(here, np.maximum(found, 1.0), found)


def gate_areas(cov: Array, seen: Detections, noise: SightNoise) -> Array:
    """Return the approximate area of floor that the gate of each detection covers, (m,) m^2.

    Args:
        cov: covariance of believed x, y (m) and heading (rad), (3, 3) or larger.
        seen: the m detections.
        noise: standard deviations of range and bearing.
    """
    r, own = seen.ranges, noise.range_sd**2 + (noise.range_share * seen.ranges) ** 2
    position = 0.5 * (cov[0, 0] + cov[1, 1])
    along = own + noise.common_range_sd**2 + position
    across = r * r * (noise.bearing_sd**2 + noise.common_bearing_sd**2 + cov[2, 2]) + position
    return math.pi * MatchLimits().gate * np.sqrt(along * across)


def _floats(values: ArrayLike) -> Array:
    return np.ascontiguousarray(values, dtype=np.float64)
