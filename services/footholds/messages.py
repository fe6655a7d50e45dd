"""Conversion between the messages of `surefoot.schemas.footholds` and the dataclasses of the choice."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from surefoot.errors import Refusal
from surefoot.robot.description import Robot
from surefoot.schemas.footholds import (
    AssessReply,
    AssessRequest,
    FootholdChoice,
    LegFoothold,
    LegRequest,
    MaskCounts,
    ModelReply,
    RegionFoothold,
    SelectReply,
    SelectRequest,
)
from surefoot.schemas.footholds import BasePose as BaseMessage
from surefoot.schemas.hw import Tick
from surefoot.schemas.topics import TICK_NS

from .assess import Assessment, Window, whole_map, window_about
from .ground import FootholdGround
from .learning.relearner import Relearner
from .masks import REASONS
from .models.learned import LearnedModel
from .models.protocol import SlipModel
from .select import Foothold, Landing, SelectParams, TrunkPose


def base_pose(message: BaseMessage) -> TrunkPose:
    """Return the pose of base_link, frame map, that a request states."""
    return TrunkPose(message.position, message.quat_wxyz)


def asked_window(request: AssessRequest, ground: FootholdGround) -> Window:
    """Return the window of a request, or that of the whole map.

    Raises:
        Refusal: an even size, or a centre far from the map.
    """
    if request.size % 2 == 0:
        raise Refusal("invalid", f"size must be odd, got {request.size}", "size")
    if request.centre is None:
        return whole_map(ground)
    if not ground.near(*request.centre):
        raise Refusal("invalid", f"centre must lie near the map, got {request.centre}", "centre")
    return window_about(ground, *request.centre, request.size)


def select_params(
    request: SelectRequest, params: SelectParams, explore: float, draw: tuple[int, int]
) -> tuple[SelectParams, bool]:
    """Return the parameters of a choice, and whether it is drawn at random to learn from it.

    Args:
        request: request with the mode, and the seed of mode `random`.
        params: parameters of the choice of footholds, by configuration.
        explore: share of the choices in mode `robust` that are drawn at random.
        draw: seed of that draw, and number of the choice.

    Raises:
        Refusal: mode `random` without a seed.
    """
    if request.mode == "robust":
        draws = np.random.default_rng(draw) if explore > 0.0 else None
        if draws is None or draws.random() >= explore:
            return params, False
        return replace(params, seed=int(draws.integers(2**62))), True
    if request.mode == "random" and request.seed is None:
        raise Refusal("invalid", "mode random needs a seed", "seed")
    return replace(params, robust=False, seed=request.seed if request.mode == "random" else None), False


def assess_reply(
    layers: Sequence[str], ground: FootholdGround, window: Window, found: Assessment, model: str
) -> AssessReply:
    """Return the reply with the layers of a window.

    Args:
        layers: names of the layers.
        ground: map that they are of.
        window: cells that they cover.
        found: the layers, and counts of cells by reason.
        model: name of the slip model.
    """
    surface = ground.surface
    return AssessReply(
        layers=tuple(layers), rows=window.rows, cols=window.cols, cell=surface.cell,
        origin=surface.centre(window.row, window.col),
        mask_bits={name: 1 << bit for bit, name in enumerate(REASONS)}, counts=_mask_counts(found.counts),
        map_version=ground.version, model=model, data=np.ascontiguousarray(found.layers, dtype="<f4").tobytes(),
    )  # fmt: skip


def _mask_counts(counts: tuple[int, ...]) -> MaskCounts:
    """Return cells per reason, and free cells, as a message."""
    return MaskCounts(**dict(zip((*REASONS, "free"), counts, strict=True)))


def model_reply(
    model: SlipModel, weight: float | None, unfit: str, learner: Relearner | None, refused: Mapping[str, int]
) -> ModelReply:
    """Return the reply on the slip model in use, the number of outcomes for re-learning, and refusals by reason.

    Args:
        model: slip model in use.
        weight: k of the distance in the cost, 1/m, by configuration; None = the model's.
        unfit: reason why the chosen model is not in use; empty = it is.
        learner: re-learns the model; None = off.
        refused: number of refused model files by reason.
    """
    facts: dict[str, Any] = {}
    if isinstance(model, LearnedModel):
        facts = {
            "robot": model.conditions.robot, "cell": model.conditions.cell, "terms": len(model.terms.weights),
            "samples": model.size, "error": model.choice.get("error"),
            "provenance": model.provenance,
        }  # fmt: skip
    return ModelReply(
        model=model.name, distance_weight=model.distance_weight if weight is None else weight,
        landing_error=model.landing_error, unfit=unfit, outcomes=0 if learner is None else learner.taken,
        refused={**refused, **({} if learner is None else learner.refused)}, **facts,
    )  # fmt: skip


def asked_landings(legs: Sequence[LegRequest], robot: Robot, path: str = "") -> list[Landing]:
    """Return the landings of a request; `path`: field of the request that holds `legs`, for a refusal.

    Raises:
        Refusal: a leg that the robot does not have.
    """
    return [
        Landing(leg_index(robot, leg.leg, f"{path}legs.{i}.leg"), leg.nominal, leg.stroke) for i, leg in enumerate(legs)
    ]


def leg_index(robot: Robot, name: str, field: str) -> int:
    """Return the index of a leg in the robot description; `field`: of the request, for a refusal.

    Raises:
        Refusal: the robot has no leg of that name.
    """
    if name not in robot.leg_names:
        raise Refusal("unknown_leg", f"{robot.name} has the legs {', '.join(robot.leg_names)}; got {name!r}", field)
    return robot.leg_names.index(name)


def leg_foothold(asked: LegRequest, found: Foothold) -> LegFoothold:
    """Return the reply for one leg; numbers that do not exist become null."""
    return LegFoothold(**_numbers(asked, found))


def region_foothold(asked: LegRequest, found: Foothold) -> RegionFoothold:
    """Return the reply for one leg with the convex region about its foothold."""
    return RegionFoothold(**_numbers(asked, found), region=found.region)


def _numbers(asked: LegRequest, found: Foothold) -> dict[str, Any]:
    """Return the numbers of a foothold as fields of the reply for one leg."""
    point = found.foothold
    return {
        "leg": asked.leg, "status": found.status, "foothold": point, "contact": found.contact,
        "normal": found.normal, "trunk_shift": found.trunk_shift,
        "score": None if math.isnan(found.score) else found.score,
        "slip": None if math.isnan(found.slip) else found.slip,
        "spread": None if math.isnan(found.spread) else found.spread,
        "offset": None if point is None else (point[0] - asked.nominal[0], point[1] - asked.nominal[1]),
        "counts": _mask_counts(found.counts), "reason": found.reason,
    }  # fmt: skip


def choice_message(reply: SelectReply, asked: int | None, now: Tick) -> FootholdChoice:
    """Return a choice as it is published, under the tick that its request named, else under the last one."""
    tick = now.tick if asked is None else asked
    return FootholdChoice(
        legs=reply.legs, model=reply.model, explored=reply.explored, epoch=now.epoch, tick=tick,
        stamp_ns=now.stamp_ns + (tick - now.tick) * TICK_NS,
    )  # fmt: skip
