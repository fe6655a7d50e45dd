"""Map of the features of a floor: position, descriptor, and number of images that showed each.

The file is a landmark map of the navigator (`.npz`, places and descriptors) with further arrays. The navigator
identifies a landmark by its *code*, a unit vector drawn at random from the place of the feature, so that equal maps
have equal codes; a recognised feature is published with exactly this code.
"""

import hashlib
import zipfile
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from surefoot.arrays import Array
from surefoot.disk import regular_size
from surefoot.errors import Refusal
from surefoot.npz import BROKEN_NPZ, damage_of

from .features import KINDS, MOST_COMPARED, Kind, distances, nothing

SCHEMA, CONTENT = "surefoot.landmarks/1", "surefoot.features/1"
CODE = 8
"""Length of the code (unit vector) by which the navigator identifies a landmark."""
SAME_PLACE = 0.03
"""Distance within which features of two maps with similar descriptors are merged into one, m."""
DENSITY_CELL = 0.25
"""Edge of the cells in which the density of features is limited, m."""
NUMBERS = {"positions": 2, "seen": 1, "sd": 1, "pixel": 0, "version": 0, "drift": 0}
"""Numeric arrays of a map file by name, each with its number of axes."""
PLACE_GRID = 1e-4
"""Step to which positions are rounded before a landmark's code is drawn from them, m."""


@dataclass(frozen=True, eq=False)
class FeatureMap:
    """Map of the features on the floor: positions, frame map, and descriptors; immutable."""

    kind: Kind
    positions: Array
    """Positions of the features on the floor, (n, 2) m, frame map."""
    descriptors: NDArray[Any]
    """Descriptors of the features, (n, 32) uint8 of ORB, (n, 128) float32 of SIFT."""
    seen: NDArray[np.int64]
    """Number of images in which each feature was found, (n,)."""
    sd: Array
    """Standard deviation of each feature's position along one axis relative to its neighbours, (n,) m."""
    pixel: float
    """Edge length on the floor of a pixel of the view from above in which the features were found, m."""
    camera: str
    """Width, height and focal length of the camera, in words."""
    version: int = 1
    source: str = ""
    opencv: str = ""
    """Version of OpenCV that made the descriptors."""
    drift: float = 0.0
    """Standard deviation of the position farthest off, relative to the first pose of the mapping walk, m; 0 = the poses
    were known. `sd` covers neighbouring positions."""

    def __len__(self) -> int:
        return len(self.positions)

    @property
    def codes(self) -> Array:
        """Unit vectors by which the navigator identifies the features, drawn at random from their positions, (n, 8)."""
        found = np.empty((len(self), CODE))
        for row, place in zip(found, np.rint(self.positions / PLACE_GRID).astype("<i8"), strict=True):
            seed = int.from_bytes(hashlib.sha256(place.tobytes()).digest()[:8], "little")
            row[:] = np.random.default_rng(seed).standard_normal(CODE)
        return found / np.sqrt(np.add.reduce(found * found, axis=1, keepdims=True))

    def chosen(self, which: NDArray[Any]) -> "FeatureMap":
        """Return the map reduced to some features, by index (k,) or flag (n,)."""
        return replace(
            self, positions=self.positions[which], descriptors=self.descriptors[which], seen=self.seen[which],
            sd=self.sd[which],
        )  # fmt: skip

    def pruned(self, least: int, per_m2: float) -> "FeatureMap":
        """Return the map of features seen in at least `least` images, the most seen up to about `per_m2` per m^2."""
        kept = np.flatnonzero(self.seen >= least)
        return self.chosen(kept[spread(self.positions[kept], self.seen[kept], per_m2)])


def spread(positions: Array, seen: NDArray[np.int64], per_m2: float) -> NDArray[np.int64]:
    """Return ascending indices, (k,), of the features to keep: in each square of 0.25 m those seen in most images.

    Args:
        positions: places of the features on the floor, (n, 2) m.
        seen: number of images in which each was seen, (n,).
        per_m2: largest density, features per m^2.
    """
    room: dict[tuple[int, int], int] = {}
    chosen: list[int] = []
    most = max(1, round(per_m2 * DENSITY_CELL * DENSITY_CELL))
    for i in np.lexsort((np.arange(len(seen)), -seen)).tolist():
        key = (int(positions[i, 0] // DENSITY_CELL), int(positions[i, 1] // DENSITY_CELL))
        if room.get(key, 0) < most:
            room[key] = room.get(key, 0) + 1
            chosen.append(i)
    return np.sort(np.array(chosen, dtype=np.int64))


def merged(a: FeatureMap, b: FeatureMap) -> FeatureMap:
    """Return the union of two maps of one frame; features within 3 cm with similar descriptors become one.

    Raises:
        Refusal: features of different kind or scale.
    """
    if a.kind != b.kind or a.pixel != b.pixel:
        text = f"{a.kind} at {a.pixel:g} m and {b.kind} at {b.pixel:g} m do not go together"
        raise Refusal("bad_map", f"maps of {text}", "kind")
    gap = b.positions[:, None] - a.positions[None]
    near = np.hypot(gap[..., 0], gap[..., 1]) <= SAME_PLACE
    look = np.where(near, distances(a.kind, b.descriptors, a.descriptors), np.inf)
    twin = look.argmin(axis=1) if len(a) else np.zeros(len(b), dtype=np.int64)
    same = look.min(axis=1, initial=np.inf) <= KINDS[a.kind].like
    seen, positions, sd = a.seen.copy(), a.positions.copy(), a.sd.copy()
    for i in np.flatnonzero(same):
        j, n, m = int(twin[i]), a.seen[twin[i]], b.seen[i]
        positions[j] += (b.positions[i] - a.positions[j]) * m / (n + m)
        seen[j] += m
        sd[j] = min(sd[j], b.sd[i])
    new = b.chosen(~same)
    return replace(
        a, positions=np.vstack((positions, new.positions)), descriptors=np.vstack((a.descriptors, new.descriptors)),
        seen=np.concatenate((seen, new.seen)), sd=np.concatenate((sd, new.sd)), version=max(a.version, b.version) + 1,
        drift=max(a.drift, b.drift),
        source=a.source if a.source == b.source else f"{a.source} and {b.source}",
    )  # fmt: skip


def save(world: FeatureMap, path: str | Path) -> Path:
    """Write a map of features, which is a landmark map of the navigator, too; return the path, which ends in `.npz`."""
    target = Path(path).with_suffix(".npz")
    with target.open("wb") as file:
        np.savez_compressed(
            file, allow_pickle=False, schema=np.asarray(SCHEMA), positions=world.positions, descriptors=world.codes,
            version=np.asarray(world.version), source=np.asarray(world.source), content=np.asarray(CONTENT),
            kind=np.asarray(world.kind), looks=world.descriptors, seen=world.seen, sd=world.sd,
            pixel=np.asarray(world.pixel), camera=np.asarray(world.camera), opencv=np.asarray(world.opencv),
            drift=np.asarray(world.drift),
        )  # fmt: skip
    return target


def has_features(path: str | Path) -> bool:
    """Return True if a file is a landmark map that holds features of images."""
    try:
        with zipfile.ZipFile(path) as archive:
            return "looks.npy" in archive.namelist()
    except (OSError, zipfile.BadZipFile):
        return False


def load(path: str | Path) -> FeatureMap:
    """Return the map of features of a file.

    Raises:
        Refusal: the file is missing, damaged, or no such map.
    """
    source = Path(path)
    names = ("content", "kind", "positions", "looks", "seen", "sd", "pixel", "camera", "version", "source", "opencv")
    try:
        regular_size(source)
        with source.open("rb") as file, np.load(file, allow_pickle=False) as archive:
            table: dict[str, Any] = {name: archive[name] for name in names}
            table["drift"] = archive.get("drift", 0.0)
    except OSError as error:
        raise Refusal("not_found", f"{source} cannot be read: {error.strerror or error}", "map") from None
    except KeyError:
        raise Refusal(
            "malformed", f"{source.name} is no map of features; surefoot map build makes one", "map"
        ) from None
    except BROKEN_NPZ:
        raise Refusal("malformed", f"{source.name} {damage_of(source)}", "map") from None
    return _checked(table, source.name)


def _checked(table: dict[str, Any], name: str) -> FeatureMap:
    kind = str(table["kind"])
    if str(table["content"]) != CONTENT or kind not in KINDS:
        text = f"{name} holds {str(table['content'])[:40]!r} of {kind[:20]!r}, allowed are {CONTENT!r} of "
        raise Refusal("malformed", text + ", ".join(KINDS), "map")
    for key, axes in NUMBERS.items():
        found = np.asarray(table[key])
        if found.ndim != axes or found.dtype.kind not in "fiu" or not np.isfinite(found).all():
            what = f"{found.dtype} of {found.ndim} axes" if found.ndim else repr(str(found)[:20])
            text = f"{name}: {key} is {what}, allowed are finite numbers of {axes} axes"
            raise Refusal("malformed", text, "map")
        if axes == 0 and found < 0:
            raise Refusal("malformed", f"{name}: {key} is {found}, allowed is >= 0", "map")
    n, looks = len(table["positions"]), table["looks"]
    shapes = (table["positions"].shape, looks.shape, table["seen"].shape, table["sd"].shape)
    if shapes != ((n, 2), (n, KINDS[cast(Kind, kind)].length), (n,), (n,)) or not 1 <= n <= MOST_COMPARED:
        raise Refusal("malformed", f"{name}: arrays of {shapes} do not make a map of {kind} features", "map")
    if looks.dtype != nothing(cast(Kind, kind)).descriptors.dtype:
        raise Refusal("malformed", f"{name}: descriptors of {looks.dtype} are none of {kind}", "map")
    return FeatureMap(
        cast(Kind, kind), table["positions"].astype(np.float64), looks, table["seen"].astype(np.int64),
        table["sd"].astype(np.float64), float(table["pixel"]), str(table["camera"]), int(table["version"]),
        str(table["source"]), str(table["opencv"]), float(table["drift"]),
    )  # fmt: skip
