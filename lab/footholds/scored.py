"""Scoring of the ground of a map file by a slip model, without a running system."""

from pathlib import Path

import numpy as np

from surefoot.disk import whole
from surefoot.errors import SurefootError
from surefoot.geometry.heightmap import HeightMap, HeightMapError
from surefoot.geometry.heightmap_exchange import load_any
from surefoot.services.footholds.assess import Assessment, assess, whole_map
from surefoot.services.footholds.ground import build_ground
from surefoot.services.footholds.masks import REASONS
from surefoot.services.footholds.models.protocol import SlipModel
from surefoot.services.footholds.select import SelectParams

from ..bags.grid_maps import SUFFIXES, last_heights

LAYERS = ("z", "k1", "k2", "cos_k3", "p", "mask", "spread", "support", "clear")


def read_map(path: Path) -> HeightMap:
    """Read a height map of any supported format, or the last grid_map message of a ROS bag.

    Raises:
        SurefootError: the file is absent, or is no height map.
    """
    try:
        path.stat()
        return last_heights(path) if path.is_dir() or path.suffix in SUFFIXES else load_any(path)
    except OSError as error:
        raise SurefootError("unreadable", f"{str(path)!r} cannot be read: {error.strerror}", "map") from None
    except HeightMapError as error:
        raise SurefootError("invalid", f"{str(path)!r}: {error}", "map") from None


def score_map(
    heights: HeightMap, model: SlipModel, foot_radius: float, stroke: tuple[float, float, float], smooth: bool
) -> Assessment:
    """Return the layers `LAYERS` (heights, ground coefficients, predicted slip, masks ...) for all cells of a map.

    Args:
        heights: the map.
        model: predicts the slip.
        foot_radius: radius of the foot sphere, m.
        stroke: movement of a foot relative to the body while it stands, map axes, (3,) m.
        smooth: True: a 3 x 3 median filters the map first; False: it does not.

    Raises:
        SurefootError: the model was learned for another cell size, smoothing or foot.
    """
    unfit = model.unfit(heights.cell, smooth, foot_radius)
    if unfit:
        raise SurefootError("unfit", f"{model.name}: {unfit}", "model")
    ground = build_ground(heights, foot_radius, smooth)
    return assess(ground, model, whole_map(ground), None, stroke, LAYERS, SelectParams())


def save_scored(found: Assessment, heights: HeightMap, model: SlipModel, path: Path) -> None:
    """Write a scored map as `.npz`: layers, cell size and origin, m, mask bits, name of the model.

    Raises:
        SurefootError: the file cannot be written.
    """
    layers = dict(zip(LAYERS, found.layers, strict=True))
    try:
        with whole(path) as part, part.open("wb") as stream:
            np.savez_compressed(
                stream, **layers, cell=heights.cell, origin=np.array(heights.origin), model=np.array(model.name),
                mask_bits=np.array([1 << k for k in range(len(REASONS))]), mask_names=np.array(REASONS),
            )  # fmt: skip
    except OSError as error:
        raise SurefootError("unwritable", f"{str(path)!r} cannot be written: {error.strerror}", "out") from None
