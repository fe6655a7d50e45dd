"""Foothold service: latches the terrain map, answers `footholds/select` and `footholds/assess`, learns slip models."""

from concurrent.futures import Future
from typing import Any

from surefoot.geometry.heightmap import HeightMapError
from surefoot.lockstep.join import TickInputs
from surefoot.lockstep.service import Service
from surefoot.robot.reader import load_robot
from surefoot.schemas import topics
from surefoot.schemas.footholds import (
    AssessReply,
    AssessRequest,
    FootholdsBatchReply,
    FootholdsBatchRequest,
    ModelReply,
    ModelRequest,
    SelectReply,
    SelectRequest,
)
from surefoot.schemas.hw import Tick
from surefoot.schemas.topics import Topic

from .answers import assess_answer
from .config import FootholdsConfig
from .latched import LatchedGround
from .messages import asked_landings, base_pose, choice_message, leg_foothold, select_params
from .registry import SlipModels
from .rehearsal import made_up_ground, made_up_requests
from .select import select
from .steps import PlannedSteps


class Footholds(Service[FootholdsConfig]):
    """Service that chooses a foothold on the last terrain map for each leg of a request."""

    name = "footholds"
    Config = FootholdsConfig
    inputs = (topics.TERRAIN_MAP, topics.STATE_ELEVATION)
    outputs = (topics.FOOTHOLDS_CHOSEN,)
    batched = True
    serves = (
        topics.FOOTHOLDS_SELECT, topics.FOOTHOLDS_ASSESS, topics.FOOTHOLDS_BATCH, topics.FOOTHOLDS_MODEL,
        topics.FOOTHOLDS_LEARN,
    )  # fmt: skip

    def __init__(self, config: FootholdsConfig) -> None:
        super().__init__(config)
        self._maps: Topic[Any] = topics.STATE_ELEVATION if config.own_map else topics.TERRAIN_MAP
        self.inputs, self.batched = (self._maps,), not config.own_map  # a given map comes once a run, not in ticks

    def on_start(self) -> None:
        """Load robot and slip model, register the handlers."""
        self.robot = load_robot(self.config.robot)
        self.models = SlipModels(self.config, self.robot, self.log)
        self.params = self.config.params()
        self.steps = PlannedSteps(self.robot)
        self._choices, self._named = 0, ""
        """`_choices`: number of requests since the last reset; `_named`: name of the model that answered the last
        one."""
        self._since: int | None = None
        """Tick of the first request that the model in use answered; None before it."""
        self._now: Tick | None = None
        self.latched = LatchedGround(self._maps.key, self.robot.foot_radius, self.config.smooth, self.config.unsure_m)
        self.handle(topics.FOOTHOLDS_SELECT, self.choose)
        self.handle(topics.FOOTHOLDS_ASSESS, self.assess)
        self.handle(topics.FOOTHOLDS_BATCH, self.batch)
        self.handle(topics.FOOTHOLDS_MODEL, self.use_model)
        self.handle(topics.FOOTHOLDS_LEARN, self.models.job.answer)

    def on_stop(self) -> None:
        """End the running learning jobs, and the thread of batches."""
        self.models.close()
        self.steps.stop()

    def rehearse(self) -> None:
        """Answer made-up requests on a made-up map, in a copy of the service with this configuration."""
        other = Footholds(self.config.model_copy(update={"relearn": "off"}))
        other.on_start()
        other.latched.ground = made_up_ground(other.robot, self.config.smooth)
        selects, assesses = made_up_requests(other.robot)
        for model in (other.models.chosen, other.models.hand_made):
            other.models.active = model
            for each in selects:
                other.select(each)
            for each in assesses:
                other.assess(each)

    def on_reset(self) -> None:
        """Drop the map, and the models of learning jobs started before the reset."""
        self._now, self._choices = None, 0
        self.latched.forget()
        self.models.reset()

    def on_config(self) -> None:
        """Apply parameters that were changed while the service runs."""
        self.params = self.config.params()

    def on_tick(self, inputs: TickInputs) -> None:
        """Prepare the map when a new one has arrived."""
        self._now = inputs.tick
        try:
            if self.latched.take(inputs.get(self._maps)):
                self.models.fit(self.latched.ground)
        except HeightMapError as error:
            self.models.ground = None
            self.log("error", f"{self._maps.key} refused: {error}")

    def use_model(self, request: ModelRequest) -> ModelReply:
        """Answer `footholds/model`: switch to the named slip model, if any, and report the one in use."""
        return self.models.answer(request, self.params.distance_weight)

    def choose(self, request: SelectRequest) -> SelectReply:
        """Answer `footholds/select`, and publish the choice under the tick of the request."""
        reply = self.select(request)
        if self._now is not None:
            self.publish(topics.FOOTHOLDS_CHOSEN, choice_message(reply, request.tick, self._now))
        return reply

    def select(self, request: SelectRequest) -> SelectReply:
        """Return the footholds of all legs of a request."""
        self.models.take_learned()
        ground, self._choices = self.latched.known(), self._choices + 1
        self.models.take_outcomes(request, ground)
        number = self._choices if request.tick is None else request.tick
        params, explored = select_params(request, self.params, self.config.explore, (self.config.explore_seed, number))
        model, legs = self.models.active, asked_landings(request.legs, self.robot)
        found = select(ground, self.robot, model, base_pose(request.base), legs, params)
        if self._named != model.name:
            self._named, self._since = model.name, request.tick
        return SelectReply(
            legs=tuple(map(leg_foothold, request.legs, found)), map_version=ground.version, model=model.name,
            model_tick=self._since, explored=explored,
        )  # fmt: skip

    def assess(self, request: AssessRequest) -> AssessReply:
        """Answer `footholds/assess`: return layers of a window or of the whole map."""
        return assess_answer(request, self.latched.known(), self.models.active, self.robot, self.params)

    def batch(self, request: FootholdsBatchRequest) -> Future[FootholdsBatchReply]:
        """Answer `footholds/batch`: return a future of the footholds of many steps."""
        return self.steps.answer(request, self.latched.known(), self.models.active, self.params)


SERVICE = Footholds
