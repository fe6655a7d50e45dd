"""`stability/check` with limited torques."""

import json
from typing import Any

import numpy as np
import pytest

from surefoot.arrays import Array
from surefoot.bus.codec import decode
from surefoot.robot.kinematics import gravity_torques
from surefoot.schemas.stability import CheckReply, CheckRequest, RegionRequest
from surefoot.services.stability.answers import check_reply, region_reply
from surefoot.services.stability.programs.contacts import ContactSet, StabilityError, equally_spaced
from surefoot.services.stability.regions.actuated import ServoLegs, actuated_region
from surefoot.services.stability.sensing.posture import PosedRobot, contact_jacobians
from tests.services.stability.regions.test_actuated import RADIUS, RAGNO, TRIPOD, UP, stance
from tests.services.stability.sets import as_asked

LIMIT = 0.55
BODY = {"joints": RAGNO.neutral.tolist(), "max_torque_nm": LIMIT}
MANY = equally_spaced(360)


def ask(contacts: ContactSet, **fields: Any) -> CheckReply:
    body = json.dumps({"contacts": as_asked(contacts), "actuation": BODY, **fields}).encode()
    return check_reply(decode(CheckRequest, body), RAGNO)


def true_margin(contacts: ContactSet, legs: ServoLegs, c: Array) -> float:
    """Least h(a) - a'c over many directions: not by polygons, and never less than the margin."""
    return float((actuated_region(contacts, legs, MANY).support.value - MANY @ c).min())


def test_without_a_movement_the_margin_is_that_of_the_region_query() -> None:
    contacts, legs = stance(TRIPOD, LIMIT)
    c = contacts.position[:, :2].mean(axis=0)
    got = ask(contacts, com=c.tolist(), directions=64, certificates=True)
    given = {"contacts": as_asked(contacts), "actuation": BODY, "directions": 64, "certificates": True}
    same = region_reply(decode(RegionRequest, json.dumps(given).encode()), RAGNO)
    assert (got.inner, got.outer, got.support, got.gap) == (same.inner, same.outer, same.support, same.gap)
    assert got.gap is not None
    assert got.margin is not None
    assert (got.margin, got.gsm, got.extent) == (got.margin_now, None, None)
    wanted = true_margin(contacts, legs, c)
    assert wanted - got.gap - 1e-7 <= got.margin <= wanted + 1e-7
    assert got.stable == (got.margin >= 0.0)
    assert ask(contacts, com=c.tolist(), polygons=False).inner == ()


def test_generous_torques_leave_the_check_as_it_is() -> None:
    contacts, _ = stance(TRIPOD, 1e3)
    movement = [0.01, -0.005, 0.0]
    strong = ask(contacts, movement=movement, actuation=BODY | {"max_torque_nm": 1e3}, directions=128)
    body = {"contacts": as_asked(contacts), "movement": movement, "joints": BODY["joints"]}
    free = check_reply(decode(CheckRequest, json.dumps(body).encode()), RAGNO)
    assert (strong.com, strong.shift, strong.com_after) == (free.com, free.shift, free.com_after)
    assert (strong.stance, strong.reachable, strong.stable) == (free.stance, free.reachable, free.stable)
    for name in ("margin", "margin_now", "extent", "gsm"):
        assert getattr(strong, name) == pytest.approx(getattr(free, name), abs=1e-6), name


def test_margin_after_the_movement_is_that_of_the_posture_after_it() -> None:
    contacts, legs = stance(TRIPOD, LIMIT)
    movement = np.array([0.05, 0.0, 0.0])
    got = ask(contacts, movement=movement.tolist(), directions=64)
    standing = np.isin(np.arange(6), TRIPOD)
    joints = PosedRobot(RAGNO, RAGNO.neutral, np.zeros(3), np.eye(3)).moved(movement, standing).after.joints
    jacobian = contact_jacobians(RAGNO.model, joints, UP, RADIUS)[TRIPOD]
    own = gravity_torques(RAGNO.model, joints, 9.81 * UP)[RAGNO.model.leg_joints[TRIPOD]]
    after = ServoLegs(jacobian, own, legs.limit, legs.weight)
    c, gap = np.array(got.com_after), got.gap
    assert gap is not None
    assert got.margin is not None
    assert got.margin_now is not None
    wanted = true_margin(contacts, after, c)
    assert wanted - gap - 1e-7 <= got.margin <= wanted + 1e-7
    assert abs(true_margin(contacts, legs, c) - wanted) > 1e-3  # of the posture now it would be another
    assert got.margin_now == pytest.approx(ask(contacts, directions=64).margin, abs=1e-12)
    assert got.gsm is not None
    edge = c + got.gsm * np.array([1.0, 0.0])
    assert true_margin(contacts, after, edge) == pytest.approx(0.0, abs=gap + 1e-6)


def test_weak_servos_hold_nothing() -> None:
    contacts, _ = stance(TRIPOD, LIMIT)
    got = ask(contacts, movement=[0.01, 0.0, 0.0], actuation=BODY | {"max_torque_nm": 0.01})
    assert (got.status, got.stable, got.margin, got.extent_status) == ("infeasible", False, None, "infeasible")


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("joints", BODY["joints"]),
        ("base", {"position": [0.0, 0.0, 0.1]}),
        ("robot", "ragno"),
        ("adaptive", True),
        ("acceleration", [0.1, 0.0, 0.0]),
        ("acceleration", [0.0, 0.0, 0.1]),
        ("tilt_rad", 0.1),
        ("doubt", {"com_sd_m": 0.01}),
        ("doubt", {}),
        ("gradient", True),
    ],
)
def test_what_makes_no_sense_with_limited_torques_is_refused(field: str, value: Any) -> None:
    contacts, _ = stance(TRIPOD, LIMIT)
    with pytest.raises(StabilityError) as refused:
        ask(contacts, **{field: value})
    assert (refused.value.field, refused.value.code) == (field, "unsupported")


def test_a_posture_that_does_not_fit_is_refused_by_its_field() -> None:
    contacts, _ = stance(TRIPOD, LIMIT)
    for body, field in (
        ({"joints": [0.0]}, "actuation.joints"),
        (BODY | {"robot": "nobody"}, "actuation.robot"),
        (BODY | {"max_torque_nm": [1.0]}, "actuation.max_torque_nm"),
        (BODY | {"base": {"position": [0.0, 0.0, 0.5]}}, "contacts.0.leg"),
    ):
        with pytest.raises(StabilityError) as refused:
            ask(contacts, actuation=body)
        assert refused.value.field == field
