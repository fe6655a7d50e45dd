"""Check of a planned movement: support along it, kinematic correction, signed margins (Walas & Belter, 4.3 and 4.6)."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from surefoot.arrays import Array

from ..programs.contacts import ContactSet
from .margin import Extent, Margin, extent, margin
from .model import Region
from .modes import Mode, Refinement, in_common, regions_in
from .robust import MarginSlope, Uncertainty, margin_gradient, robust_margin

STILL = 1e-12  # m; a shorter horizontal movement has no direction


@dataclass(frozen=True, slots=True)
class Check:
    """Result of the check of a movement against a region: margins, and distances to the edge."""

    com_after: Array
    """Centre of mass after the movement, com + movement + shift, x and y, (2,) m."""
    margin_now: Margin
    """Static margin, signed distance to the edge, of the centre of mass before the movement, m."""
    margin: Margin
    """Static margin, signed distance to the edge, of the centre of mass after the movement, m."""
    extent: Extent | None
    """Distance from the CoM before the movement, along the movement, to the edge; None without horizontal movement."""
    gsm: Extent | None
    """Geometric stability margin: signed distance from `com_after` along the movement to the edge; None if no
    movement."""
    stable: bool
    """True if the region has an area and the centre of mass after the movement lies in it, else False."""


def worst(checks: Sequence[Check]) -> Check:
    """Return the smallest margins and distances of the checks over several regions, none of them infeasible.

    Stable only if all are; `com_after` is that of the first.
    """
    first = checks[0]
    if len(checks) == 1:
        return first
    return Check(
        first.com_after,
        min((c.margin_now for c in checks), key=_low),
        min((c.margin for c in checks), key=_low),
        _nearest([c.extent for c in checks]),
        _nearest([c.gsm for c in checks]),
        all(c.stable for c in checks),
    )


def _low(found: Margin) -> float:
    return math.inf if found.value is None else found.value


def _nearest(found: Sequence[Extent | None]) -> Extent | None:
    """Return the shortest distance, or that with status `missed` if there is one; None if there are none."""
    ways = [e for e in found if e is not None]
    for e in ways:
        if e.status == "missed":
            return e
    return min(ways, key=lambda e: math.inf if e.value is None else e.value, default=None)


def check(region: Region, com: Array, movement: Array, shift: Array) -> Check:
    """Return the margins of a movement of the trunk: before it, after it, and the distances to the edge along it.

    Equation (28) of Walas & Belter, the geometric stability margin, is printed as a norm, which hides a fall: here it
    is the signed distance from the CoM after the movement, c1 = com + movement + shift, along the movement to the edge.
    A ray may also enter the region ahead, so margin(c1) >= 0 decides.

    Args:
        region: region of the contacts that stay.
        com: x, y of the CoM now, measured or from kinematics, (2,) m.
        movement: displacement of the trunk over its feet, (3,) m (r_M of Walas & Belter).
        shift: further shift of the CoM by the legs, (3,) m (r_KIN of Walas & Belter).

    Raises:
        StabilityError: no solver finds an edge.
    """
    after = com + movement[:2] + shift[:2]
    now, then = margin(region, com), margin(region, after)
    along = math.hypot(movement[0], movement[1])
    reach: Extent | None = None
    gsm: Extent | None = None
    if along > STILL:
        direction = movement[:2] / along
        reach, gsm = extent(region, com, direction), extent(region, after, direction)
    stable = region.status == "ok" and then.value is not None and then.value >= 0.0
    return Check(np.asarray(after), now, then, reach, gsm, stable)


@dataclass(frozen=True, slots=True)
class Movement:
    """Planned movement of the trunk over the feet, frame world."""

    contacts: ContactSet
    """Contacts that stay on the ground during the movement."""
    mode: Mode
    """Mode of the robot (gravity, acceleration, torque limits) before the movement."""
    after: Mode
    """Mode of the robot after the movement: as before, or with the torque limits of the later posture."""
    wanted: Refinement
    """Directions and refinement of the region that is returned."""
    com: Array
    """Centre of mass before the movement, x and y, (2,) m, frame world."""
    way: Array
    """Commanded movement of the trunk, (3,) m, frame world (r_M of Walas & Belter)."""
    shift: Array
    """Further shift of the centre of mass by the legs, (3,) m, frame world (r_KIN of Walas & Belter)."""
    uncertainty: Uncertainty | None = None
    """Uncertainty of the inputs for a second margin, only without acceleration, tilt and torque limits; None: none."""
    gradient: bool = False
    """True if the gradient of the margin is wanted, only without acceleration, tilt and torque limits."""


@dataclass(frozen=True, slots=True)
class CheckedMovement:
    """Result of the check of a planned movement: region, margins, distances and gradient."""

    region: Region
    """Region of the centre of mass after the movement."""
    check: Check
    """Margins and distances of the movement; under an acceleration or a tilt, those of the worst possible gravity."""
    robust: float | None = None
    """Margin that is left with the uncertainty of the inputs, m; None: not requested, or no region or edge is left."""
    gradient: MarginSlope | None = None
    """Gradient of the margin; None: not requested, or the region has no area or no edge."""


def check_movement(asked: Movement) -> CheckedMovement:
    """Return region, margins and distances of a planned movement of the trunk, m, frame world.

    Raises:
        StabilityError: the acceleration would lift the robot off the ground, or no solver finds an answer.
    """
    before = regions_in(asked.mode, asked.contacts, asked.wanted)
    later = before if asked.after is asked.mode else regions_in(asked.after, asked.contacts, asked.wanted)
    checks = [check(region, asked.com, asked.way, asked.shift) for region in later]
    fallen = [each for each, region in zip(checks, later, strict=True) if region.status == "infeasible"]
    found, then = in_common(later), fallen[0] if fallen else worst(checks)
    if found.status == "infeasible" and not fallen:  # each gravity has a region, and they share nothing
        nowhere = None if then.extent is None else Extent(None, "infeasible")
        then = Check(then.com_after, Margin(None), Margin(None), nowhere, nowhere, False)
    if later is not before:
        now = check(before[0], asked.com, asked.way, asked.shift)
        then = replace(then, margin_now=now.margin_now, extent=now.extent)
    robust = None if asked.uncertainty is None else robust_margin(asked.contacts, then.com_after, asked.uncertainty)
    slope = margin_gradient(found, then.com_after, then.margin) if asked.gradient else None
    return CheckedMovement(found, then, robust, slope)
