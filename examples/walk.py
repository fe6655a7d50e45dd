"""Walk 20 cm, and report when it is done. Start a system first: `surefoot up ragno`."""

import sys

import surefoot
from surefoot.schemas.topics import CMD_WALK, STATE_GAIT

try:
    client = surefoot.connect("ragno", sys.argv[1] if len(sys.argv) > 1 else None)
except surefoot.SurefootError as error:
    sys.exit(str(error))
with client as robot:
    for gait in robot.messages(STATE_GAIT):  # the walker refuses to walk before the estimator has found its bearings
        if gait.state in ("standing", "hold"):  # held: by an emergency stop, as the refusal states
            break
    reply = robot.call(CMD_WALK, action="walk", distance=0.2)
    if not reply.accepted:
        sys.exit(f"refused: {reply.reason}")
    for gait in robot.messages(STATE_GAIT):
        if gait.walk_id == reply.id and gait.state == "standing":
            print(f"arrived after {gait.steps} steps")
            break
