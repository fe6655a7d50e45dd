"""Answer to a request of `footholds/assess`: layers of the ground with slip, cost and reasons."""

from surefoot.errors import Refusal
from surefoot.robot.description import Robot
from surefoot.schemas.footholds import AssessReply, AssessRequest

from .assess import assess
from .ground import FootholdGround
from .messages import asked_window, assess_reply, base_pose, leg_index
from .models.protocol import SlipModel
from .select import SelectParams, placement


def assess_answer(
    request: AssessRequest, ground: FootholdGround, model: SlipModel, robot: Robot, params: SelectParams
) -> AssessReply:
    """Return the reply to a request: the layers it names, of a window or of the whole map.

    Raises:
        Refusal: a window that cannot be, an unknown leg, or a leg without a base or with one that is no pose.
    """
    window, leg = asked_window(request, ground), None
    if request.leg is not None:
        if request.base is None:
            raise Refusal("invalid", "leg needs base: where the trunk is when the foot lands", "base")
        leg = placement(robot, leg_index(robot, request.leg, "leg"), base_pose(request.base), request.stroke)
        if leg is None:
            raise Refusal("invalid", f"no rotation: {request.base.quat_wxyz}", "base.quat_wxyz")
    found = assess(ground, model, window, request.centre, request.stroke, request.layers, params, leg)
    return assess_reply(request.layers, ground, window, found, model.name)
