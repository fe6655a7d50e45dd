"""Use of ranger readings: an obstacle close ahead allows only turns, and one that the map lacks is remembered."""

import math

from surefoot.schemas.hw import Range

from .arrival import spread
from .belief.relocalise import placed
from .localiser import Localiser
from .maps import Maps
from .planning.seen import expected_echo

ECHO_SLACK = 0.25
"""Difference between echo and mapped distance up to which an echo supports the believed pose, m: walls are oblique."""


def take_range(reach: Range, localiser: Localiser, maps: Maps, now: float) -> tuple[bool, bool]:
    """Enter a ranger reading into the local map and the check of the pose; return which motions it restricts.

    Only turns are allowed where the ranger or a bumper shows an obstacle close ahead (Osswald et al.), unless it is a
    wall of the map beside a way that is free straight ahead. The robot steps back from what presses a bumper, and from
    an obstacle that the map lacks if that is very close (`Conduct`).

    Args:
        reach: reading of the ranger.
        localiser: belief of the pose; while it is lost, nothing is entered.
        maps: obstacles, of which the local map is changed.
        now: simulated time, s.

    Returns:
        True if only turns are allowed; True if the robot is to step back.
    """
    tracker, conduct, unknown, passes = localiser.tracker, maps.conduct, False, False
    if not localiser.lost.lost:
        at = placed(tracker.pose, (conduct.ranger_ahead, 0.0, 0.0))
        unsure = (spread(tracker.cov), math.sqrt(max(0.0, float(tracker.cov[2, 2]))))
        grid = maps.grid
        if grid is not None:
            half = 0.5 * reach.field_of_view
            least, largest = expected_echo(grid, at, (half, 2.0 * unsure[1]), reach.longest, maps.obstacle)
            expected = max(least, reach.shortest), max(largest, reach.shortest)
            got = reach.longest if reach.distance is None else reach.distance
            localiser.echo(got, expected, ECHO_SLACK + 2.0 * unsure[0], now)
            nearest = expected[0] - conduct.wall_slack
            explained = got > reach.shortest and got >= nearest  # at its least, an echo may be of anything
            passes = explained and unsure[0] <= conduct.wall_sure and _free_ahead(maps, tracker.pose)
        unknown = maps.see(reach, at, unsure, now)
    distance, bump = math.inf if reach.distance is None else reach.distance, any(reach.bump)
    close = unknown and distance <= max(conduct.close, reach.shortest)
    near = distance <= max(conduct.blocked, reach.shortest) and (unknown or not passes)
    return near or bump, close or bump


def _free_ahead(maps: Maps, pose: tuple[float, float, float]) -> bool:
    """Return whether map and local map are free straight ahead of a pose: x, y in m, heading in rad, frame map."""
    x, y, heading = pose
    way = maps.conduct.wall_free
    places = ((x + d * math.cos(heading), y + d * math.sin(heading)) for d in (0.5 * way, way))
    return all(maps.enterable((x, y), place) for place in places)
