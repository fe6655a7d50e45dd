"""Foothold service: latches the terrain map, answers `footholds/select` and `footholds/assess`, learns slip models."""

from collections import Counter
from dataclasses import replace
from pathlib import Path

import numpy as np

from surefoot.errors import Refusal
from surefoot.geometry.heightmap import HeightMap, HeightMapError
from surefoot.lockstep.join import TickInputs
from surefoot.lockstep.service import Service
from surefoot.robot.reader import load_robot
from surefoot.schemas.footholds import (
    AssessReply,
    AssessRequest,
    ModelReply,
    ModelRequest,
    SelectReply,
    SelectRequest,
    StanceOutcome,
)
from surefoot.schemas.terrain import HeightMapMessage
from surefoot.schemas.topics import FOOTHOLDS_ASSESS, FOOTHOLDS_LEARN, FOOTHOLDS_MODEL, FOOTHOLDS_SELECT, TERRAIN_MAP

from .assess import assess, whole_map, window_about
from .config import FootholdsConfig
from .ground import FootholdGround, build_ground, updated_ground
from .job import LearnJob
from .messages import base_pose, leg_foothold, mask_bits, mask_counts, model_reply
from .models.files import ModelError, load, shipped
from .models.learned import LearnedModel
from .models.protocol import SlipModel
from .outcomes import sample_at
from .rehearsal import made_up_map, made_up_requests
from .select import Landing, placement, select


class Footholds(Service[FootholdsConfig]):
    """Tells each leg where to step on the latched map."""

    name = "footholds"
    Config = FootholdsConfig
    inputs = (TERRAIN_MAP,)
    batched = True
    serves = (FOOTHOLDS_SELECT, FOOTHOLDS_ASSESS, FOOTHOLDS_MODEL, FOOTHOLDS_LEARN)

    def on_start(self) -> None:
        """Load the robot, register the handlers."""
        self.robot = load_robot(self.config.robot)
        self.hand_made = self.config.hand_made()
        self.learner = self.config.relearner(lambda text: self.log("warning", text))
        self.chosen = self._kept() or self._find(self.config.slip_model)
        """The model that was asked for."""
        self.model: SlipModel = self.chosen
        """The model in force: the hand-made score where the chosen one does not hold on the map."""
        self.unfit = ""
        self.job = LearnJob()
        self.refused: Counter[str] = Counter()
        """Model files that were asked for and not used, by reason."""
        self._choices = 0
        self._since: int | None = None
        """Tick of the first request that the model in force answered."""
        self._named = ""
        self.params = self.config.params()
        self.legs = {leg.name: index for index, leg in enumerate(self.robot.legs)}
        self._message: HeightMapMessage | None = None
        self._raw: HeightMap | None = None
        """The map that the ground was made of."""
        self._ground: FootholdGround | None = None
        self.handle(FOOTHOLDS_SELECT, self.select)
        self.handle(FOOTHOLDS_ASSESS, self.assess)
        self.handle(FOOTHOLDS_MODEL, self.use_model)
        self.handle(FOOTHOLDS_LEARN, self.job.answer)

    def on_stop(self) -> None:
        """End the job, and a round of re-learning."""
        self.job.close()
        if self.learner is not None:
            self.learner.close()

    def rehearse(self) -> None:
        """Answer made-up requests on a made-up map, as another service of the same configuration."""
        other = Footholds(self.config.model_copy(update={"relearn": "off"}))
        other.on_start()
        heights = made_up_map(other.robot)
        ground = build_ground(heights, other.robot.foot_radius, self.config.smooth)
        changed = heights.z.copy()
        changed[:2, :2] = 0.01
        other._ground = updated_ground(ground, heights, heights.with_z(changed))
        selects, assesses = made_up_requests(other.robot)
        for model in (other.chosen, other.hand_made):
            other.model = model
            for each in selects:
                other.select(each)
            for each in assesses:
                other.assess(each)

    def on_reset(self) -> None:
        """Forget the map, and what a job of the past epoch was to put in force; the new epoch brings its own."""
        self._message = self._ground = self._raw = None
        self.job.forget()
        self._choices = 0
        made = None if self.learner is None else self.learner.close()
        if made is not None:
            self._use(made)

    def on_tick(self, inputs: TickInputs) -> None:
        """Prepare the map when it is another one."""
        message = inputs.get(TERRAIN_MAP)
        if message is None or message is self._message:
            return
        self._message = message
        try:
            heights = HeightMap.from_wire(message.model_dump(), message.data)
        except HeightMapError as error:
            self._ground = self._raw = None
            self.log("error", f"terrain/map refused: {error}")
            return
        if self._ground is not None and self._raw is not None:
            self._ground = updated_ground(self._ground, self._raw, heights)
        else:
            self._ground = build_ground(heights, self.robot.foot_radius, self.config.smooth)
        self._raw = heights
        self._fit()

    def use_model(self, request: ModelRequest) -> ModelReply:
        """Put another slip model in force, if one is named, and report the one in force."""
        self._take_learned()
        if request.use:
            try:
                self._use(self._find(request.use))
            except ModelError as error:
                self.refused[f"model_{error.code}"] += 1
                raise
        return model_reply(self.model, self.params.distance_weight, self.unfit, self.learner, self.refused)

    def select(self, request: SelectRequest) -> SelectReply:
        """Footholds of all legs of a request."""
        self._take_learned()
        ground = self._map()
        self._learn_again(request, ground)
        landings = [
            Landing(self._leg(leg.leg, f"legs.{i}.leg"), leg.nominal, leg.stroke) for i, leg in enumerate(request.legs)
        ]
        params = self.params if request.mode == "robust" else replace(self.params, robust=False)
        if request.mode == "random":
            if request.seed is None:
                raise Refusal("invalid", "mode random needs a seed", "seed")
            params = replace(params, seed=request.seed)
        number = self._choices if request.tick is None else request.tick
        draws = np.random.default_rng((self.config.explore_seed, number))
        explored = request.mode == "robust" and self.config.explore > 0.0 and draws.random() < self.config.explore
        if explored:
            params = replace(params, seed=int(draws.integers(2**62)))
        found = select(ground, self.robot, self.model, base_pose(request.base), landings, params)
        legs = tuple(map(leg_foothold, request.legs, found))
        if self._named != self.model.name:
            self._named, self._since = self.model.name, request.tick
        return SelectReply(
            legs=legs, map_version=ground.version, model=self.model.name, model_tick=self._since, explored=explored
        )

    def assess(self, request: AssessRequest) -> AssessReply:
        """Layers of a window or of the whole map."""
        ground = self._map()
        if request.size % 2 == 0:
            raise Refusal("invalid", f"size must be odd, got {request.size}", "size")
        window = whole_map(ground)
        if request.centre is not None:
            if not ground.near(*request.centre):
                raise Refusal("invalid", f"centre must lie near the map, got {request.centre}", "centre")
            window = window_about(ground, *request.centre, request.size)
        leg = None
        if request.leg is not None:
            if request.base is None:
                raise Refusal("invalid", "leg needs base: where the trunk is when the foot lands", "base")
            leg = placement(self.robot, self._leg(request.leg, "leg"), base_pose(request.base), request.stroke)
            if leg is None:
                raise Refusal("invalid", f"no rotation: {request.base.quat_wxyz}", "base.quat_wxyz")
        p = self.params
        found = assess(
            ground, self.model, window, request.centre, request.stroke, request.layers, p.limits, p.distance_weight, leg
        )
        return AssessReply(
            layers=request.layers, rows=window.rows, cols=window.cols, cell=ground.surface.cell,
            origin=ground.surface.centre(window.row, window.col),
            mask_bits=mask_bits(), counts=mask_counts(found.counts), map_version=ground.version, model=self.model.name,
            data=np.ascontiguousarray(found.layers, dtype="<f4").tobytes(),
        )  # fmt: skip

    def _find(self, name: str) -> SlipModel:
        """The model of a name or path; raises ModelError where it is none."""
        if name == "hand-made":
            return self.hand_made
        path = shipped(self.robot.name) if name == "shipped" else name
        return self.hand_made if path is None else self._load(path)

    def _load(self, path: str | Path) -> LearnedModel:
        """The model of a file; raises ModelError where there is none, or one of another robot."""
        model = load(path)
        if model.conditions.robot not in ("", self.robot.name):
            raise ModelError(
                "other_robot", f"{model.name} was learned with {model.conditions.robot}, not {self.robot.name}", "robot"
            )
        return model

    def _kept(self) -> SlipModel | None:
        """The model that re-learning has kept, None if there is none that can be used."""
        if self.learner is None or not self.config.relearn_file or not Path(self.config.relearn_file).exists():
            return None
        try:
            return self._load(self.config.relearn_file)
        except ModelError as error:
            self.learner.refuse("kept_file")
            self.log("error", f"the re-learned model is not used: {error.message}")
            return None

    def _take_learned(self) -> None:
        """Put a model in force that a job has learned for it."""
        learned = self.job.take()
        if learned is not None:
            self._use(learned)

    def _use(self, model: SlipModel) -> None:
        self.chosen = model
        self._fit()
        self.log("info", f"slip model {self.model.name}")

    def _learn_again(self, request: SelectRequest, ground: FootholdGround) -> None:
        """Take the outcomes of a request, and a model that has been learned from earlier ones."""
        self._choices += 1
        if self.learner is None:
            return
        for each in request.outcomes:
            self._take_outcome(each, ground)
        made = self.learner.chosen(self.model if isinstance(self.model, LearnedModel) else None)
        if made is not None:
            self._use(made)

    def _take_outcome(self, outcome: StanceOutcome, ground: FootholdGround) -> None:
        assert self.learner is not None
        if outcome.leg not in self.legs:
            self.learner.refuse("unknown_leg")
            return
        if not ground.near(*outcome.foothold):
            self.learner.refuse("off_the_map")
            return
        name = ("own", self.legs[outcome.leg], self.learner.taken)
        sample = sample_at(ground, outcome.foothold, outcome.nominal, outcome.stroke, outcome.slip, name)
        source = f"own slip of {self.robot.name}"
        robot = {"robot": self.robot.name, "robot_hash": self.robot.hash}
        self.learner.take([replace(sample, source=source, **robot)])

    def _fit(self) -> None:
        """Compare the chosen model with the map; one that does not hold there is not used, and the log says so."""
        ground = self._ground
        self.unfit = "" if ground is None else self.chosen.unfit(ground.surface.cell, ground.smooth, ground.foot_radius)
        self.model = self.hand_made if self.unfit else self.chosen
        if self.unfit:
            self.log("warning", f"slip model {self.chosen.name} is not used: {self.unfit}")

    def _map(self) -> FootholdGround:
        if self._ground is None:
            raise Refusal("not_ready", "no terrain map has come yet")
        return self._ground

    def _leg(self, name: str, field: str) -> int:
        if name not in self.legs:
            raise Refusal("unknown_leg", f"{self.robot.name} has the legs {', '.join(self.legs)}; got {name!r}", field)
        return self.legs[name]


SERVICE = Footholds
