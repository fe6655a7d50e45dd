"""Effect of keepout zones and speed limits on the next motion of the robot."""

import math

from .belief.tracker import PoseTracker
from .goals import GaitView
from .maps import Maps
from .orders import straight
from .pilot import Pilot


def restrict(pilot: Pilot, gait: GaitView, tracker: PoseTracker, maps: Maps) -> bool:
    """Limit the speed of the next walk, and return True if only turns are allowed, as a walk comes near to a zone.

    A walk is not allowed that ends nearer to a keepout zone than the robot is, and within most of its radius of it.
    While the next action cannot begin, nothing is done.

    Args:
        pilot: chooses the next action; the speed of its orders is set.
        gait: state of the walker.
        tracker: belief of the pose.
        maps: zones.
    """
    if not maps.zones or not pilot.under_way or (gait.ends_in or 0.0) > pilot.conduct.lead:
        return False
    x, y, heading = pilot.predicted(tracker)[0][:3].tolist()
    way = straight(pilot.acts).motion.forward
    ahead = (x + way * math.cos(heading), y + way * math.sin(heading))
    pilot.orders.pace = maps.zones.pace((x, y), ahead)
    return not maps.keeps_out((x, y), ahead)
