"""`stability/check` while the robot accelerates, and where gravity is doubtful."""

import json
from typing import Any

import numpy as np
import pytest

from surefoot.bus.codec import decode
from surefoot.robot.reader import load_robot
from surefoot.schemas.stability import CheckReply, CheckRequest, Contact, RegionRequest
from surefoot.services.stability.answers import check_reply, region_reply
from surefoot.services.stability.programs.contacts import ContactSet, StabilityError, contact_set
from surefoot.services.stability.regions.equilibrium import equilibrium
from surefoot.services.stability.regions.modes import lean
from tests.services.stability.sets import SQUARE, UP, as_asked, feasible_sets, tilted

RAGNO = load_robot("ragno")
FLOOR = contact_set(SQUARE, [UP] * 4, 0.8)


def ask(contacts: ContactSet, **fields: Any) -> CheckReply:
    body = json.dumps({"contacts": as_asked(contacts), **fields}).encode()
    return check_reply(decode(CheckRequest, body), RAGNO)


def test_an_acceleration_moves_the_square_by_its_share_of_the_height() -> None:
    shift = 0.3 * 2.0 / 9.81
    for lift in (0.0, 1e-7):  # exact hull, and the solver
        feet = np.array(SQUARE)
        feet[0, 2] = lift
        got = ask(
            contact_set(feet, [UP] * 4, 0.8),
            com=[0.0, 0.0], movement=[0.01, 0.0, 0.0], acceleration=[2.0, 0.0, 0.0], com_height_m=0.3,
        )  # fmt: skip
        assert got.margin_now == pytest.approx(0.1 - shift, abs=1e-6)
        assert got.margin == pytest.approx(0.11 - shift, abs=1e-6)
        assert got.extent == pytest.approx(0.1 + shift, abs=1e-6)
        assert got.gsm == pytest.approx(0.09 + shift, abs=1e-6)
        assert got.stable
        assert max(x for x, _ in got.inner) == pytest.approx(0.1 + shift, abs=1e-6)


def test_margin_and_way_against_the_balance_of_forces() -> None:
    """Nearer than the margin every place is held, beyond it one is not; likewise the way along the movement."""
    rng = np.random.default_rng(90)
    inside = 0
    for contacts in feasible_sets(91, 12, (3, 7)):
        push, height = rng.uniform(-1.0, 1.0, 3), 0.5
        middle = contacts.position[:, :2].mean(axis=0)
        got = ask(
            contacts, com=middle.tolist(), movement=[0.02, 0.01, 0.0], acceleration=push.tolist(), com_height_m=height
        )
        seen = lean(contacts, np.array([0.0, 0.0, 9.81]) + push)

        def held(c: np.ndarray, seen: Any = seen, height: float = height) -> bool:
            return equilibrium(seen.contacts, seen.seen(np.append(c, height))).held

        if got.margin_now is None or got.margin_now <= 0.0:
            continue
        inside += 1
        angle = np.linspace(0.0, 2.0 * np.pi, 720, endpoint=False)
        circle = np.column_stack((np.cos(angle), np.sin(angle)))
        assert all(held(middle + (got.margin_now - 1e-6) * a) for a in circle[::30])
        assert not all(held(middle + (got.margin_now * 1.0001 + 1e-6) * a) for a in circle)
        assert got.extent is not None
        ahead = np.array([2.0, 1.0]) / np.sqrt(5.0)
        assert held(middle + (got.extent - 1e-6) * ahead)
        assert not held(middle + (got.extent + 1e-6) * ahead)
        assert got.gsm == pytest.approx(got.extent - 0.01 * np.sqrt(5.0), abs=1e-7)
    assert inside > 4


def test_doubtful_gravity_takes_its_share_of_the_height() -> None:
    reach = 0.1 - 0.2 * np.tan(0.1)
    got = ask(FLOOR, com=[0.0, 0.0], movement=[0.02, 0.0, 0.0], tilt_rad=0.1, com_height_m=0.2)
    assert got.margin_now == pytest.approx(reach, abs=1e-9)
    assert got.margin == pytest.approx(reach - 0.02, abs=1e-9)
    assert got.extent == pytest.approx(reach, abs=1e-9)
    assert np.abs(got.inner).max() == pytest.approx(reach, abs=1e-9)
    slope = contact_set([[x, y, np.tan(0.5) * x] for x, y, _ in SQUARE], [tilted(np.degrees(0.5))] * 4, 0.6)
    assert ask(slope, com=[0.0, 0.0]).stable
    fallen = ask(slope, com=[0.0, 0.0], tilt_rad=0.1)  # atan 0.6 = 0.54
    assert (fallen.stable, fallen.margin, fallen.status) == (False, None, "infeasible")


def test_gravities_whose_regions_share_no_place_leave_no_margin() -> None:
    high = ask(FLOOR, com=[0.0, 0.0], movement=[0.02, 0.0, 0.0], tilt_rad=0.4, com_height_m=1.0)
    assert (high.status, high.stable, high.margin, high.margin_now) == ("infeasible", False, None, None)
    assert (high.extent, high.gsm, high.extent_status, high.gsm_status) == (None, None, "infeasible", "infeasible")


@pytest.mark.parametrize(("com", "margin"), [((0.0, 0.3), 0.3), ((3.0, 0.1), 0.1), ((0.0, -0.2), -0.2)])
def test_a_region_that_walls_make_endless_has_the_margin_to_its_edge(com: tuple[float, float], margin: float) -> None:
    normals = [(1.0, 0.0, 0.0), (-1.0, 0.0, 0.0), UP]
    got = ask(contact_set([(-0.4, 0.0, 0.0), (0.4, 0.0, 0.0), (0.0, 0.2, 0.0)], normals, 0.5), com=com)
    assert (got.status, got.stable) == ("unbounded", False)
    assert got.margin == pytest.approx(margin, abs=1e-6)


def test_margins_are_those_of_the_least_favourable_gravity() -> None:
    for contacts in feasible_sets(92, 6, (4, 7)):
        c = (contacts.position[:, :2].mean(axis=0) + np.array([0.01, 0.0])).tolist()
        level, doubtful = ask(contacts, com=c, com_height_m=0.5), ask(contacts, com=c, com_height_m=0.5, tilt_rad=0.03)
        assert level.margin is not None
        assert doubtful.margin is None or doubtful.margin < level.margin + 1e-9
        still = ask(
            contacts, com=c, com_height_m=0.5, acceleration=[0.0, 0.0, 1.0]
        )  # upwards: more weight, same places
        assert still.margin == pytest.approx(level.margin, abs=1e-8)


def test_the_region_is_that_of_the_region_query() -> None:
    contacts = feasible_sets(93, 1)[0]
    fields = {"acceleration": [0.5, 0.2, 0.0], "com_height_m": 0.4, "directions": 16, "certificates": True}
    got = ask(contacts, com=[1.0, 2.0], **fields)
    given = json.dumps({"contacts": [c.model_dump() for c in requests_of(contacts)], **fields}).encode()
    same = region_reply(decode(RegionRequest, given), RAGNO)
    assert (got.inner, got.outer, got.support, got.gap) == (same.inner, same.outer, same.support, same.gap)
    assert ask(contacts, com=[1.0, 2.0], polygons=False, **fields).support == ()


def requests_of(contacts: ContactSet) -> tuple[Any, ...]:
    rows = zip(contacts.position.tolist(), contacts.normal.tolist(), contacts.mu.tolist(), strict=True)
    return tuple(Contact(position=tuple(p), normal=tuple(n), mu=mu) for p, n, mu in rows)


@pytest.mark.parametrize(
    ("fields", "field"),
    [
        ({"acceleration": [0.0, 0.0, -9.81]}, "acceleration"),
        ({"acceleration": [1.0, 0.0, 0.0], "gradient": True}, "gradient"),
        ({"tilt_rad": 0.1, "doubt": {"com_sd_m": 0.01}}, "doubt"),
        ({"tilt_rad": 0.1, "directions": 16}, "directions"),
    ],
)
def test_refused(fields: dict[str, Any], field: str) -> None:
    with pytest.raises(StabilityError) as refused:
        ask(FLOOR, com=[0.0, 0.0], **fields)
    assert refused.value.field == field
