"""Watch the robot: velocity, tilt and static margin as they come. Start a system first: `surefoot up ragno`."""

import sys

from schemas.topics import STATE_STABILITY, STATE_VELOCITY
from surefoot.client import connect

endpoint = sys.argv[1] if len(sys.argv) > 1 else "tcp/127.0.0.1:7447"
with connect("ragno", endpoint) as robot:
    margin = robot.latest(STATE_STABILITY).margin_planned
    for count, v in enumerate(robot.messages(STATE_VELOCITY)):
        print(
            f"t = {v.stamp_ns * 1e-9:6.2f} s  v = {v.velocity[0]:+.3f} m/s  pitch = {v.pitch:+.3f} rad  margin {margin}"
        )
        if count == 9:
            break
