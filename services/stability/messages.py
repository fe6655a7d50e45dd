"""Fields of messages from regions, support values and rows of numbers."""

import math
from typing import Any

from surefoot.schemas.stability import MarginGradient, SupportPoint

from .programs.contacts import Array
from .regions.model import Region, Support
from .regions.robust import RobustGradient


def region_fields(found: Region, proofs: bool, polygons: bool) -> dict[str, Any]:
    """Fields of a RegionReply."""
    sinking = None if found.sinking is None else tuple(found.sinking.tolist())
    level = sinking is not None and len(sinking) == 4
    return {
        "status": found.status,
        "inner": pairs(found.inner) if polygons else (),
        "outer": pairs(found.outer) if polygons else (),
        "support": _support(found.support, proofs) if polygons else (),
        "gap": found.gap if math.isfinite(found.gap) else None,
        "area": found.area,
        "area_outer": found.area_outer,
        "certificate": sinking if level else None,
        "twist": None if level else sinking,
    }


def _support(support: Support, proofs: bool) -> tuple[SupportPoint, ...]:
    """Support values with their proofs: certificate at rest, twist with an acceleration, torques with limits."""
    direction, value, point = pairs(support.direction), support.value.tolist(), pairs(support.point)
    gap, name = support.gap.tolist(), {4: "certificate", 6: "twist", 0: ""}[support.twist.shape[1]]
    out: list[SupportPoint] = []
    for i, status in enumerate(support.status):
        ok = status == "ok"
        proof: dict[str, Any] = {}
        if proofs and ok and name:
            proof[name] = tuple(support.twist[i].tolist())
        if proofs and status != "infeasible":
            proof["forces"] = triples(support.force[i])
            if support.torque is not None:
                proof["torques"] = triples(support.torque[i])
        out.append(
            SupportPoint(
                direction=direction[i],
                value=value[i] if ok else None,
                point=point[i] if ok else None,
                status=status,
                gap=max(0.0, gap[i]) if ok else None,
                **proof,
            )
        )
    return tuple(out)


def gradient_message(slope: RobustGradient) -> MarginGradient:
    """Message of the gradient of a margin."""
    x, y = slope.com.tolist()
    return MarginGradient(com=(x, y), mu=tuple(slope.mu.tolist()), position=triples(slope.position))


def pairs(points: Array) -> tuple[tuple[float, float], ...]:
    """Rows of two numbers as tuples."""
    return tuple(map(tuple, points.tolist()))  # pyright: ignore[reportReturnType] - rows of two


def triples(rows: Array) -> tuple[tuple[float, float, float], ...]:
    """Rows of three numbers as tuples."""
    return tuple(map(tuple, rows.tolist()))  # pyright: ignore[reportReturnType] - rows of three
