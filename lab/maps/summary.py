"""Summary of a map file: its numbers, and problems that make it hard to use."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from surefoot.arguments import number
from surefoot.errors import InvalidField
from surefoot.services.navigator.belief import landmark_files
from surefoot.services.navigator.belief.landmarks import FloorLandmarks
from surefoot.services.navigator.planning import map_files, zone_files
from surefoot.services.navigator.planning.costs import WIDEST, Clearance, prepare
from surefoot.services.navigator.planning.grid import FREE, UNKNOWN, FloorGrid
from surefoot.services.navigator.planning.zones import KeptOut, Zones
from surefoot.services.vision.feature_map import has_features
from surefoot.services.vision.feature_map import load as load_features

ALIKE = 0.15
"""Descriptor distance, as a share of the median of all pairs, below which two landmarks count as too similar."""
FEW = 5.0
"""Density of landmarks, 1/m^2, below which a problem is reported: a standing robot seldom sees enough to localise."""


@dataclass(frozen=True)
class Summary:
    """Summary of a map file: facts by name, and problems in words."""

    facts: dict[str, Any]
    """Facts about the map by name, in the order shown."""
    problems: tuple[str, ...]
    """Problems of the map, in words; empty = none found."""


def summary_of(path: Path, radius: float = 0.15) -> Summary:
    """Return the summary of a landmark map (`.npz`), of a map of a map_server (its YAML), or of a file of zones.

    Keepout zones in the YAML count as obstacles of its regions.

    Args:
        path: the file.
        radius: radius of the robot that is to walk there, m.

    Raises:
        Refusal: the file cannot be used at all.
    """
    if path.suffix.lower() in (".yaml", ".yml"):
        zones = zone_files.load(path, required=False)
        if zones and "image" not in map_files.table_of(map_files.text_of(path), path):
            return Summary({"kind": "zones", **_zones(zones)}, ())
        found = _grid(map_files.load(path), zones, radius)
        return Summary(found.facts | (_zones(zones) if zones else {}), found.problems)
    found = _landmarks(landmark_files.load(path))
    if not has_features(path):
        return found
    world = load_features(path)
    more = {
        "features": world.kind, "seen_each": float(np.mean(world.seen)), "place_sd_m": float(np.mean(world.sd)),
        "drift_m": world.drift, "pixel_m": world.pixel, "camera": world.camera, "opencv": world.opencv,
    }  # fmt: skip
    return Summary(found.facts | more, found.problems)


def _landmarks(world: FloorLandmarks) -> Summary:
    x0, y0, x1, y1 = world.bounds
    area = (x1 - x0) * (y1 - y0)
    copies = copied(world)
    facts = {
        "kind": "landmarks", "landmarks": len(world), "descriptor_length": world.descriptor_length,
        "bounds_m": [x0, y0, x1, y1], "per_m2": len(world) / area if area else None, "look_like_another": copies,
        "version": world.version, "source": world.source, "sha256": world.sha256,
    }  # fmt: skip
    problems = []
    if copies > 0.9 * len(world):
        problems.append(f"{copies} of {len(world)} landmarks look like another one: no place is recognised")
    if not area or len(world) / area < FEW:
        problems.append(f"there are fewer than {FEW:g} landmarks per m2")
    return Summary(facts, tuple(problems))


def copied(world: FloorLandmarks) -> int:
    """Return the number of landmarks whose descriptor is close to that of another landmark of the map."""
    looks, n = world.descriptors, len(world)
    squares, count = (looks**2).sum(axis=1), 0
    sample = looks[:: max(1, n // 500)]
    gaps = np.sqrt(np.maximum(0.0, ((sample[:, None] - sample[None]) ** 2).sum(axis=2)))
    limit = max((ALIKE * float(np.median(gaps))) ** 2, 1e-9)
    for first in range(0, n, 512):
        part = looks[first : first + 512]
        gap = squares[first : first + 512, None] + squares[None] - 2.0 * part @ looks.T
        gap[np.arange(len(part)), first + np.arange(len(part))] = np.inf
        count += int((gap.min(axis=1) < limit).sum())
    return count


def _zones(zones: Zones) -> dict[str, Any]:
    return {
        "keepout": [zone.name for zone in zones.keepout],
        "speed_limits": [zone.name for zone in zones.all if zone.kind == "speed_limit"],
    }


def _grid(grid: FloorGrid, zones: Zones, radius: float) -> Summary:
    number(radius, "radius", "m", low=0.0)
    widest = WIDEST * grid.cell
    if radius > widest:
        text = f"got {radius:g}, allowed is 0 to {widest:g} m, {WIDEST} cells of {grid.cell:g} m"
        raise InvalidField("radius", text)
    walked = KeptOut(zones, grid).closed(grid) if zones.keepout else grid
    costs = prepare(walked, Clearance(radius=radius, comfort=radius), lasting=False)
    sizes = np.bincount(costs.region.ravel())[1:]
    largest = float(sizes.max()) / grid.cells.size if sizes.size else 0.0
    facts = {
        "kind": "occupancy", "rows": grid.shape[0], "cols": grid.shape[1], "cell_m": grid.cell,
        "bounds_m": list(grid.bounds), "yaw_rad": grid.yaw, "free": float((grid.cells == FREE).mean()),
        "unknown": float((grid.cells == UNKNOWN).mean()), "regions": len(sizes), "largest_region": largest,
        "radius_m": radius,
    }  # fmt: skip
    problems = []
    if not sizes.size:
        problems.append(f"a robot with a radius of {radius:g} m stands nowhere")
    elif largest * grid.cells.size < 0.5 * sizes.sum():
        problems.append(f"the free floor falls into {len(sizes)} regions without a way between them")
    return Summary(facts, tuple(problems))
