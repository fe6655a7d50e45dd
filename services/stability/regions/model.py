"""Answers about regions: status, polygons, support values with proof."""

from dataclasses import dataclass
from typing import Literal

from surefoot.geometry.polygon import area

from ..programs.contacts import Array, ContactSet
from ..programs.fan import Fan
from ..programs.reduced import Reduced

RegionStatus = Literal["ok", "infeasible", "unbounded", "point", "segment"]
SupportStatus = Literal["ok", "unbounded", "infeasible"]


@dataclass(frozen=True, slots=True)
class Support:
    """Support values h(a) of a region in k directions a, with proof."""

    direction: Array
    """(k, 2) unit."""
    value: Array
    """(k,) m, h(a); NaN unless status is ok."""
    point: Array
    """(k, 2) m, where it is reached."""
    status: tuple[SupportStatus, ...]
    """(k,) status of each direction."""
    gap: Array
    """(k,) m, value - a'point >= 0 up to rounding."""
    twist: Array
    """(k, 4) certificate (v m, w_z) of the value, or (k, 6) (v m, Om) with an acceleration, about the origin of the
    frame; NaN unless ok; (k, 0) with torque limits, which have none."""
    force: Array
    """(k, n, 3) forces at `point`, in units of the weight; unbounded: forces that shift the CoM and hold nothing."""
    torque: Array | None = None
    """(k, n, 3) Nm, of the joints of each contact's leg, with torque limits only."""


@dataclass(frozen=True, slots=True)
class Solved:
    """Programs and fan behind a region with an inside."""

    reduced: Reduced
    """Programs of the contacts, scaled frame."""
    fan: Fan
    """Answers, scaled frame."""
    count: int
    """Number of answers."""
    anchor: Array
    """(2,) m: position = anchor + length * scaled."""
    drift: Array | None = None
    """(k, 2) gain of free tangential forces per direction, of an unbounded region; None if there are none."""


@dataclass(frozen=True, slots=True)
class Region:
    """Places where the centre of mass may be."""

    contacts: ContactSet
    """Contacts of the region, in its frame."""
    status: RegionStatus
    """ok: it has an area."""
    inner: Array
    """(p, 2) m: polygon inside the region, or its point or segment."""
    outer: Array
    """(q, 2) m: polygon around the region; empty if there is none."""
    support: Support
    """Support values in the directions asked for, else in those solved for."""
    gap: float
    """m, largest distance of outer from inner; NaN if there is no outer."""
    exact: bool
    """inner is the region itself, to rounding (hull, segment, point)."""
    calls: int
    """Directions solved for."""
    sinking: Array | None = None
    """(4,) twist (v m, w_z) with v_z < 0, or (6,) (v m, Om) with an acceleration, about the origin of the frame, that
    proves infeasibility."""
    solved: Solved | None = None
    """Programs and fan for margins and extents, where the region is neither exact nor empty."""

    @property
    def area(self) -> float:
        """Area of the inner polygon, m^2."""
        return max(0.0, float(area(self.inner)))

    @property
    def area_outer(self) -> float | None:
        """Area of the outer polygon, m^2; None if there is none."""
        return max(0.0, float(area(self.outer))) if len(self.outer) else None
