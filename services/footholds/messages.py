"""Between the messages of `surefoot.schemas.footholds` and the dataclasses of the choice."""

import math
from collections.abc import Mapping

from surefoot.schemas.footholds import BasePose as BaseMessage
from surefoot.schemas.footholds import LegFoothold, LegRequest, MaskCounts, ModelReply

from .masks import REASONS
from .models.learned import LearnedModel
from .models.protocol import SlipModel
from .relearner import Relearner
from .select import Foothold, TrunkPose


def base_pose(message: BaseMessage) -> TrunkPose:
    """The pose of a request."""
    return TrunkPose(message.position, message.quat_wxyz)


def mask_bits() -> dict[str, int]:
    """Value of each reason in a mask."""
    return {name: 1 << bit for bit, name in enumerate(REASONS)}


def mask_counts(counts: tuple[int, ...]) -> MaskCounts:
    """Cells per reason, then free cells."""
    return MaskCounts(**dict(zip((*REASONS, "free"), counts, strict=True)))


def model_reply(
    model: SlipModel, weight: float | None, unfit: str, learner: Relearner | None, refused: Mapping[str, int]
) -> ModelReply:
    """The slip model in force, what re-learning has taken in, and what was refused, by reason."""
    shared = ModelReply(
        model=model.name,
        distance_weight=model.distance_weight if weight is None else weight,
        landing_error=model.landing_error,
        unfit=unfit,
        outcomes=0 if learner is None else learner.taken,
        refused={**refused, **({} if learner is None else learner.refused)},
    )
    if not isinstance(model, LearnedModel):
        return shared
    told = {
        "robot": model.conditions.robot,
        "cell": model.conditions.cell,
        "terms": len(model.terms.weights),
        "samples": round(sum(each.count for each in model.bins.values())),
        "error": model.choice.get("error"),
        "provenance": model.provenance,
    }
    return shared.model_copy(update=told)


def leg_foothold(asked: LegRequest, found: Foothold) -> LegFoothold:
    """The reply for one leg; numbers that do not exist become null."""
    point = found.foothold
    return LegFoothold(
        leg=asked.leg,
        status=found.status,
        foothold=point,
        contact=found.contact,
        normal=found.normal,
        trunk_shift=found.trunk_shift,
        score=None if math.isnan(found.score) else found.score,
        slip=None if math.isnan(found.slip) else found.slip,
        spread=None if math.isnan(found.spread) else found.spread,
        offset=None if point is None else (point[0] - asked.nominal[0], point[1] - asked.nominal[1]),
        counts=mask_counts(found.counts),
        reason=found.reason,
    )
