"""Data association: the landmark of the map that each detection of a frame shows.

Gate by the covariance of the pose, nearest descriptor with ratio test within the gate, two-point rigid motions
(RANSAC), a maximum per frame (Osswald et al., section III; their sizes are not printed, these are ours).
"""

import math
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from surefoot.arrays import Array
from surefoot.errors import Refusal

from . import association
from .gate import FAR, UNLIKE, FrameTables
from .landmarks import FloorLandmarks

Index = NDArray[np.int64]

MOST_DETECTIONS = 256
FATES = ("matched", "invalid", "far", "unlike", "ambiguous", "doubled", "outlier", "surplus")
"""Fates of a detection, in the order of the numbers in `gate`: matched; impossible range or bearing; no landmark in the
gate; none there looks like it; two there look like it; its landmark is matched by another detection; no rigid motion of
the others explains it; beyond the maximum per frame."""


class DetectionError(Refusal):
    """Detections that cannot be used; `field` names what is wrong with them."""


@dataclass(frozen=True)
class SightNoise:
    """Noise of a camera that measures range and bearing of landmarks on the floor; standard deviations.

    Raises:
        DetectionError: a number is negative or not finite, or a whole measurement has no noise.
    """

    range_sd: float = 0.0
    """Constant part of the range noise, m."""
    range_share: float = 0.03
    """Proportional part of the range noise, part of the range."""
    bearing_sd: float = math.radians(1.5)
    """Noise of the bearing, rad."""
    common_range_sd: float = 0.0
    """Range error common to all detections of a frame, m, such as by an unknown tilt."""
    common_bearing_sd: float = 0.0
    """Bearing error common to all detections of a frame, rad."""
    look_sd: float = 0.05
    """Noise of each element of a descriptor."""

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            if not (math.isfinite(value) and value >= 0.0):
                raise DetectionError("bad_noise", f"{name} is finite and >= 0, got {value!r}", name)
        if self.range_sd + self.range_share == 0.0 or self.bearing_sd == 0.0 or self.look_sd == 0.0:
            text = "range_sd or range_share, bearing_sd and look_sd are > 0"
            raise DetectionError("bad_noise", f"{text}, got {vars(self)}", "bearing_sd")

    def array(self) -> Array:
        """Return the standard deviations of range, m, its share of the range, of the bearing, rad, and in common, (5,).

        The last two are the deviations of range, m, and bearing, rad, that all detections of a frame have in common.
        """
        return np.array(
            [self.range_sd, self.range_share, self.bearing_sd, self.common_range_sd, self.common_bearing_sd]
        )

    def wider(self, factor: float) -> "SightNoise":
        """Return the noise with every deviation of range and bearing times a factor; that of descriptors stays."""
        return replace(
            self,
            range_sd=self.range_sd * factor,
            range_share=self.range_share * factor,
            bearing_sd=self.bearing_sd * factor,
            common_range_sd=self.common_range_sd * factor,
            common_bearing_sd=self.common_bearing_sd * factor,
        )


@dataclass(frozen=True)
class MatchLimits:
    """Limits within which a detection is matched with a landmark."""

    gate: float = 9.21
    """Largest normalised innovation squared, chi^2_2(.99)."""
    look_sds: float = 2.0
    """Descriptors of one landmark differ by less than this many times look_sd sqrt(k); 2 sqrt(8) passes 99.99 %."""
    ratio: float = 0.8
    """Largest distance to the nearest descriptor over that to the second nearest in the gate."""
    shortest: float = 0.02
    """Least range, m; nearer detections are invalid."""
    longest: float = 50.0
    """Largest range, m; farther detections are invalid."""
    spread: float = 1.3
    """Variance of a residual at the refined motion over that of a detection."""
    pairs: int = 190
    """Number of motions that are tried: all pairs of up to 20 matches."""
    most: int = 10
    """Largest number of matches of a frame."""

    def array(self, noise: SightNoise, length: int) -> Array:
        """Return gate, distance of descriptors, ratio, shortest and longest range (m), spread, pairs and matches, (8,).

        `noise` and the `length` of descriptors, in elements, give their largest distance.
        """
        look = self.look(noise, length)
        return np.array(
            [self.gate, look, self.ratio, self.shortest, self.longest, self.spread, self.pairs, self.most],
            dtype=np.float64,
        )

    def look(self, noise: SightNoise, length: int) -> float:
        """Return the largest distance, no unit, of two descriptors of one landmark with `length` elements."""
        return self.look_sds * noise.look_sd * math.sqrt(length)


@dataclass(frozen=True, eq=False)
class Detections:
    """Landmarks that a camera recognised in one frame, seen from base_link in heading axes.

    Raises:
        DetectionError: shapes that do not fit each other, or more than 256 detections.
    """

    ranges: Array
    """Distances along the floor, m, (m,)."""
    bearings: Array
    """Directions, rad, left positive, (m,)."""
    looks: Array
    """Descriptors of the detections, (m, k)."""

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

    detections: Index
    """Matched detections, those first that look most like their landmark, (k,)."""
    landmarks: Index
    """Landmark of each matched detection, (k,)."""
    nis: Array
    """Normalised innovation squared of each match by the gate's covariance, 2 degrees of freedom, (k,)."""
    fates: Index
    """Fate of every detection, index of `FATES`, (m,)."""
    counts: dict[str, int] = field(default_factory=dict[str, int])
    """Number of detections by fate."""


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
        cov: its covariance, (3, 3) or larger.
        seen: detections of the frame.
        world: landmarks.
        limits: None = the defaults of `MatchLimits`.
        seed: of the random pairs, which are drawn where there are more than `limits.pairs`.

    Raises:
        DetectionError: descriptors of another length than the map's.
    """
    limits = limits or MatchLimits()
    check_length(seen, world)
    fates, kept = association.match(
        np.ascontiguousarray(mean, dtype=np.float64), np.ascontiguousarray(cov, dtype=np.float64), seen.tables,
        world.tables, noise.array(), limits.array(noise, world.descriptor_length), seed,
    )  # fmt: skip
    counts = np.bincount(fates.fate, minlength=len(FATES)).tolist()
    return Matches(kept, fates.landmark[kept], fates.nis[kept], fates.fate, dict(zip(FATES, counts, strict=True)))


def check_length(seen: Detections, world: FloorLandmarks) -> None:
    """Refuse descriptors of another length than the map's (raises DetectionError); no detections have none."""
    if len(seen) and seen.looks.shape[1] != world.descriptor_length:
        text = f"the map's descriptors have {world.descriptor_length} numbers, got {seen.looks.shape[1]}"
        raise DetectionError("bad_descriptor", text, "descriptor")


def look_alikes(
    matches: Matches, seen: Detections, world: FloorLandmarks, noise: SightNoise, limits: MatchLimits | None = None
) -> Array:
    """Return the number of landmarks of the map that each detection looks like, (m,); at least 1 for a match.

    Args:
        matches: of the frame at the believed pose.
        seen: its detections.
        world: landmarks.
        limits: those of the match; None = the defaults of `MatchLimits`.
    """
    look = (limits or MatchLimits()).look(noise, world.descriptor_length)
    found = association.look_alikes(seen.looks, world.columns, look).astype(np.float64)
    here = (matches.fates != FAR) & (matches.fates != UNLIKE)
    return np.where(here, np.maximum(found, 1.0), found)


def gate_areas(cov: Array, seen: Detections, noise: SightNoise, limits: MatchLimits | None = None) -> Array:
    """Return the area of the floor that the gate of each detection covers, about, (m,) m^2; cov (3, 3) or larger."""
    r, own = seen.ranges, noise.range_sd**2 + (noise.range_share * seen.ranges) ** 2
    position = 0.5 * (cov[0, 0] + cov[1, 1])
    along = own + noise.common_range_sd**2 + position
    across = r * r * (noise.bearing_sd**2 + noise.common_bearing_sd**2 + cov[2, 2]) + position
    return math.pi * (limits or MatchLimits()).gate * np.sqrt(along * across)


def _floats(values: ArrayLike) -> Array:
    return np.ascontiguousarray(values, dtype=np.float64)
