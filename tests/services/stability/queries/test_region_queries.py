"""`stability/region` beyond rest: acceleration, doubtful gravity, limited torques; gradient of `stability/check`."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from surefoot.errors import Refusal
from surefoot.geometry.rotations import matrix_from_quat
from surefoot.robot.kinematics import foot_positions
from surefoot.robot.reader import load_robot, robot_file
from surefoot.services.stability.programs.contacts import contact_set, equally_spaced
from surefoot.services.stability.regions.actuated import actuated_region
from surefoot.services.stability.regions.equilibrium import equilibrium
from surefoot.services.stability.regions.margin import margin
from surefoot.services.stability.regions.modes import lean
from surefoot.services.stability.regions.region import region
from surefoot.services.stability.regions.robust import margin_gradient
from surefoot.services.stability.service import Stability
from tests.services.stability.conftest import ask
from tests.services.stability.regions.test_actuated import stance
from tests.services.stability.sets import SQUARE, UP, as_asked, feasible_sets

RAGNO = load_robot("ragno")
FLOOR = [{"position": p, "normal": UP, "mu": 0.8} for p in SQUARE]
QUAT = [0.9689124, 0.0, 0.0, 0.2474040]


# -- acceleration ------------------------------------------------------------------------------------------------------


def test_acceleration_moves_the_region_by_its_share_of_the_height(service: Stability) -> None:
    got = ask(service, "region", contacts=FLOOR, acceleration=[2.0, 0.0, 0.0], com_height_m=0.3, directions=4)
    shift = 0.3 * 2.0 / 9.81
    reach = [(s["direction"], s["value"]) for s in got["support"]]
    for (direction, value), wanted in zip(reach, (0.1 + shift, 0.1, 0.1 - shift, 0.1), strict=True):
        assert value == pytest.approx(wanted, abs=1e-8), direction
    assert got["area"] == pytest.approx(0.04, abs=1e-8)
    assert ask(service, "region", contacts=FLOOR, acceleration=[8.0, 0.0, 0.0])["status"] == "infeasible"
    still = ask(service, "region", contacts=FLOOR, com_height_m=0.3)
    assert still == ask(service, "region", contacts=FLOOR)


def test_values_and_proofs_of_a_moving_region(service: Stability) -> None:
    """Against the balance of forces just inside and outside, and the two proofs, for random sets."""
    rng, seen = np.random.default_rng(3), 0
    for contacts in feasible_sets(42, 6):
        push, h = rng.uniform(-1.0, 1.0, 3), 0.2
        up = np.array([0.0, 0.0, 9.81]) + push
        got = ask(
            service, "region", contacts=as_asked(contacts), acceleration=push.tolist(), com_height_m=h, directions=7,
            certificates=True,
        )  # fmt: skip
        if got["status"] != "ok":
            continue
        leaning, middle = lean(contacts, up), np.mean(got["inner"], axis=0)
        for s in got["support"]:
            seen += 1
            a, point = np.array(s["direction"]), np.array(s["point"])
            assert a @ point == pytest.approx(s["value"], abs=1e-7)
            inward = point + 1e-4 * (middle - point)
            assert equilibrium(leaning.contacts, leaning.seen(np.append(inward, h))).held
            assert not equilibrium(leaning.contacts, leaning.seen(np.append(point + 1e-4 * a, h))).held
            force = np.array(s["forces"])
            np.testing.assert_allclose(force.sum(axis=0), up / 9.81, atol=1e-7)
            np.testing.assert_allclose(
                np.cross(contacts.position, force).sum(axis=0), np.cross(np.append(point, h), up / 9.81), atol=1e-7
            )
            v, spin = np.array(s["twist"][:3]), np.array(s["twist"][3:])
            u = v + np.cross(spin, contacts.position)
            lift = np.einsum("ij,ij->i", contacts.normal, u)
            slip = np.linalg.norm(u - lift[:, None] * contacts.normal, axis=1)
            assert (lift - contacts.mu * slip).min() > -1e-7
            assert up @ (v + np.cross(spin, np.append(point, h))) == pytest.approx(0.0, abs=1e-5)
    assert seen > 10


def test_proof_that_a_moving_robot_slips(service: Stability) -> None:
    got = ask(service, "region", contacts=FLOOR, acceleration=[8.0, 0.0, 0.0])
    v, spin = np.array(got["twist"][:3]), np.array(got["twist"][3:])
    u = v + np.cross(spin, np.array(SQUARE))
    assert (u[:, 2] - 0.8 * np.hypot(u[:, 0], u[:, 1])).min() > -1e-9
    assert v @ [8.0, 0.0, 9.81] < 0.0
    assert np.abs(spin[:2]).max() < 1e-9


# -- doubtful gravity --------------------------------------------------------------------------------------------------


def test_doubtful_gravity_takes_a_margin_of_its_share_of_the_height(service: Stability) -> None:
    got = ask(service, "region", contacts=FLOOR, tilt_rad=0.1, com_height_m=0.3)
    left = 2.0 * (0.1 - 0.3 * np.tan(0.1))
    assert got["status"] == "ok"
    assert got["area"] == pytest.approx(left**2, rel=1e-6)
    assert got["area"] <= got["area_outer"]
    assert got["support"] == []
    assert ask(service, "region", contacts=FLOOR, tilt_rad=0.7)["status"] == "infeasible"
    assert ask(service, "region", contacts=FLOOR, tilt_rad=0.4, com_height_m=0.5)["status"] == "infeasible"
    pushed = ask(service, "region", contacts=FLOOR, tilt_rad=0.1, com_height_m=0.3, acceleration=[1.0, 0.0, 0.0])
    assert np.mean(pushed["inner"], axis=0)[0] > 0.02


# -- limited torques ---------------------------------------------------------------------------------------------------


def test_limited_torques(service: Stability) -> None:
    chosen = [0, 2, 4]
    contacts, legs = stance(chosen, 0.7)
    wanted = actuated_region(contacts, legs, equally_spaced(16))
    body = {"joints": RAGNO.neutral.tolist(), "max_torque_nm": 0.7}
    got = ask(service, "region", contacts=as_asked(contacts), actuation=body, certificates=True)
    assert got["status"] == "ok"
    np.testing.assert_allclose([s["value"] for s in got["support"]], wanted.support.value, atol=1e-9)
    assert np.abs([s["torques"] for s in got["support"]]).max() <= 0.7 + 1e-6
    assert got["area"] <= got["area_outer"]
    free = ask(service, "region", contacts=as_asked(contacts))
    assert got["area"] < 0.97 * free["area"]
    each = ask(service, "region", contacts=as_asked(contacts), actuation=body | {"max_torque_nm": [0.7] * 18})
    assert each["inner"] == got["inner"]
    own = ask(service, "region", contacts=as_asked(contacts), actuation={"joints": body["joints"]}, directions=3)
    assert [s["status"] for s in own["support"]] == ["ok"] * 3
    weak = ask(service, "region", contacts=as_asked(contacts), actuation=body | {"max_torque_nm": 0.01})
    assert (weak["status"], weak["inner"], weak["area"]) == ("infeasible", [], 0.0)
    assert ask(service, "region", contacts=[], actuation=body)["status"] == "infeasible"
    half = ask(service, "region", contacts=as_asked(contacts), actuation=body, directions=[[1, 0], [0, 1]])
    assert (half["status"], half["area"], len(half["support"])) == ("ok", pytest.approx(got["area"], abs=1e-9), 2)
    np.testing.assert_allclose([s["value"] for s in half["support"]], wanted.support.value[[0, 4]], atol=1e-9)


def test_limited_torques_turn_with_the_robot(service: Stability) -> None:
    """Another place and heading: the same region there; legs by name or by nearest foot."""
    contacts, _ = stance([0, 1, 3, 4], 1.0)
    body = {"joints": RAGNO.neutral.tolist(), "max_torque_nm": 0.6}
    here = ask(service, "region", contacts=as_asked(contacts), actuation=body)
    rot = matrix_from_quat(np.array(QUAT) / np.linalg.norm(QUAT))
    moved = contact_set(contacts.position @ rot.T + [0.5, -0.2, 0.1], contacts.normal, contacts.mu)
    asked = as_asked(moved)
    asked[2]["leg"] = RAGNO.legs[3].name
    turned = {"position": [0.5, -0.2, 0.1], "quat_wxyz": QUAT}
    directions = (equally_spaced(16) @ rot[:2, :2].T).tolist()
    there = ask(service, "region", contacts=asked, actuation=body | {"base": turned}, directions=directions)
    values = [s["value"] for s in here["support"]] + np.array(directions) @ [0.5, -0.2]
    np.testing.assert_allclose([s["value"] for s in there["support"]], values, atol=1e-7)


# -- gradient ----------------------------------------------------------------------------------------------------------


def test_gradient_of_the_margin(service: Stability) -> None:
    contacts = feasible_sets(43, 1)[0]
    com = contacts.position[:, :2].mean(axis=0)
    found = region(contacts)
    here = margin(found, com)
    wanted = margin_gradient(found, com, here)
    assert wanted is not None
    fields = {"contacts": as_asked(contacts), "com": com.tolist()}
    got = ask(service, "check", **fields, gradient=True)
    assert got["margin"] == pytest.approx(here.value, abs=1e-9)
    np.testing.assert_allclose(got["gradient"]["com"], wanted.com, atol=1e-9)
    np.testing.assert_allclose(got["gradient"]["mu"], wanted.mu, atol=1e-5)
    np.testing.assert_allclose(got["gradient"]["position"], wanted.position, atol=1e-5)
    assert ask(service, "check", **fields)["gradient"] is None
    step = 1e-6 * np.array(got["gradient"]["com"])
    there = ask(service, "check", contacts=fields["contacts"], com=(com + step).tolist())
    assert there["margin"] - got["margin"] == pytest.approx(1e-6, rel=1e-2)
    assert ask(service, "check", contacts=[], com=[0, 0], gradient=True)["gradient"] is None
    unlimited = [c | {"mu": None} for c in FLOOR]
    assert ask(service, "check", contacts=unlimited, com=[0, 0], gradient=True)["gradient"]["mu"] == [0.0] * 4


# -- nonsense ----------------------------------------------------------------------------------------------------------

FEET = [
    {"position": p, "normal": UP, "mu": 0.6}
    for p in (foot_positions(RAGNO.model, RAGNO.neutral) - [0, 0, 0.008]).tolist()
]
POSTURE = {"joints": RAGNO.neutral.tolist()}


@pytest.mark.parametrize(
    ("fields", "code", "field"),
    [
        ({"acceleration": [0.0, 0.0, -9.81]}, "too_large", "acceleration"),
        ({"acceleration": [0.0, 0.0, -30.0]}, "too_large", "acceleration"),
        ({"acceleration": [1.0, 0.0, 0.0], "contacts": [FLOOR[0] | {"normal": [0, 0, 0]}]}, "zero_normal",
         "contacts.0.normal"),
        ({"acceleration": [1.0, 0.0, 0.0], "directions": [[0, 0]]}, "zero_direction", "directions.0"),
        ({"tilt_rad": 0.1, "directions": 4}, "unsupported", "directions"),
        ({"tilt_rad": 0.1, "certificates": True}, "unsupported", "certificates"),
        ({"tilt_rad": 1.0, "acceleration": [0.0, 0.0, -9.0]}, "too_large", "acceleration"),
        ({"actuation": POSTURE, "tilt_rad": 0.1}, "unsupported", "tilt_rad"),
        ({"actuation": POSTURE, "acceleration": [1, 0, 0]}, "unsupported", "acceleration"),
        ({"actuation": POSTURE, "adaptive": True}, "unsupported", "adaptive"),
        ({"actuation": {"joints": [0.0]}}, "shape", "actuation.joints"),
        ({"actuation": POSTURE | {"robot": "nobody"}}, "unknown_robot", "actuation.robot"),
        ({"actuation": POSTURE | {"base": {"quat_wxyz": [0, 0, 0, 0]}}}, "invalid", "actuation.base.quat_wxyz"),
        ({"actuation": POSTURE | {"max_torque_nm": [1.0]}}, "shape", "actuation.max_torque_nm"),
        ({"actuation": POSTURE | {"max_torque_nm": [1.0] * 17 + [0.0]}}, "not_positive", "actuation.max_torque_nm.17"),
        ({"actuation": POSTURE, "contacts": [FEET[0] | {"leg": "x"}]}, "unknown_leg", "contacts.0.leg"),
        ({"actuation": POSTURE, "contacts": [FEET[0], FEET[0]]}, "duplicate_leg", "contacts.1.leg"),
        ({"actuation": POSTURE, "contacts": [FEET[0] | {"position": [5, 5, 5]}]}, "missing", "contacts.0.leg"),
        ({"actuation": {"joints": [0.0] * len(load_robot("bioloid").joints), "robot": "bioloid"}}, "unsupported",
         "actuation.robot"),
    ],
)  # fmt: skip
def test_refusals_of_the_service(service: Stability, fields: dict, code: str, field: str) -> None:
    with pytest.raises(Refusal) as refused:
        ask(service, "region", **({"contacts": FEET} | fields))
    assert (refused.value.code, refused.value.field) == (code, field)


@pytest.mark.parametrize("given", ["mine", "mine/robot.toml", "mine.toml"])
def test_a_request_reads_no_robot_from_a_path(service: Stability, tmp_path: Path, monkeypatch: Any, given: str) -> None:
    monkeypatch.chdir(tmp_path)
    Path("mine").mkdir()
    for copy in ("mine/robot.toml", "mine.toml"):
        Path(copy).write_bytes(robot_file("ragno").read_bytes())
        assert load_robot(copy).name == "ragno"
    with pytest.raises(Refusal) as refused:
        ask(service, "region", contacts=FEET, actuation=POSTURE | {"robot": given})
    assert (refused.value.code, refused.value.field) == ("unknown_robot", "actuation.robot")


@pytest.mark.parametrize(
    ("what", "fields", "field"),
    [
        ("region", {"tilt_rad": -0.1}, "tilt_rad"),
        ("region", {"tilt_rad": 2.0}, "tilt_rad"),
        ("region", {"com_height_m": 1e9}, "com_height_m"),
        ("region", {"acceleration": [1.0, float("nan"), 0.0]}, "acceleration.1"),
        ("region", {"acceleration": [1.0]}, "acceleration"),
        ("region", {"acceleration": 3.0}, "acceleration"),
        ("region", {"actuation": {}}, "actuation.joints"),
        ("region", {"actuation": POSTURE | {"max_torque_nm": -1.0}}, "actuation.max_torque_nm"),
        ("region", {"actuation": POSTURE | {"max_torque_nm": "much"}}, "actuation.max_torque_nm"),
        ("region", {"actuation": POSTURE | {"torque": 1.0}}, "actuation.torque"),
        ("check", {"com": [0, 0], "gradient": "yes please"}, "gradient"),
        ("check", {"com": [0, 0], "actuation": {}}, "actuation"),
    ],
)
def test_refusals_of_the_schema(service: Stability, what: str, fields: dict, field: str) -> None:
    with pytest.raises(Refusal) as refused:
        ask(service, what, contacts=FEET, **fields)
    assert refused.value.code == "invalid"
    assert (refused.value.field or "").startswith(field)
