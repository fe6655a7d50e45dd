"""Footholds of many steps at once: the same as one by one, with the free ground about them."""

from concurrent.futures import Future
from typing import Any

import numpy as np
import pytest
from pydantic import ValidationError

from surefoot.background import MOST_WAITING
from surefoot.errors import Refusal
from surefoot.schemas.footholds import AssessRequest, BasePose, FootholdsBatchReply, FootholdsBatchRequest, LegFoothold
from surefoot.services.footholds.config import FootholdsConfig
from surefoot.services.footholds.service import Footholds
from tests.services.footholds.grounds import CELL, STROKE
from tests.services.footholds.test_footholds_service import BASE, asked, give, message
from tests.services.refusals import refused

CONFIG = FootholdsConfig()
WAIT_S = 60.0
LEGS = ("lf", "rm", "lh")


@pytest.fixture
def planned(service: Footholds) -> Footholds:
    """The service with a map of rough ground."""
    give(service, message(np.random.default_rng(5).normal(0.0, 0.004, (160, 200)), version=4))
    return service


def steps(**changes: Any) -> FootholdsBatchRequest:
    legs = asked(*LEGS).legs
    poses = [BasePose(position=(x, 0.01 * k, BASE.position[2])) for k, x in enumerate((0.0, 0.004, -0.013))]
    usual = [{"base": pose, "legs": legs[: 1 + k]} for k, pose in enumerate(poses)]
    return FootholdsBatchRequest(**({"steps": usual} | changes))


def answer(service: Footholds, request: FootholdsBatchRequest) -> FootholdsBatchReply:
    return service.batch(request).result(WAIT_S)


@pytest.mark.parametrize("mode", ["robust", "paper"])
def test_a_step_of_a_batch_is_answered_like_a_choice_by_itself(planned: Footholds, mode: str) -> None:
    request = steps(mode=mode)
    reply = answer(planned, request)
    assert (reply.map_version, reply.model) == (4, planned.models.active.name)
    assert len(reply.steps) == len(request.steps)
    for step, found in zip(request.steps, reply.steps, strict=True):
        one = planned.select(asked(mode=mode, base=step.base, legs=step.legs))
        plain = [LegFoothold(**leg.model_dump(exclude={"region"})) for leg in found.legs]
        assert tuple(plain) == one.legs


def test_the_region_holds_the_foothold_and_nothing_but_free_cells(planned: Footholds) -> None:
    request, seen = steps(), 0
    for step, found in zip(request.steps, answer(planned, request).steps, strict=True):
        for leg, reply in zip(step.legs, found.legs, strict=True):
            if reply.status != "ok":
                assert reply.region == () or reply.status == "raise_trunk"
                continue
            assess = AssessRequest(centre=leg.nominal[:2], leg=leg.leg, base=step.base, stroke=STROKE, layers=("mask",))
            window = planned.assess(assess)
            free = np.frombuffer(window.data, dtype="<f4").reshape(window.rows, window.cols) == 0
            (left, low), (right, _), (_, high), _ = reply.region
            cols, rows = (
                [round((value - origin) / CELL) for value in ends]
                for ends, origin in zip(((left, right), (low, high)), window.origin, strict=True)
            )
            assert free[rows[0] : rows[1] + 1, cols[0] : cols[1] + 1].all()
            x, y = reply.foothold[:2]
            assert left - 0.5 * CELL - 1e-9 <= x <= right + 0.5 * CELL + 1e-9
            assert low - 0.5 * CELL - 1e-9 <= y <= high + 0.5 * CELL + 1e-9
            seen += 1
    assert seen >= 3


def test_a_batch_is_no_choice(planned: Footholds, monkeypatch: pytest.MonkeyPatch) -> None:
    sent: list[object] = []
    monkeypatch.setattr(planned, "publish", lambda *given: sent.append(given))
    before = planned.choose(asked(*LEGS))
    answer(planned, steps())
    assert planned.choose(asked(*LEGS)) == before
    assert len(sent) == 2


def test_legs_and_counts_that_cannot_be_are_refused_at_once(planned: Footholds) -> None:
    with refused(Refusal, "unknown_leg", "steps.1.legs.0.leg"):
        planned.batch(steps(steps=[{"base": BASE, "legs": asked(leg).legs} for leg in ("lf", "tail")]))
    one = {"base": BASE, "legs": asked("lf").legs}
    for wrong in ([], [one] * 65):
        with pytest.raises(ValidationError, match="steps"):
            steps(steps=wrong)
    with pytest.raises(ValidationError, match="mode"):
        steps(mode="random")


def test_a_batch_before_the_map_is_refused(service: Footholds) -> None:
    with refused(Refusal, "not_ready"):
        service.batch(steps())


def test_more_batches_than_may_wait_are_refused(planned: Footholds) -> None:
    one = {"base": BASE, "legs": asked(*LEGS).legs}
    waiting: list[Future[FootholdsBatchReply]] = []
    with refused(Refusal, "busy"):
        for _ in range(100 * MOST_WAITING):
            waiting.append(planned.batch(steps(steps=[one] * 64)))
    assert len(waiting) >= MOST_WAITING
    assert all(len(found.result(WAIT_S).steps) == 64 for found in waiting)
