"""The walker service of a biped without a bus: refusals on the wire, and what it takes up after it was killed."""

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from pydantic import ValidationError

from surefoot.schemas.cmd import WalkCommand
from surefoot.schemas.topics import CMD_JOINTS, STATE_GAIT
from surefoot.services.walker.interface import WalkerInputs
from tests.services.walker.biped.biped_plant import Plant
from tests.services.walker.messages import estimate, samples, service_of, tick_of


class ByMessages:
    """Stands where a plant has its walker: all that the service knows comes as messages, and so does its answer."""

    def __init__(self, robot: str, memory: str) -> None:
        self.service = service_of(robot=robot, memory=memory)

    def step(self, inputs: WalkerInputs) -> Any:
        tick = round(inputs.stamp * 100)
        motion = {"angular_velocity": inputs.rate, "roll": inputs.roll, "pitch": inputs.pitch}
        messages = estimate(tick, (inputs.x, inputs.y, inputs.yaw), 2, inputs.initialised, **motion)
        if inputs.joints is not None and inputs.contacts is not None:
            messages |= samples(tick, inputs.joints, tuple((bool(foot),) for foot in inputs.contacts))
        self.service.on_tick(tick_of(tick, messages, ("estimator", "walker")))
        said = self.service.runtime.said
        position = said[CMD_JOINTS.key].position
        return SimpleNamespace(
            **said[STATE_GAIT.key].model_dump(), command=None if position is None else np.array(position)
        )


@pytest.fixture
def nao() -> Any:
    service = service_of(robot="nao")
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
    assert plant.walker.service.walk(WalkCommand(action="turn", angle=0.2, at_tick=1600)).accepted
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
