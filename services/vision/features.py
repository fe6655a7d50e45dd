"""Features of a picture: places and descriptors by ORB or SIFT, behind one interface."""

from dataclasses import dataclass
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from surefoot.arrays import Array
from surefoot.errors import Refusal

from .opencv import opencv

Kind = Literal["orb", "sift"]

MOST_COMPARED = 100_000
"""Largest number of features of a picture or a map; more are refused."""


class FoundFeatures(NamedTuple):
    """Features found in one picture of the floor."""

    pixels: Array
    """Positions of the features in the image, column and row, (n, 2) px."""
    descriptors: NDArray[Any]
    """Descriptors of the features, (n, 32) uint8 of ORB, (n, 128) float32 of SIFT."""


@dataclass(frozen=True)
class FeatureKind:
    """Kind of feature: length of its descriptor, and the distance up to which two descriptors are alike."""

    length: int
    """Number of elements of a descriptor of this kind."""
    like: float
    """Largest distance of two descriptors of one feature, no unit: differing bits (ORB), or Euclidean (SIFT)."""


KINDS: dict[Kind, FeatureKind] = {
    "orb": FeatureKind(32, 64.0),
    "sift": FeatureKind(128, 280.0),
}


class Extractor:
    """Detector of ORB or SIFT features in a picture.

    Args:
        kind: `orb` or `sift`.
        count: largest number of features of one picture; the strongest are kept.
        contrast: factor of OpenCV's default threshold for a feature: of contrast (SIFT), or of corners (ORB).
    """

    def __init__(self, kind: Kind, count: int, contrast: float = 0.5) -> None:
        cv2 = opencv()
        self.kind: Kind = kind
        if kind == "orb":
            threshold = max(1, round(20 * contrast))
            self._make = cv2.ORB_create(nfeatures=count, nlevels=3, edgeThreshold=16, fastThreshold=threshold)
        else:
            self._make = cv2.SIFT_create(nfeatures=count, contrastThreshold=0.04 * contrast)

    def find(self, picture: NDArray[np.uint8], mask: NDArray[np.uint8]) -> FoundFeatures:
        """Return the features of a picture (h, w), greys 0 to 255, where the mask (h, w) is not 0."""
        points, descriptors = self._make.detectAndCompute(picture, mask)
        if not points:
            return nothing(self.kind)
        return FoundFeatures(np.array([point.pt for point in points], dtype=np.float64), descriptors)


def nothing(kind: Kind) -> FoundFeatures:
    """Return an empty set of features of a kind (ORB or SIFT)."""
    return FoundFeatures(np.zeros((0, 2)), np.zeros((0, KINDS[kind].length), np.uint8 if kind == "orb" else np.float32))


def distances(kind: Kind, a: NDArray[Any], b: NDArray[Any]) -> Array:
    """Return the distance of every pair of descriptors, (n, m), no unit: bits that differ (orb), else Euclidean.

    `a` (n, d), `b` (m, d): bytes (orb), else float32.

    Raises:
        Refusal: more than 100 000 in `a` or `b`, or descriptors of different kinds.
    """
    if max(len(a), len(b)) > MOST_COMPARED:
        raise Refusal("too_many", f"at most {MOST_COMPARED} features are compared, got {max(len(a), len(b))}")
    if a.shape[1] != b.shape[1] or a.dtype != b.dtype:
        raise Refusal("bad_descriptor", f"descriptors of {a.shape[1]} {a.dtype} and {b.shape[1]} {b.dtype} differ")
    if not len(a) or not len(b):
        return np.zeros((len(a), len(b)))
    if kind == "orb":
        words = [np.ascontiguousarray(each).view(np.uint64) for each in (a, b)]
        bits = np.bitwise_count(words[0][:, None] ^ words[1][None])
        return np.add.reduce(bits, axis=2, dtype=np.float64)
    cv2 = opencv()
    products = np.asarray(cv2.gemm(a, b, 1.0, None, 0.0, flags=cv2.GEMM_2_T), dtype=np.float64)
    squares = [np.add.reduce(each.astype(np.float64) ** 2, axis=1) for each in (a, b)]
    return np.sqrt(np.maximum(squares[0][:, None] + squares[1][None] - 2.0 * products, 0.0))
