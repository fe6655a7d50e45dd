"""The service without a bus: requests in, replies out, typed refusals, and the continuous status."""

import json
import math

import numpy as np
import pytest

from surefoot.bus.codec import encode
from surefoot.errors import Refusal
from surefoot.lab.cli.fields import example
from surefoot.lockstep.join import TickInputs
from surefoot.robot.kinematics import com, foot_jacobians, foot_positions, gravity_torques
from surefoot.robot.reader import load_robot
from surefoot.schemas.base import Message
from surefoot.schemas.hw import FootContacts, JointState, Tick
from surefoot.schemas.stability import CheckRequest, EquilibriumReply, StabilityStatus
from surefoot.schemas.state import VelocityEstimate
from surefoot.schemas.topics import HW_CONTACTS, HW_JOINTS, STATE_STABILITY, STATE_VELOCITY
from surefoot.services.stability.answers import check_reply
from surefoot.services.stability.programs.contacts import contact_set
from surefoot.services.stability.service import Stability
from tests.services.stability.certificate import twist_violation
from tests.services.stability.conftest import ask
from tests.services.stability.sets import SQUARE, UP
from tests.services.stage import Stage

RAGNO = load_robot("ragno")
FLOOR = [{"position": p, "normal": UP, "mu": 0.5} for p in SQUARE]


def test_region_of_the_contract(service: Stability) -> None:
    got = ask(service, "region", contacts=FLOOR, directions=16)
    assert got["status"] == "ok"
    assert len(got["support"]) == 16
    assert got["support"][0] == {
        "direction": [1.0, 0.0], "value": 0.1, "point": [0.1, 0.1], "status": "ok",
        "gap": 0.0, "certificate": None, "forces": None, "twist": None, "torques": None,
    }  # fmt: skip
    assert sorted(map(tuple, got["inner"])) == sorted(p[:2] for p in SQUARE)
    given = ask(service, "region", contacts=FLOOR, directions=[[0, 2]])
    assert given["support"][0]["direction"] == [0.0, 1.0]
    assert ask(service, "region", contacts=FLOOR)["area"] == pytest.approx(0.04)


def test_region_without_contacts(service: Stability) -> None:
    got = ask(service, "region", contacts=[], directions=4)
    assert (got["status"], got["inner"], got["outer"]) == ("infeasible", [], [])
    assert {s["status"] for s in got["support"]} == {"infeasible"}
    assert all(s["value"] is None and s["point"] is None for s in got["support"])
    assert got["certificate"] == [0.0, 0.0, -1.0, 0.0]


def test_unlimited_friction_and_walls(service: Stability) -> None:
    walls = [
        {"position": [-1, 0, 0], "normal": [1, 0, 0], "mu": None},
        {"position": [1, 0, 0], "normal": [-1, 0, 0], "mu": None},
    ]
    got = ask(service, "region", contacts=walls, directions=8, certificates=True)
    assert got["status"] == "unbounded"
    assert [s["status"] for s in got["support"]][:3] == ["unbounded", "unbounded", "ok"]
    assert got["support"][0]["value"] is None
    assert got["gap"] is None


def test_certificates_on_request(service: Stability) -> None:
    uneven = [*FLOOR, {"position": [0.0, 0.15, 0.05], "normal": [0.1, 0.0, 1.0], "mu": 0.4}]
    got = ask(service, "region", contacts=uneven, certificates=True)
    contacts = contact_set([c["position"] for c in uneven], [c["normal"] for c in uneven], [c["mu"] for c in uneven])
    for s in got["support"]:
        assert s["certificate"][2] == s["value"]
        assert twist_violation(contacts, np.array(s["certificate"]), np.array(s["direction"])) < 1e-9
        assert np.array(s["forces"]).sum(axis=0) == pytest.approx([0.0, 0.0, 1.0], abs=1e-8)


def test_check_with_com_only(service: Stability) -> None:
    got = ask(service, "check", contacts=FLOOR, com=[0.0, 0.0], movement=[0.05, 0.0, 0.0])
    assert got["stable"] is True
    assert got["margin"] == pytest.approx(0.05)
    assert got["margin_now"] == pytest.approx(0.1)
    assert got["extent"] == pytest.approx(0.1)
    assert got["gsm"] == pytest.approx(0.05)
    assert got["shift"] == [0.0, 0.0, 0.0]
    still = ask(service, "check", contacts=FLOOR, com=[0.3, 0.0])
    assert (still["gsm"], still["extent"]) == (None, None)
    assert still["margin"] == pytest.approx(-0.2)
    assert still["stable"] is False


def test_check_with_joints(service: Stability) -> None:
    feet = foot_positions(RAGNO.model, RAGNO.neutral) + [0.3, 0.2, 0.1] * np.ones((6, 1))
    contacts = [{"position": p, "normal": UP, "mu": 0.5} for p in feet.tolist()]
    body = {"joints": RAGNO.neutral.tolist(), "base": {"position": [0.3, 0.2, 0.1]}}
    got = ask(service, "check", contacts=contacts, movement=[0.03, 0.0, 0.0], **body)
    centre = com(RAGNO.model, RAGNO.neutral)
    np.testing.assert_allclose(got["com"], centre[:2] + np.array([0.3, 0.2]))
    assert got["shift"][0] < -0.003
    np.testing.assert_allclose(got["com_after"][0], got["com"][0] + 0.03 + got["shift"][0])
    assert got["stance"] == [leg.name for leg in RAGNO.legs]
    given = ask(service, "check", contacts=contacts, movement=[0.03, 0.0, 0.0], com=[0.31, 0.2], robot="ragno", **body)
    assert given["com"] == [0.31, 0.2]
    assert given["shift"] == got["shift"]
    small = ask(service, "check", contacts=contacts, movement=[0.03, 0.0, 0.0], polygons=False, **body)
    assert small["inner"] == small["support"] == []
    assert small["margin"] == pytest.approx(got["margin"])


def test_check_without_a_region(service: Stability) -> None:
    got = ask(service, "check", contacts=[], com=[0.0, 0.0], movement=[0.1, 0.0, 0.0])
    assert (got["status"], got["stable"], got["margin"], got["gsm"]) == ("infeasible", False, None, None)
    assert got["gsm_status"] == "infeasible"


def test_whatif_and_batch(service: Stability) -> None:
    candidate = {"position": [0.3, 0.0, 0.0], "normal": UP, "mu": 0.5}
    got = ask(service, "whatif", contacts=FLOOR, com=[0.02, 0.05], candidates=[candidate])
    assert [v["stable"] for v in got["lifts"]] == [False, False, True, True]
    assert got["now"]["margin"] == pytest.approx(0.05)
    assert got["candidates"][0]["margin"] == pytest.approx(0.05)
    sets = [
        {"contacts": FLOOR, "com": [0.02, 0.05]},
        {"contacts": FLOOR[1:], "com": [0.02, 0.05]},
        {"contacts": [], "com": [0, 0]},
    ]
    many = ask(service, "batch", sets=sets)["results"]
    assert many[0] == got["now"]
    assert many[1] == got["lifts"][0]
    assert many[2] == {"status": "infeasible", "margin": None, "stable": False}


def test_equilibrium(service: Stability) -> None:
    got = ask(service, "equilibrium", contacts=FLOOR, com=[0.0, 0.0], weight_n=20.0)
    np.testing.assert_allclose(got["forces_n"], np.tile([0.0, 0.0, 5.0], (4, 1)), atol=1e-5)
    assert got["friction_share"] == pytest.approx(0.0, abs=1e-6)
    np.testing.assert_allclose(np.sum(got["minmax_forces_n"], axis=0), [0.0, 0.0, 20.0], atol=1e-7)
    assert np.abs(np.array(got["minmax_forces_n"])[:, :2]).max() < 1e-7
    outside = ask(service, "equilibrium", contacts=FLOOR, com=[0.2, 0.0])
    assert (outside["held"], outside["forces_n"], outside["minmax_forces_n"]) == (False, None, None)
    assert len(outside["certificate"]) == 6


def test_com(service: Stability) -> None:
    q = RAGNO.neutral.tolist()
    plain = ask(service, "com", joints=q, base={"position": [1.0, 2.0, 0.1]})
    np.testing.assert_allclose(plain["com"], com(RAGNO.model, RAGNO.neutral) + np.array([1.0, 2.0, 0.1]))
    assert plain["com_measured"] is None
    load = np.array([0.0, 0.0, RAGNO.mass * 9.81 / 6.0])
    torque = gravity_torques(RAGNO.model, RAGNO.neutral, np.array([0.0, 0.0, 9.81]))
    for i, leg in enumerate(RAGNO.legs):
        torque[list(leg.joints)] -= foot_jacobians(RAGNO.model, RAGNO.neutral)[i].T @ load
    got = ask(service, "com", joints=q, torque=torque.tolist())
    np.testing.assert_allclose(got["com_measured"], [0.0, 0.0], atol=1e-9)
    assert got["weight_n"] == pytest.approx(RAGNO.mass * 9.81)
    np.testing.assert_allclose(got["forces_n"], np.tile(load, (6, 1)), atol=1e-9)
    assert ask(service, "com", joints=q, torque=torque.tolist(), touch=[False] * 6)["com_measured"] is None


@pytest.mark.parametrize(
    ("what", "fields", "code", "field"),
    [
        ("com", {"joints": [0.0] * 18, "torque": [0.0]}, "shape", "torque"),
        ("com", {"joints": [0.0] * 18, "torque": [0.0] * 18, "touch": [True]}, "shape", "touch"),
        (
            "batch",
            {
                "sets": [
                    {"contacts": FLOOR, "com": [0, 0]},
                    {"contacts": [FLOOR[0] | {"normal": [0, 0, 0]}], "com": [0, 0]},
                ]
            },
            "zero_normal",
            "sets.1.contacts.0.normal",
        ),
        (
            "region",
            {"contacts": [{"position": [0, 0, 0], "normal": [0, 0, 0], "mu": 1}]},
            "zero_normal",
            "contacts.0.normal",
        ),
        ("region", {"contacts": FLOOR, "directions": [[0, 0]]}, "zero_direction", "directions.0"),
        (
            "region",
            {"contacts": [{"position": [0, 0, 1e9], "normal": UP, "mu": 1}]},
            "too_large",
            "contacts.0.position",
        ),
        ("check", {"contacts": FLOOR}, "missing", "com"),
        ("check", {"contacts": FLOOR, "joints": [0.0]}, "shape", "joints"),
        ("check", {"contacts": FLOOR, "joints": [0.0], "robot": "nobody"}, "unknown_robot", "robot"),
        ("check", {"contacts": FLOOR, "joints": [0.0], "robot": "../../etc"}, "unknown_robot", "robot"),
        ("check", {"contacts": FLOOR, "com": [0.0, 0.0], "robot": "nobody"}, "unknown_robot", "robot"),
        (
            "check",
            {"contacts": FLOOR, "joints": [0.0] * 18, "base": {"quat_wxyz": [0, 0, 0, 0]}},
            "invalid",
            "base.quat_wxyz",
        ),
        ("check", {"contacts": [FLOOR[0] | {"leg": "x"}], "joints": [0.0] * 18}, "unknown_leg", "contacts.0.leg"),
        ("region", {"contacts": [FLOOR[0] | {"normal": [0.3, 0.1, 1], "mu": 1e10}]}, "too_large", "contacts.0.mu"),
        ("region", {"contacts": FLOOR, "acceleration": [1e300, 0, 0]}, "too_large", "acceleration"),
        ("check", {"contacts": FLOOR, "com": [1e308, 0]}, "too_large", "com"),
        ("check", {"contacts": FLOOR, "com": [0, 0], "movement": [1e308, 0, 0]}, "too_large", "movement"),
        (
            "check",
            {"contacts": FLOOR, "joints": [0.0] * 18, "base": {"position": [1e308, 0, 0]}},
            "too_large",
            "base.position",
        ),
        ("whatif", {"contacts": FLOOR, "com": [0, -1e308]}, "too_large", "com"),
        ("batch", {"sets": [{"contacts": FLOOR, "com": [0, -1e308]}]}, "too_large", "sets.0.com"),
        ("equilibrium", {"contacts": FLOOR, "com": [0, -1e308]}, "too_large", "com"),
    ],
)
def test_refusals_of_the_service(service: Stability, what: str, fields: dict, code: str, field: str) -> None:
    with pytest.raises(Refusal) as refused:
        ask(service, what, **fields)
    assert (refused.value.code, refused.value.field) == (code, field)


@pytest.mark.parametrize(
    ("change", "field"),
    [
        ({"contacts": FLOOR * 17}, "contacts"),
        ({"directions": 721}, "directions"),
        ({"directions": []}, "directions"),
        ({"tolerance_m": 0.0}, "tolerance_m"),
        ({"direction": 16}, "direction"),
        ({"contacts": [{"position": [0, 0], "normal": UP, "mu": 0.5}]}, "contacts.0.position"),
        ({"contacts": [{"position": [0, 0, 0], "normal": UP, "mu": -0.5}]}, "contacts.0.mu"),
        ({"contacts": [{"position": [0, 0, math.nan], "normal": UP, "mu": 0.5}]}, "contacts.0.position.2"),
        ({"contacts": [{"position": [0, 0, 0], "normal": UP}]}, "contacts.0.mu"),
    ],
)
def test_refusals_of_the_schema(service: Stability, change: dict, field: str) -> None:
    with pytest.raises(Refusal) as refused:
        ask(service, "region", **({"contacts": FLOOR} | change))
    assert refused.value.code == "invalid"
    assert (refused.value.field or "").startswith(field)


def test_reply_does_not_depend_on_what_was_asked_before(service: Stability) -> None:
    fields = {"contacts": FLOOR, "com": [0.01, 0.0], "movement": [0.02, 0.01, 0.0], "joints": RAGNO.neutral.tolist()}
    first = ask(service, "check", **fields)
    ask(service, "region", contacts=FLOOR[:3])
    assert ask(service, "check", **fields) == first
    own = check_reply(CheckRequest.model_validate(fields), RAGNO)
    assert json.loads(encode(own)[0]) == first


def test_check_with_doubt(service: Stability) -> None:
    """Flat ground: the margin shrinks by kappa times the CoM's and the feet's deviations; friction does not matter."""
    fields = {"contacts": FLOOR, "com": [0.0, 0.0]}
    plain = ask(service, "check", **fields)
    assert (plain["margin"], plain["margin_robust"]) == (pytest.approx(0.1), None)
    got = ask(service, "check", **fields, doubt={"com_sd_m": 0.005, "kappa": 2.0})
    assert got["margin_robust"] == pytest.approx(0.09, abs=1e-6)
    both = ask(service, "check", **fields, doubt={"com_sd_m": 0.003, "foot_sd_m": 0.004, "kappa": 1.0})
    assert 0.094 < both["margin_robust"] < 0.0971
    assert ask(service, "check", **fields, doubt={"friction": 0.4})["margin_robust"] == pytest.approx(0.1, abs=1e-6)
    steep = [contact | {"normal": [-0.4, 0.0, 0.9]} for contact in FLOOR]
    assert ask(service, "check", contacts=steep, com=[0, 0], doubt={"normal_rad": 0.3})["margin_robust"] is None
    with pytest.raises(Refusal) as refused:
        ask(service, "check", **fields, doubt={"com_sd_m": -1.0})
    assert refused.value.field == "doubt.com_sd_m"


def test_least_friction_between_walls_states_how_hard_the_robot_may_press(service: Stability) -> None:
    """Facing walls carry m g with friction alone: the share is m g / (mu sum of normal forces)."""
    walls = [{"position": [x, 0.0, 0.2], "normal": [-x, 0.0, 0.0], "mu": 0.5} for x in (-1.0, 1.0)]
    got = ask(service, "equilibrium", contacts=walls, com=[0.0, 0.0], weight_n=20.0)
    assert got["minmax_load_n"] == 2000.0
    assert got["friction_share"] == pytest.approx(20.0 / (0.5 * got["minmax_load_n"]), rel=1e-4)
    assert np.abs(np.array(got["minmax_forces_n"])[:, 0]).sum() <= got["minmax_load_n"] * (1.0 + 1e-9)
    assert ask(service, "equilibrium", contacts=FLOOR, com=[5.0, 0.0])["minmax_load_n"] is None
    share = EquilibriumReply.model_json_schema()["properties"]["friction_share"]["description"]
    assert "minmax_load_n" in share


def test_equilibrium_of_a_robot_that_accelerates(service: Stability) -> None:
    """Forces add up to m (g + a); 0.1 m behind the edge and 0.3 m high it can brake with g/3 but not more."""
    fields = {"contacts": FLOOR, "com": [0.0, 0.0], "com_height_m": 0.3, "weight_n": 20.0}
    got = ask(service, "equilibrium", **fields, acceleration=[3.2, 0.0, 1.0])
    assert got["held"]
    total = np.sum(got["forces_n"], axis=0)
    np.testing.assert_allclose(total, 20.0 / 9.81 * np.array([3.2, 0.0, 10.81]), atol=1e-5)
    even = np.array(got["minmax_forces_n"])  # feet on level ground: shares are |f_xy| / (mu f_z)
    np.testing.assert_allclose(even.sum(axis=0), 20.0 / 9.81 * np.array([3.2, 0.0, 10.81]), atol=1e-6)
    share = np.linalg.norm(even[:, :2], axis=1) / ([c["mu"] for c in FLOOR] * even[:, 2])
    assert share.max() == pytest.approx(got["friction_share"], abs=1e-7)
    assert not ask(service, "equilibrium", **fields, acceleration=[3.4, 0.0, 0.0])["held"]
    assert not ask(service, "equilibrium", **(fields | {"com_height_m": 0.0}), acceleration=[5.0, 0.0, 0.0])["held"]
    with pytest.raises(Refusal) as refused:
        ask(service, "equilibrium", **fields, acceleration=[0.0, 0.0, -9.81])
    assert refused.value.field == "acceleration"


# -- state/stability --------------------------------------------------------------------------------------------------


class Bench(Stage):
    """Feeds ticks to a service and keeps what it publishes."""

    def __init__(self, service: Stability) -> None:
        super().__init__()
        self.service = service
        service.on_reset()
        service.attach(self)  # type: ignore[arg-type]

    @property
    def states(self) -> list[StabilityStatus]:
        return self.of(STATE_STABILITY.key)

    def tick(self, number: int, **messages: Message) -> None:
        tick = Tick(tick=number, stamp_ns=10_000_000 * number, roster=(), roster_version=0, due=(), mode="lockstep")
        keys = {"joints": HW_JOINTS, "contacts": HW_CONTACTS, "velocity": STATE_VELOCITY}
        self.service.on_tick(TickInputs(tick, {keys[name].key: message for name, message in messages.items()}))


def samples(stamp_ns: int, touch: tuple[bool, ...] = (True,) * 6, g_up: tuple = (0.0, 0.0, 9.81)) -> dict[str, Message]:
    velocity = VelocityEstimate.model_construct(g_up=g_up, stamp_ns=stamp_ns)
    return {
        "joints": JointState(position=tuple(RAGNO.neutral.tolist()), stamp_ns=stamp_ns),
        "contacts": FootContacts(touch=tuple((t,) for t in touch), normal_force_n=(None,) * 6, stamp_ns=stamp_ns),
        "velocity": velocity,
    }


def test_status_every_second_tick(service: Stability) -> None:
    bench = Bench(service)
    bench.tick(0)
    assert bench.states[0].status == "infeasible"
    assert not bench.states[0].fresh
    bench.tick(1, **samples(10_000_000))
    assert len(bench.states) == 1
    bench.tick(2)
    now = bench.states[1]
    assert (now.status, now.fresh, now.stance) == ("ok", True, (True,) * 6)
    assert now.margin_planned == pytest.approx(0.13, abs=0.02)
    assert (now.com_measured, now.margin_measured) == (None, None)
    bench.tick(20)
    assert not bench.states[2].fresh
    service.on_reset()
    bench.tick(22)
    assert bench.states[3].status == "infeasible"


def test_status_in_the_air_and_without_gravity(service: Stability) -> None:
    bench = Bench(service)
    bench.tick(0, **samples(0, touch=(False,) * 6))
    assert (bench.states[0].status, bench.states[0].region, bench.states[0].margin_planned) == ("infeasible", (), None)
    bench.tick(2, **samples(0, g_up=(0.0, 0.0, 0.0)))
    assert not bench.states[1].fresh


@pytest.mark.parametrize("what", ["region", "check", "com", "whatif", "equilibrium", "batch", "calibrate"])
def test_the_example_of_the_command_line_is_answered(service: Stability, what: str) -> None:
    asked = {query.key: query.request for query in service.serves}[f"stability/{what}"]
    got = ask(service, what, **example(asked))
    if what == "check":
        assert got["stable"]
        assert got["gsm"] == pytest.approx(0.03)
