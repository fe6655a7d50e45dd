"""Configuration of the foothold service."""

from collections.abc import Callable
from dataclasses import fields
from typing import Literal

from pydantic import Field

from surefoot.lockstep.config import ServiceConfig

from .learning.relearner import Relearner, RelearnParams
from .masks import Limits
from .models.score import HandScore
from .select import SelectParams

_LIMITS, _SCORE, _SELECT = Limits(), HandScore(), SelectParams()


class FootholdsConfig(ServiceConfig):
    """Configuration of the foothold service; `SelectParams`, `Limits` and `HandScore` give the reasons for defaults."""

    live = (
        "window_cells", "distance_weight", "explore", "explore_seed", "trunk_step_m", "trunk_range_m", "slip_limit",
        "slope_limit", "wedge_limit", "reach_margin_m", "leg_radius_m",
    )  # fmt: skip

    smooth: bool = Field(default=True, description="3x3 median over the map: for maps with noise")
    own_map: bool = Field(
        default=False, description="choose on state/elevation, which the robot measures itself, not on terrain/map"
    )
    unsure_m: float = Field(
        default=0.03,
        gt=0,
        le=1,
        description="deviation of a height of state/elevation above which a cell is unknown, m",
    )
    window_cells: int = Field(default=_SELECT.size, ge=1, le=61, description="edge of the window, made odd")
    slip_model: str = Field(
        default="shipped",
        description="shipped: the learned model of the robot, or the hand-made score where there is none; hand-made; "
        "or the path of a model file",
    )
    distance_weight: float | None = Field(
        default=None, ge=0, le=1000, description="k of Q = P + k K4, 1/m; null = that of the model"
    )
    relearn: Literal["off", "counted", "paper"] = Field(
        default="off",
        description="learn again while walking, from the slip that the robot measures: counted by samples, or as (19)",
    )
    relearn_weight: float = Field(
        default=1.0, ge=0, le=1, description="c of re-learning, the weight of new outcomes, no unit"
    )
    relearn_every: int = Field(default=60, ge=1, le=100_000, description="outcomes of a round of re-learning")
    relearn_file: str = Field(
        default="", max_length=4096, description="file that keeps the re-learned model over restarts; empty = none"
    )
    explore: float = Field(
        default=0.0, ge=0, le=1, description="share of choices drawn at random, from cells within reach, to learn from"
    )
    explore_seed: int = Field(default=0, ge=0, lt=2**63, description="seed of choices drawn at random")
    trunk_step_m: float = Field(default=_SELECT.trunk_step, gt=0, le=0.1, description="step of proposed heights, m")
    trunk_range_m: float = Field(default=_SELECT.trunk_range, ge=0, le=0.2, description="largest proposed change, m")
    slip_limit: float = Field(default=_LIMITS.slip, ge=0, le=1, description="largest predicted slip, way per stroke")
    slope_limit: float = Field(default=_LIMITS.slope, gt=0, le=100, description="steepest ground, rise per way")
    wedge_limit: float = Field(default=_LIMITS.wedge, ge=0, le=100, description="lift by an edge, foot radii")
    reach_margin_m: float = Field(default=_LIMITS.reach_margin, ge=0, le=0.2, description="inside the workspace, m")
    leg_radius_m: float = Field(default=_LIMITS.leg_radius, ge=0, le=0.1, description="leg about its centre line, m")
    score_flat: float = Field(default=_SCORE.flat, ge=0, le=1, description="slip on flat ground, way per stroke")
    score_peak: float = Field(default=_SCORE.peak, ge=0, le=10, description="weight of peaks and top edges, no unit")
    score_hole: float = Field(default=_SCORE.hole, ge=0, le=10, description="weight of holes, no unit")
    score_face: float = Field(
        default=_SCORE.face, ge=0, le=10, description="weight of ground that falls away from the push, no unit"
    )
    score_lean: float = Field(
        default=_SCORE.lean, ge=0, le=10, description="gain of ground that faces the push, no unit"
    )
    score_rough: float = Field(default=_SCORE.rough, ge=0, le=10, description="weight of roughness, no unit")
    score_dead: float = Field(
        default=_SCORE.dead, ge=0, le=10, description="convexity and roughness held for noise, no unit"
    )

    def hand_made(self) -> HandScore:
        """Return the hand-made slip model with the weights `score_*` of this configuration."""
        return HandScore(**{each.name: getattr(self, f"score_{each.name}") for each in fields(HandScore)})

    def relearner(self, log: Callable[[str], None]) -> Relearner | None:
        """Return a new re-learner of the slip model with the settings `relearn*`; None if `relearn` is off."""
        if self.relearn == "off":
            return None
        return Relearner(RelearnParams(self.relearn, self.relearn_weight, self.relearn_every, self.relearn_file), log)

    def params(self) -> SelectParams:
        """Return the parameters of the choice of footholds that this configuration states."""
        return SelectParams(
            size=self.window_cells | 1,
            distance_weight=self.distance_weight,
            trunk_step=self.trunk_step_m,
            trunk_range=self.trunk_range_m,
            limits=Limits(
                slip=self.slip_limit,
                slope=self.slope_limit,
                wedge=self.wedge_limit,
                reach_margin=self.reach_margin_m,
                leg_radius=self.leg_radius_m,
            ),
        )
