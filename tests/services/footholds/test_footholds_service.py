"""The service around the choice: latched map, queries, refusals."""

import json
from typing import Any

import numpy as np
import pytest
from pydantic import ValidationError

from surefoot.errors import CallError, Refusal
from surefoot.geometry.heightmap import HeightMap
from surefoot.lockstep.join import TickInputs
from surefoot.schemas.footholds import AssessRequest, BasePose, FootholdChoice, LegRequest, SelectRequest
from surefoot.schemas.hw import Tick
from surefoot.schemas.terrain import HeightMapMessage
from surefoot.schemas.topics import FOOTHOLDS_ASSESS, FOOTHOLDS_CHOSEN, FOOTHOLDS_SELECT, TERRAIN_MAP
from surefoot.services.footholds.config import FootholdsConfig
from surefoot.services.footholds.service import SERVICE, Footholds
from tests.services.footholds.grounds import CELL, STROKE, flat, neutral, ragno
from tests.services.refusals import refused

CONFIG = FootholdsConfig(slip_model="hand-made")
BASE = BasePose(position=(0.0, 0.0, 0.008 - float(neutral(0)[2])))


def message(z: np.ndarray, version: int = 3) -> HeightMapMessage:
    heights = HeightMap(z=z.astype(np.float32), cell=CELL, origin=(-0.5, -0.4), version=version)
    return HeightMapMessage(**heights.header(), data=heights.to_bytes())


def give(service: Footholds, terrain: HeightMapMessage) -> None:
    tick = Tick.model_construct(tick=0, epoch=0)
    service.on_tick(TickInputs(tick, {TERRAIN_MAP.key: terrain}))


def asked(*legs: str, **changes: Any) -> SelectRequest:
    names = [leg.name for leg in ragno().legs]
    requests = tuple(
        LegRequest(leg=leg, nominal=tuple(neutral(names.index(leg))), stroke=STROKE) if leg in names
        else LegRequest(leg=leg, nominal=(0, 0, 0), stroke=STROKE)
        for leg in legs
    )  # fmt: skip
    return SelectRequest(**({"base": BASE, "legs": requests} | changes))


def test_discovered_by_its_name() -> None:
    assert SERVICE.name == "footholds"


def test_all_six_legs_in_one_request(service: Footholds) -> None:
    give(service, message(flat(), version=5))
    names = [leg.name for leg in ragno().legs]
    reply = service.select(asked(*names))
    assert [leg.leg for leg in reply.legs] == names
    assert (reply.map_version, reply.model) == (5, "hand-made/1")
    for index, leg in enumerate(reply.legs):
        assert leg.status == "ok"
        assert leg.foothold == pytest.approx((*neutral(index)[:2], 0.008), abs=1e-7)
        assert leg.contact == pytest.approx((*neutral(index)[:2], 0.0), abs=1e-7)
        assert leg.offset == pytest.approx((0.0, 0.0))
        assert leg.counts.free + leg.counts.reach >= 225
    json.loads(reply.model_dump_json())


def test_infeasible_has_nulls_not_nan(service: Footholds) -> None:
    give(service, message(np.full((160, 200), np.nan)))
    leg = service.select(asked("lf")).legs[0]
    assert leg.status == "infeasible"
    assert (leg.foothold, leg.contact, leg.normal, leg.score, leg.slip, leg.offset) == (None,) * 6
    assert leg.counts.unknown == 225


def test_paper_mode_is_the_best_single_cell(service: Footholds) -> None:
    z = np.random.default_rng(2).normal(0, 0.003, (160, 200))
    give(service, message(z))
    names = [leg.name for leg in ragno().legs]
    robust, paper = (service.select(asked(*names, mode=mode)).legs for mode in ("robust", "paper"))
    scores = [(one.score or 0.0, best.score or 0.0) for one, best in zip(robust, paper, strict=True)]
    assert all(best <= one for one, best in scores)
    assert any(best < one for one, best in scores)


def test_over_the_bus(service: Footholds) -> None:
    bus = service.runtime.bus  # type: ignore[attr-defined]
    with refused(CallError, "not_ready"):
        bus.call(FOOTHOLDS_SELECT, asked("lf"))
    give(service, message(flat()))
    assert bus.call(FOOTHOLDS_SELECT, asked("lf")).legs[0].status == "ok"
    reply = bus.call(FOOTHOLDS_ASSESS, AssessRequest(centre=(0.0, 0.0), layers=("z",)))
    assert len(reply.data) == 4 * 15 * 15
    assert reply.counts.free == 225


def test_a_choice_is_published_under_the_tick_of_its_request(service: Footholds) -> None:
    bus = service.runtime.bus  # type: ignore[attr-defined]
    heard: list[FootholdChoice] = []
    bus.subscribe(FOOTHOLDS_CHOSEN, lambda delivery: heard.append(delivery.message()))
    tick = Tick.model_construct(tick=12, epoch=4, stamp_ns=120_000_000)
    service.on_tick(TickInputs(tick, {TERRAIN_MAP.key: message(flat())}))
    reply = service.choose(asked("lf", "rm", tick=9, epoch=4))
    (choice,) = heard
    assert (choice.epoch, choice.tick, choice.stamp_ns, choice.source) == (4, 9, 90_000_000, "footholds")
    assert (choice.legs, choice.model) == (reply.legs, reply.model)


def test_no_map_is_not_ready_and_a_new_epoch_forgets(service: Footholds) -> None:
    for _ in range(2):
        with refused(Refusal, "not_ready"):
            service.select(asked("lf"))
        give(service, message(flat()))
        service.select(asked("lf"))
        service.on_reset()


def test_a_wrong_map_is_no_map(mapped: Footholds) -> None:
    give(mapped, message(flat()).model_copy(update={"data": b"short"}))
    with pytest.raises(Refusal):
        mapped.select(asked("lf"))


def test_unknown_leg_is_named(mapped: Footholds) -> None:
    with refused(Refusal, "unknown_leg", "legs.1.leg"):
        mapped.select(asked("lf", "tail"))


@pytest.mark.parametrize(
    "changes",
    [
        {"legs": ()},
        {"speed": 1},
        {"mode": "best"},
        {"base": {"position": [0, 0, float("nan")]}},
        {"base": {"position": [0, 0]}},
        {"base": {"position": [0, 0, 0.1], "yaw": 0.1}},
    ],
)
def test_wrong_requests_do_not_validate(changes: dict[str, object]) -> None:
    with pytest.raises(ValidationError):
        asked("lf", **changes)


def test_assess_window_and_map(mapped: Footholds) -> None:
    reply = mapped.assess(AssessRequest(centre=(0.1, 0.1), size=15, layers=("p", "q", "mask")))
    assert (reply.rows, reply.cols, reply.layers, reply.map_version) == (15, 15, ("p", "q", "mask"), 3)
    layers = np.frombuffer(reply.data, "<f4").reshape(3, 15, 15)
    assert layers[0] == pytest.approx(0.04)
    assert 0.04 < layers[1, 7, 7] < layers[1, 7, 9]  # the mean over 3 x 3 cells
    assert reply.counts.free == 225
    assert reply.origin == pytest.approx((0.1 - 7 * CELL, 0.1 - 7 * CELL))
    whole = mapped.assess(AssessRequest(layers=("k1",)))
    assert (whole.rows, whole.cols, len(whole.data)) == (160, 200, 4 * 160 * 200)


def test_assess_for_a_leg(mapped: Footholds) -> None:
    x, y = float(neutral(0)[0]), float(neutral(0)[1])
    reply = mapped.assess(AssessRequest(centre=(x, y), size=61, leg="lf", base=BASE))
    assert 0 < reply.counts.reach < 61 * 61
    assert reply.mask_bits == {"reach": 1, "collision": 2, "unknown": 4, "steep": 8, "slip": 16, "unlearned": 32}


@pytest.mark.parametrize(
    ("request_", "field"),
    [
        (AssessRequest(centre=(0.0, 0.0), size=14), "size"),
        (AssessRequest(centre=(1e30, 0.0)), "centre"),
        (AssessRequest(centre=(0.0, 0.0), leg="lf"), "base"),
        (AssessRequest(centre=(0.0, 0.0), leg="tail", base=BASE), "leg"),
    ],
)
def test_wrong_assessments_name_the_field(mapped: Footholds, request_: AssessRequest, field: str) -> None:
    with refused(Refusal, field=field):
        mapped.assess(request_)


def test_same_map_is_prepared_once(service: Footholds, monkeypatch: pytest.MonkeyPatch) -> None:
    terrain, built = message(flat()), []
    monkeypatch.setattr("surefoot.services.footholds.latched.build_ground", lambda *a: built.append(a))
    for _ in range(3):
        give(service, terrain)
    give(service, message(flat(), version=4))
    assert len(built) == 2


@pytest.mark.parametrize(
    "changes", [{"distance_weight": -1.0}, {"distance_weight": float("nan")}, {"explore": 1.5}, {"slip_limit": -0.1}]
)
def test_wrong_settings_are_refused(changes: dict[str, float]) -> None:
    with pytest.raises(ValidationError):
        FootholdsConfig(**changes)  # type: ignore[arg-type]


def test_configuration_reaches_the_choice() -> None:
    config = FootholdsConfig(slip_limit=0.3, score_flat=0.35, window_cells=8)
    assert (config.params().limits.slip, config.params().size) == (0.3, 9)
    assert config.hand_made().flat == 0.35
    assert FootholdsConfig().params().limits.reach_margin == 0.010
