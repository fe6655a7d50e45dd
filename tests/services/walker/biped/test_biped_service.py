"""The walker service of a biped without a bus: refusals on the wire, and what it takes up after it was killed."""

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from pydantic import ValidationError

from surefoot.lockstep.join import TickInputs
from surefoot.schemas.cmd import WalkCommand
from surefoot.schemas.hw import FootContacts, JointState, Tick
from surefoot.schemas.state import Odometry, VelocityEstimate
from surefoot.schemas.topics import CMD_JOINTS, HW_CONTACTS, HW_JOINTS, STATE_GAIT, STATE_ODOMETRY, STATE_VELOCITY
from surefoot.services.walker.interface import WalkerInputs
from surefoot.services.walker.service import SERVICE, WalkerConfig
from tests.services.walker.biped.biped_plant import Plant

EPOCH = 2


class Stage:
    """A runtime that keeps what is published."""

    def __init__(self) -> None:
        self.said: dict[str, Any] = {}

    def publish(self, topic: Any, message: Any, stamp_ns: int | None) -> None:
        self.said[topic.key] = message

    def log(self, level: str, text: str) -> None:
        self.said["log"] = text


def service_of(robot: str, memory: str | None = None) -> Any:
    service = SERVICE(WalkerConfig(robot=robot, memory=memory))
    service.attach(Stage())
    service.on_start()
    return service


class ByMessages:
    """Stands where a plant has its walker: all that the service knows comes as messages, and so does its answer."""

    def __init__(self, robot: str, memory: str) -> None:
        self.service = service_of(robot, memory)

    def step(self, inputs: WalkerInputs) -> Any:
        stamp, zero = round(inputs.stamp * 1e9), (0.0, 0.0, 0.0)
        number = round(inputs.stamp * 100)
        head: dict[str, Any] = {"stamp_ns": stamp, "tick": number, "epoch": EPOCH, "seq": 0, "source": "test"}
        messages: dict[str, Any] = {
            STATE_ODOMETRY.key: Odometry(
                **head, position=(inputs.x, inputs.y, 0.0), quat_wxyz=(1.0, 0.0, 0.0, 0.0), yaw=inputs.yaw,
                velocity=zero, covariance=(0.0,) * 16, initialised=inputs.initialised,
            ),
            STATE_VELOCITY.key: VelocityEstimate(
                **head, mode="ekf", velocity=zero, velocity_imu=zero, velocity_heading=zero,
                angular_velocity=inputs.rate, g_up=(0.0, 0.0, 9.81), roll=inputs.roll, pitch=inputs.pitch,
                gyro_bias=zero, covariance=(0.0,) * 36, initialised=inputs.initialised, standing=False, inputs_ok=True,
                filter_ok=True, sensors_ok=True, slipping=(False,) * 2,
            ),
        }  # fmt: skip
        if inputs.joints is not None and inputs.contacts is not None:
            messages[HW_JOINTS.key] = JointState(**head, position=tuple(inputs.joints.tolist()))
            touch = tuple((bool(foot),) for foot in inputs.contacts)
            messages[HW_CONTACTS.key] = FootContacts(**head, touch=touch, normal_force_n=(None,) * 2)
        tick = Tick(**head, roster=("estimator", "walker"), roster_version=1, due=(), mode="lockstep")
        self.service.on_tick(TickInputs(tick, messages))
        said = self.service.runtime.said
        position = said[CMD_JOINTS.key].position
        return SimpleNamespace(
            **said[STATE_GAIT.key].model_dump(), command=None if position is None else np.array(position)
        )


@pytest.fixture
def nao() -> Any:
    service = service_of("nao")
    service.gait.state.calibrated = True
    return service


@pytest.mark.parametrize(
    ("command", "code", "field"),
    [
        (WalkCommand(action="walk", velocity=1.0), "too_fast", "velocity"),
        (WalkCommand(action="walk", distance=0.05, angle=3.0), "too_tight", "angle"),
        (WalkCommand(action="turn"), "missing_field", "angle"),
        (WalkCommand(action="walk", gait="tripod"), "unknown_gait", "gait"),
        (WalkCommand(action="stand", shift=(0.01, 0.0)), "unsupported", "shift"),
    ],
)
def test_a_refusal_on_the_wire_names_code_and_field(nao: Any, command: WalkCommand, code: str, field: str) -> None:
    reply = nao.walk(command)
    assert (reply.accepted, reply.id, reply.code, reply.field) == (False, 0, code, field)
    assert reply.reason


def test_before_the_calibration_the_robot_is_to_blame_no_field(nao: Any) -> None:
    nao.gait.state.calibrated = False
    reply = nao.walk(WalkCommand(action="walk", distance=0.1))
    assert (reply.accepted, reply.code, reply.field) == (False, "not_initialised", None)


def test_a_way_beyond_reason_does_not_pass_the_schema() -> None:
    with pytest.raises(ValidationError) as error:
        WalkCommand(action="walk", distance=1e6)
    assert error.value.errors()[0]["loc"] == ("distance",)


@pytest.mark.parametrize("name", ["bioloid", "nao"])
def test_killed_in_mid_step_the_service_goes_on_under_the_same_number(name: str, tmp_path: Path) -> None:
    memory = str(tmp_path / "walker.json")
    plant = Plant(name, seed=1, level=1.0)
    plant.walker = ByMessages(name, memory)
    plant.stand()
    before = plant.world.truth().position[0]
    number = plant.walker.service.walk(WalkCommand(action="walk", distance=0.15)).id
    assert plant.walker.service.walk(WalkCommand(action="turn", angle=0.2, at_tick=2200)).accepted
    plant.until(lambda out: out.steps >= 2 and out.phase > 0.6)
    plant.walker = ByMessages(name, memory)
    states: list[tuple[int, str]] = []
    plant.until(lambda out: states.append((out.walk_id, out.state)) or out.state == "standing", 1800)
    assert states[0] == (number, "recovering")
    assert (number, "walking") in states
    assert plant.world.truth().position[0] - before == pytest.approx(0.15, abs=0.05)
    plant.until(lambda out: out.state == "turning", 2200)
    assert plant.out.walk_id == number + 1
    assert not plant.fallen
