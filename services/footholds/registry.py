"""Slip models of the foothold service: the requested one, the one in use, and those learned while it runs."""

import hashlib
from collections import Counter
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from surefoot.robot.description import Robot
from surefoot.schemas.footholds import ModelReply, ModelRequest, SelectRequest, StanceOutcome

from .config import FootholdsConfig
from .ground import FootholdGround
from .learning.job import LearnJob
from .learning.samples import StanceSample
from .messages import model_reply
from .models.files import ModelError, load, shipped
from .models.learned import LearnedModel
from .models.protocol import SlipModel
from .outcomes import sample_at

Log = Callable[[str, str], None]


class SlipModels:
    """Store of the slip models of the foothold service: the requested one, the one in use, and those learned."""

    def __init__(self, config: FootholdsConfig, robot: Robot, log: Log) -> None:
        self.config, self.robot, self.log = config, robot, log
        self.hand_made = config.hand_made()
        self.learner = config.relearner(lambda text: log("warning", text))
        self.job = LearnJob()
        self.refused: Counter[str] = Counter()
        """Number of model files that were requested and not used, by reason."""
        self.chosen = self._kept() or self.find(config.slip_model)
        """Model that was requested by configuration or query."""
        self.active: SlipModel = self.chosen
        """Model in use: `chosen`, or the hand-made score where that does not apply to the map."""
        self.unfit = ""
        """Reason in words why the model `chosen` is not in use; empty = it is."""
        self.ground: FootholdGround | None = None
        """Prepared map on which the model in use has to apply; None before the first map."""

    def find(self, name: str) -> SlipModel:
        """Return the model of a name (`shipped`, `hand-made`) or of a file's path.

        Raises:
            ModelError: no model, or one of another robot.
        """
        path = shipped(self.robot.name) if name == "shipped" else name
        return self.hand_made if name == "hand-made" or path is None else self._load(path)

    def fit(self, ground: FootholdGround | None) -> None:
        """Use the chosen model if it holds on a map, else the hand-made score."""
        self.ground = ground
        self.unfit = "" if ground is None else self.chosen.unfit(ground.surface.cell, ground.smooth, ground.foot_radius)
        self.active = self.hand_made if self.unfit else self.chosen
        if self.unfit:
            self.log("warning", f"slip model {self.chosen.name} is not used: {self.unfit}")

    def answer(self, request: ModelRequest, weight: float | None) -> ModelReply:
        """Switch to another model, if the request names one, and report the model in use.

        Raises:
            ModelError: the named model cannot be used; the old one stays.
        """
        self.take_learned()
        if request.use:
            try:
                self._use(self.find(request.use))
            except ModelError as error:
                self.refused[f"model_{error.code}"] += 1
                raise
        return model_reply(self.active, weight, self.unfit, self.learner, self.refused)

    def take_learned(self) -> None:
        """Switch to the model of a finished learning job, if there is one to be used."""
        learned = self.job.take()
        if learned is not None:
            self._use(learned)

    def take_outcomes(self, request: SelectRequest, ground: FootholdGround) -> None:
        """Pass the stance outcomes of a request to re-learning, and switch to a re-learned model if one is due."""
        if self.learner is None:
            return
        for each in request.outcomes:
            sample = self._sample(each, ground)
            if isinstance(sample, str):
                self.learner.refuse(sample)
            else:
                self.learner.take([sample])
        made = self.learner.chosen(self.active if isinstance(self.active, LearnedModel) else None)
        if made is not None:
            self._use(made)

    def reset(self) -> None:
        """Drop the map and the models of earlier learning jobs; wait for a running re-learning and use its model."""
        self.ground = None
        self.job.forget()
        made = None if self.learner is None else self.learner.close()
        if made is not None:
            self._use(made)

    def close(self) -> None:
        """Cancel the learning job, and wait for re-learning that is running."""
        self.job.close()
        if self.learner is not None:
            self.learner.close()

    def _use(self, model: SlipModel) -> None:
        self.chosen = model
        self.fit(self.ground)
        self.log("info", f"slip model {self.active.name}")

    def _load(self, path: str | Path) -> LearnedModel:
        model = load(path)
        if model.conditions.robot not in ("", self.robot.name):
            raise ModelError(
                "other_robot", f"{model.name} was learned with {model.conditions.robot}, not {self.robot.name}", "robot"
            )
        return model

    def _kept(self) -> SlipModel | None:
        """Return the model that re-learning has kept, None without a usable one."""
        if self.learner is None or not self.config.relearn_file or not Path(self.config.relearn_file).exists():
            return None
        try:
            return self._load(self.config.relearn_file)
        except ModelError as error:
            self.learner.refuse("kept_file")
            self.log("error", f"the re-learned model is not used: {error.message}")
            return None

    def _sample(self, outcome: StanceOutcome, ground: FootholdGround) -> StanceSample | str:
        """Return the sample of an outcome, or the reason why it cannot be one."""
        if outcome.leg not in self.robot.leg_names:
            return "unknown_leg"
        if not ground.near(*outcome.foothold):
            return "off_the_map"
        if not outcome.healthy:
            return "unhealthy"
        content = hashlib.sha256(outcome.model_dump_json().encode()).hexdigest()
        name = (f"own {content}", self.robot.leg_names.index(outcome.leg), 0)
        sample = sample_at(ground, outcome.foothold, outcome.nominal, outcome.stroke, outcome.slip, name)
        source = f"own slip of {self.robot.name}"
        return replace(sample, source=source, robot=self.robot.name, robot_hash=self.robot.hash)
