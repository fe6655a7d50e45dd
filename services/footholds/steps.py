"""Footholds of many planned steps in one request, computed on a thread of their own while ticks go on."""

from concurrent.futures import Future
from dataclasses import replace

from surefoot.background import Background
from surefoot.robot.description import Robot
from surefoot.schemas.footholds import FootholdsBatchReply, FootholdsBatchRequest, PlannedStep, StepFootholds

from .ground import FootholdGround
from .messages import asked_landings, base_pose, region_foothold
from .models.protocol import SlipModel
from .select import SelectParams, select


class PlannedSteps:
    """Answers to `footholds/batch` on a thread of their own: a batch may take longer than a tick.

    Args:
        robot: whose legs land.
    """

    def __init__(self, robot: Robot) -> None:
        self._robot = robot
        self._background = Background("steps")

    def stop(self) -> None:
        """End the thread that answers batches of steps."""
        self._background.stop()

    def answer(
        self, request: FootholdsBatchRequest, ground: FootholdGround, model: SlipModel, params: SelectParams
    ) -> Future[FootholdsBatchReply]:
        """Return a future of the footholds of all steps, on the ground and with the model of this moment.

        Args:
            request: steps with the pose of the trunk and the legs that land.
            ground: layers of the map.
            model: predicts the slip.
            params: parameters of the choice; mode and random cells are those of the request.

        Raises:
            Refusal: a leg that the robot does not have, or too many batches wait.
        """
        params = replace(params, robust=request.mode == "robust", seed=None, region=True)
        landings = [asked_landings(step.legs, self._robot, f"steps.{i}.") for i, step in enumerate(request.steps)]

        def one(step: PlannedStep, at: int) -> StepFootholds:
            found = select(ground, self._robot, model, base_pose(step.base), landings[at], params)
            return StepFootholds(legs=tuple(map(region_foothold, step.legs, found)))

        def all_of(asked: FootholdsBatchRequest) -> FootholdsBatchReply:
            steps = tuple(one(step, at) for at, step in enumerate(asked.steps))
            return FootholdsBatchReply(steps=steps, map_version=ground.version, model=model.name)

        return self._background.answer(all_of, request)
