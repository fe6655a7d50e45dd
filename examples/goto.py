"""Send Nao to a place and print why it acts so. Start a system first: `surefoot up nao-goal --terrain corridor`.

Arguments: endpoint, then x and y of the place, m, frame map; without them it goes to (0.5, 0.1).
"""

import sys

import surefoot
from surefoot.schemas.topics import NAVIGATOR_FEEDBACK, NAVIGATOR_GOTO, STATE_POSE

try:
    client = surefoot.connect("nao", sys.argv[1] if len(sys.argv) > 1 else None)
except surefoot.SurefootError as error:
    sys.exit(str(error))
with client as robot:
    next(pose for pose in robot.messages(STATE_POSE) if pose.initialised)
    robot.call(NAVIGATOR_GOTO, position=[float(word) for word in sys.argv[2:]] or (0.5, 0.1), goal_id="there")
    shown = 0
    for feedback in robot.messages(NAVIGATOR_FEEDBACK):
        decision = feedback.decision
        if decision is not None and decision.number > shown and feedback.goal_id == "there":
            shown = decision.number
            print(f"{feedback.distance_remaining:5.2f} m  {decision.reason}")
        if feedback.goal_id == "there" and feedback.state not in ("navigating", "stopping"):
            print(feedback.state, feedback.error_msg)
            break
