"""Watch the robot: velocity, tilt and static margin as they come. Start a system first: `surefoot up ragno`."""

import sys

import surefoot
from surefoot.schemas.topics import STATE_STABILITY, STATE_VELOCITY

try:
    client = surefoot.connect("ragno", sys.argv[1] if len(sys.argv) > 1 else None)
except surefoot.SurefootError as error:
    sys.exit(str(error))
with client as robot:
    margin = robot.latest(STATE_STABILITY).margin_planned
    for count, v in enumerate(robot.messages(STATE_VELOCITY)):
        print(
            f"t = {v.stamp_ns * 1e-9:6.2f} s  v = {v.velocity[0]:+.3f} m/s  pitch = {v.pitch:+.3f} rad  margin {margin}"
        )
        if count == 9:
            break
