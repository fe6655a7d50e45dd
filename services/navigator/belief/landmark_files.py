"""Landmark maps in files: `.npz` without pickled objects."""

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from surefoot.disk import regular_size, whole
from surefoot.npz import BROKEN_NPZ, damage_of

from .landmarks import (
    LONGEST_DESCRIPTOR,
    MOST_LANDMARKS,
    FloorLandmarks,
    LandmarkMapError,
)

SCHEMA = "surefoot.landmarks/1"
MAX_ARCHIVE_BYTES = 256_000_000
MAX_UNPACKED_BYTES = 8 * MOST_LANDMARKS * (LONGEST_DESCRIPTOR + 3) + 100_000
KEYS = ("schema", "positions", "descriptors", "version", "source")
SD = "sd"
"""Key of the array of position standard deviations in a landmark file; a file without it states exact positions."""


def save(world: FloorLandmarks, path: str | Path) -> Path:
    """Write a landmark map atomically; return the path, which ends in `.npz`."""
    target = Path(path).with_suffix(".npz")
    with whole(target) as part, part.open("wb") as file:
        np.savez_compressed(
            file, allow_pickle=False, schema=np.asarray(SCHEMA), positions=world.positions,
            descriptors=world.descriptors, version=np.asarray(world.version), source=np.asarray(world.source),
            sd=world.sd,
        )  # fmt: skip
    return target


def load(path: str | Path) -> FloorLandmarks:
    """Return the landmark map of a file.

    Raises:
        LandmarkMapError: the file is missing, no landmark map, of another version, damaged, too large, or holds pickled
            objects; or its landmarks are too few, too many, not finite, or all in one point.
    """
    source = Path(path)
    try:
        size = regular_size(source)
        if size > MAX_ARCHIVE_BYTES:
            raise _malformed(source, f"has {size} bytes, allowed are {MAX_ARCHIVE_BYTES}")
        with source.open("rb") as file, np.load(file, allow_pickle=False) as archive:
            unpacked = sum(member.file_size for member in archive.zip.infolist())
            if unpacked > MAX_UNPACKED_BYTES:
                raise _malformed(source, f"unpacks to {unpacked} bytes, allowed are {MAX_UNPACKED_BYTES}")
            absent = [key for key in KEYS if key not in archive.files]
            if absent:
                raise _malformed(source, f"lacks {', '.join(absent)}; a landmark map has {', '.join(KEYS)}")
            arrays: dict[str, NDArray[Any]] = {key: archive[key] for key in (*KEYS, SD) if key in archive.files}
    except OSError as error:
        if error.strerror is None:
            raise _malformed(source, damage_of(source)) from None
        raise LandmarkMapError("not_found", f"{source} cannot be read: {error.strerror}", "file") from None
    except BROKEN_NPZ:
        raise _malformed(source, damage_of(source)) from None
    schema = str(arrays["schema"])
    if schema != SCHEMA:
        raise LandmarkMapError(
            "malformed", f"{source.name} has schema {schema[:64]!r}, this version reads {SCHEMA!r}", "schema"
        )
    for key in ("positions", "descriptors"):
        if arrays[key].dtype.kind != "f":
            raise LandmarkMapError("malformed", f"{source.name}: {key} are floats, got {arrays[key].dtype}", key)
    if arrays["version"].shape != () or arrays["version"].dtype.kind not in "iu":
        raise LandmarkMapError(
            "malformed", f"{source.name}: version is an integer, got {arrays['version']!r:.80}", "version"
        )
    sd = arrays.get(SD, np.zeros(0))
    if sd.dtype.kind != "f":
        raise LandmarkMapError("malformed", f"{source.name}: {SD} are floats, got {sd.dtype}", SD)
    return FloorLandmarks(arrays["positions"], arrays["descriptors"], int(arrays["version"]), str(arrays["source"]), sd)


def _malformed(path: Path, text: str) -> LandmarkMapError:
    return LandmarkMapError("malformed", f"{path.name} {text}", "file")
