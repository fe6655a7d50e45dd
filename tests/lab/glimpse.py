"""Messages of one image that a robot reads while it moves on by 2 cm, in the order in which they come."""

import math

import numpy as np

from surefoot.schemas.base import Message
from surefoot.schemas.navigation import PoseBelief
from surefoot.schemas.state import Odometry
from surefoot.services.vision.eye import Eye
from surefoot.services.vision.messages import landmarks_message
from surefoot.services.vision.motion import OdometryAt, since
from surefoot.services.vision.recognise import Believed
from tests.services.vision.shots import HEIGHT, base, extractor, shot, world

AT, LATER_NS, WAY = (0.12, 0.03, 0.1), 60_000_000, 0.02
COV = np.diag([1e-4, 2e-4, 9e-4])
ENTROPY = -7.5


def odometry(stamp_ns: int, x: float) -> Odometry:
    half = 0.5 * AT[2]
    message = Odometry(
        position=(x, AT[1], HEIGHT), quat_wxyz=(math.cos(half), 0.0, 0.0, math.sin(half)), yaw=AT[2],
        velocity=(0.0, 0.0, 0.0), covariance=(0.0,) * 16, initialised=True,
    )  # fmt: skip
    return message.stamped(stamp_ns, 0, 1, 0, "estimator")


def glimpse() -> list[tuple[str, Message]]:
    """Keys and messages; the first landmarks are of another image."""
    belief = Believed(np.array(AT), COV)
    image = shot(AT, stamp_ns=10_000_000)
    pose = PoseBelief(
        pose=AT, covariance=tuple(COV.ravel().tolist()), entropy=ENTROPY, drift=0.0, drift_sd=0.1,
        map_from_odom=(0.0, 0.0, 0.0), initialised=True, control="odometry", matched=0,
    ).stamped(0, 0, 1, 0, "navigator")  # fmt: skip
    seen = Eye(extractor(), world()).look(image, base(), belief)
    then, now = (OdometryAt(0, (x, AT[1], AT[2]), np.eye(3)) for x in (AT[0], AT[0] + WAY))
    marks = landmarks_message(since(seen.places, then, now), seen, world().codes, image.stamp_ns, ())
    before = marks.model_copy(update={"image_stamp_ns": 5})
    return [
        ("state/landmarks", before.stamped(0, 0, 1, 0, "vision")),
        ("hw/image", image), ("state/odometry", odometry(10_000_000, AT[0])), ("state/pose", pose),
        ("state/odometry", odometry(10_000_000 + LATER_NS, AT[0] + WAY)),
        ("state/landmarks", marks.stamped(10_000_000 + LATER_NS, 7, 1, 1, "vision")),
    ]  # fmt: skip
