"""Samples of stances: the coefficients of the chosen cell on the map of the choice, and how far the foot slid."""

import math

import numpy as np

from surefoot.geometry.heightmap_cells import patch

from .features import window_features
from .ground import FootholdGround
from .learning.samples import PATCH, UNKNOWN_UM, StanceSample


def sample_at(
    ground: FootholdGround,
    planned: tuple[float, float],
    nominal: tuple[float, float],
    stroke: tuple[float, float, float],
    sliding: float,
    name: tuple[str, int, int],
    displacement: float | None = None,
    load: float = math.nan,
) -> StanceSample:
    """Return the sample of one step of a foot (a stance); robot, friction and source are left to the caller.

    The heights that it keeps are those that the planes of the choice were fitted to, `FootholdGround.even`.

    Args:
        ground: map that the choice was made on.
        planned: x, y of the foothold that was chosen, map frame, m.
        nominal: x, y of the nominal foothold, map frame, m.
        stroke: f, movement of the foot relative to the body while it stands, map axes, m.
        sliding: distance that the contact point slides while the foot stands, m.
        name: trial, leg and step, which name the stance.
        displacement: horizontal displacement of the foot centre, m; None = not known, `sliding` is stored instead.
        load: mean normal force, N; NaN = not known.
    """
    surface = ground.surface
    row, col = surface.index(*planned)
    found = window_features(ground.even, row, col, 1, 1, np.array(stroke), surface.cell)
    around = np.empty((PATCH, PATCH), dtype=np.float32)
    patch(ground.even, row - PATCH // 2, col - PATCH // 2, around)
    rise = 1e6 * (around.astype(np.float64) - float(around[PATCH // 2, PATCH // 2]))
    trial, leg, step = name
    return StanceSample(
        trial=trial, leg=leg, step=step,
        k1=float(found.k1[0, 0]), k2=float(found.k2[0, 0]), cos_k3=float(found.cos_k3[0, 0]),
        k4=math.sqrt(math.fsum((a - b) ** 2 for a, b in zip(planned, nominal, strict=True))),
        stroke=stroke, sliding=sliding, displacement=sliding if displacement is None else displacement, load=load,
        friction=math.nan, cell=surface.cell, smooth=ground.smooth, foot_radius=ground.foot_radius,
        robot="", robot_hash="", source="",
        scale=ground.scale,
        heights_um=tuple(UNKNOWN_UM if math.isnan(value) else round(value) for value in rise.ravel().tolist()),
    )  # fmt: skip
