"""stability/calibrate and stability/com as outside clients see them: poses, a job, sensors under the feet."""

import json
from typing import Any

import numpy as np
import pytest

from surefoot.bus.codec import decode, encode
from surefoot.errors import Refusal
from surefoot.lockstep.join import TickInputs
from surefoot.schemas.base import Message
from surefoot.schemas.hw import FootContacts, JointState, Tick
from surefoot.schemas.state import VelocityEstimate
from surefoot.schemas.topics import HW_CONTACTS, HW_JOINTS, STATE_VELOCITY
from surefoot.services.stability.config import StabilityConfig
from surefoot.services.stability.service import SERVICE, Stability
from tests.services.stability.sensing.test_calibration import poses
from tests.services.stability.sensing.test_forces import RADIUS, RAGNO, UP, held, standing
from tests.services.stage import Stage

GAIN = 0.7522


class Rig(Stage):
    """Asks the service, feeds it ticks."""

    def __init__(self) -> None:
        super().__init__()
        self.service: Stability = SERVICE(StabilityConfig())
        self.service.attach(self)  # type: ignore[arg-type]
        self.service.on_start()
        self.tick_number = 0

    def ask(self, what: str, **fields: Any) -> dict[str, Any]:
        model = {query.key: query.request for query in SERVICE.serves}[f"stability/{what}"]
        reply = self.service.handlers[f"stability/{what}"](decode(model, json.dumps(fields).encode()))
        return json.loads(encode(reply)[0])

    def tick(self, joints: np.ndarray | None = None, torque: np.ndarray | None = None) -> None:
        self.tick_number += 1
        stamp = 10_000_000 * self.tick_number
        tick = Tick(
            tick=self.tick_number, stamp_ns=stamp, roster=(), roster_version=0, due=(), mode="lockstep"
        )  # fmt: skip
        given: dict[str, Message] = {}
        if joints is not None and torque is not None:
            given[HW_JOINTS.key] = JointState(
                position=tuple(joints.tolist()), torque=tuple(torque.tolist()), stamp_ns=stamp
            )
            given[HW_CONTACTS.key] = FootContacts(touch=((True,),) * 6, normal_force_n=(None,) * 6, stamp_ns=stamp)
            given[STATE_VELOCITY.key] = VelocityEstimate.model_construct(
                g_up=tuple(UP.tolist()), stamp_ns=stamp, initialised=True
            )
        self.service.on_tick(TickInputs(tick, given))


@pytest.fixture
def rig() -> Rig:
    return Rig()


def test_fit_from_poses(rig: Rig) -> None:
    given = [
        {"joints": p.joints.tolist(), "torque": p.torque.tolist()} for p in poses(np.full(18, GAIN), (0.004, -0.003))
    ]
    got = rig.ask("calibrate", action="fit", poses=given)
    assert (got["accepted"], got["state"], got["poses"]) == (True, "done", len(given))
    assert got["gain"] == pytest.approx(GAIN, rel=2e-3)
    assert got["torque_per_ampere"] == pytest.approx(GAIN * RAGNO.current.torque_per_ampere, rel=2e-3)
    assert got["offset"] == pytest.approx([0.004, -0.003], abs=5e-4)
    assert rig.service.calibration.gain is None  # asked, not applied


def test_a_job_collects_resting_poses_and_applies_the_gain(rig: Rig) -> None:
    assert rig.ask("calibrate", action="status")["state"] == "idle"
    assert not rig.ask("calibrate", action="finish")["accepted"]
    assert rig.ask("calibrate", action="start", at_tick=3)["accepted"]
    given = poses(np.full(18, GAIN))
    for p in given:
        for _ in range(20):
            rig.tick(p.joints, p.torque)
        for k in range(20):  # moving: no pose
            rig.tick(p.joints + 0.02 * (k % 2), p.torque)
    assert rig.ask("calibrate", action="status") | {"reason": ""} == {
        "accepted": True, "reason": "", "state": "collecting", "poses": len(given), "gain": None, "gain_sd": None,
        "joint_gain": None, "torque_per_ampere": None, "offset": None, "residual_n": None,
    }  # fmt: skip
    before = rig.sent[-1][1].weight_n
    assert rig.ask("calibrate", action="finish", at_tick=rig.tick_number + 1)["accepted"]
    rig.tick(given[-1].joints, given[-1].torque)
    assert any("calibration: torques of the servos x 0.75" in line for line in rig.logged)
    rig.tick(given[-1].joints, given[-1].torque)
    got = rig.ask("calibrate", action="status")
    assert (got["state"], got["gain"]) == ("done", pytest.approx(GAIN, rel=5e-3))
    after = rig.sent[-1][1].weight_n
    assert before is not None
    assert after is not None
    weight = RAGNO.mass * 9.81
    assert abs(after - weight) < 0.05 * abs(before - weight)
    rig.service.on_reset()
    assert rig.service.calibration.gain is None


def test_a_job_without_poses_is_not_fitted(rig: Rig) -> None:
    rig.ask("calibrate", action="start")
    got = rig.ask("calibrate", action="finish")
    assert (got["accepted"], got["state"]) == (False, "collecting")
    assert "no_pose" in got["reason"] or "pose" in got["reason"]
    rig.ask("calibrate", action="cancel")
    assert rig.ask("calibrate", action="status")["state"] == "idle"


def test_a_tick_that_has_passed_is_refused(rig: Rig) -> None:
    rig.tick()
    got = rig.ask("calibrate", action="start", at_tick=1)
    assert not got["accepted"]
    assert "has passed" in got["reason"]


@pytest.mark.parametrize(
    ("pose", "field"),
    [
        ({"joints": [0.0], "torque": [0.0] * 18}, "poses.0.joints"),
        ({"joints": [0.0] * 18, "torque": [0.0]}, "poses.0.torque"),
        ({"joints": [0.0] * 18, "torque": [0.0] * 18, "touch": [True]}, "poses.0.touch"),
        ({"joints": [0.0] * 18, "torque": [0.0] * 18, "g_up": [0.0, 0.0, 0.0]}, "poses.0.g_up"),
    ],
)
def test_refusals(rig: Rig, pose: dict[str, Any], field: str) -> None:
    with pytest.raises(Refusal) as refused:
        rig.ask("calibrate", action="fit", poses=[pose])
    assert refused.value.field == field


def test_com_with_known_weight_and_sensors_under_the_feet(rig: Rig) -> None:
    place = np.array([0.02, -0.015])
    q = RAGNO.neutral
    force = held(q, place)
    told = standing(force, q) / 1.3
    fields = {"joints": q.tolist(), "torque": told.tolist()}
    plain, free = rig.ask("com", **fields), rig.ask("com", **fields, known_weight=True)
    assert plain["gain"] is None
    assert free["gain"] == pytest.approx(1.3, abs=1e-9)
    np.testing.assert_allclose(free["com_measured"], place, atol=1e-9)
    assert np.linalg.norm(np.array(plain["com_measured"]) - place) > 1e-3
    loads: list[float | None] = [6.0, None, 6.0, 0.0, 19.62, 6.0]
    fused = rig.ask("com", **fields, known_weight=True, load_n=loads)
    seen, was = np.array(fused["forces_n"]), np.array(free["forces_n"])
    assert seen[1] == pytest.approx(was[1])  # no sensor
    assert seen[4] == pytest.approx(was[4])  # saturated
    assert abs(seen[0, 2] - 6.0) < abs(was[0, 2] - 6.0)
    assert RADIUS[0] > 0.0
    with pytest.raises(Refusal) as refused:
        rig.ask("com", **fields, load_n=[1.0])
    assert refused.value.field == "load_n"
