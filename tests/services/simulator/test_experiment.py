"""Trials with ground primitives: what lies under the feet, what comes of a stroke, and that nothing else is touched."""

import math

import numpy as np
import pytest
from pydantic import ValidationError

from surefoot.lockstep.local import LocalSystem
from surefoot.robot.kinematics import foot_positions
from surefoot.robot.reader import load_robot
from surefoot.schemas.sim import ExperimentRequest, PrimitiveTrial
from surefoot.services.simulator.experiment import outcome_of, primitive_ground
from surefoot.services.simulator.service import Simulator, SimulatorConfig

ROBOT = load_robot("ragno")
FEET = foot_positions(ROBOT.model, ROBOT.neutral)[:, :2]


@pytest.mark.parametrize(
    ("primitive", "rise"),
    [
        ("flat", 0.0),
        ("slope", 0.0),
        ("edge", 0.02),
        ("hill", 0.02),
        ("ridge", 0.02),
        ("hole", -0.02),
        ("groove", -0.02),
    ],
)
def test_every_foot_stands_on_the_same(primitive: str, rise: float) -> None:
    ground = primitive_ground(FEET, PrimitiveTrial(primitive=primitive, yaw=0.7)).map  # type: ignore[arg-type]
    for offset in ((0.0, 0.0), (0.012, 0.004), (-0.01, 0.015)):
        heights = [float(ground.height(x + offset[0], y + offset[1], "nearest")) for x, y in FEET]
        assert np.ptp(heights) < 0.005 or primitive == "edge"
    middle = [float(ground.height(x, y)) for x, y in FEET]
    if primitive != "edge":
        assert middle == pytest.approx([rise] * 6, abs=2e-3)
    moved = primitive_ground(FEET, PrimitiveTrial(primitive="hill", offset=0.02, offset_yaw=math.pi / 2)).map
    assert float(moved.height(FEET[0, 0], FEET[0, 1] - 0.02)) == pytest.approx(0.02, abs=2e-3)


def test_a_step_edge_is_a_box_and_the_map_has_its_height() -> None:
    ground = primitive_ground(FEET, PrimitiveTrial(primitive="edge", height=0.03))
    assert len(ground.boxes) == 6
    for (x, y), box in zip(FEET, ground.boxes, strict=True):
        assert box.position[2] + box.half_size[2] == pytest.approx(0.03)
        assert float(ground.map.height(x + 0.02, y, "nearest")) == pytest.approx(0.03)
        assert float(ground.map.height(x - 0.02, y, "nearest")) == 0.0


def test_flat_ground_holds_and_a_slope_does_less() -> None:
    flat, again, slope = (
        outcome_of(ROBOT, PrimitiveTrial(primitive=name, height=0.04)) for name in ("flat", "flat", "slope")
    )
    assert flat == again
    assert flat.status == "ok"
    assert len({foot.leg for foot in flat.feet}) == 3
    assert sum(foot.load for foot in flat.feet) == pytest.approx(ROBOT.mass * 9.81, rel=0.1)
    assert max(foot.sliding for foot in flat.feet) < 1.5e-3
    assert sum(foot.sliding for foot in slope.feet) > 2.0 * sum(foot.sliding for foot in flat.feet)


def test_six_feet_carry_half_as_much() -> None:
    found = outcome_of(ROBOT, PrimitiveTrial(primitive="flat", stance="six"))
    assert [foot.leg for foot in found.feet] == list(ROBOT.leg_names)
    assert sum(foot.load for foot in found.feet) == pytest.approx(ROBOT.mass * 9.81, rel=0.1)


def test_to_slip_before_the_stroke_is_a_result() -> None:
    found = outcome_of(ROBOT, PrimitiveTrial(primitive="slope", height=0.04, friction=0.2))
    assert found.status in ("slipped", "fallen")
    assert found.reason
    assert max(foot.before for foot in found.feet) > 0.02


def test_noise_is_seeded() -> None:
    a, b, c = (
        primitive_ground(FEET, PrimitiveTrial(primitive="hill", noise=0.003, seed=seed)).map.sha256
        for seed in (1, 1, 2)
    )
    assert a == b != c


@pytest.mark.parametrize(
    "wrong", [{"height": 0.05}, {"primitive": "moon"}, {"stroke": 0.0}, {"friction": math.nan}, {"offset": 0.03}]
)
def test_what_is_no_trial(wrong: dict[str, object]) -> None:
    with pytest.raises(ValidationError):
        PrimitiveTrial(**({"primitive": "hill"} | wrong))  # type: ignore[arg-type]
    with pytest.raises(ValidationError):
        ExperimentRequest(trials=())


def test_the_running_world_is_not_disturbed() -> None:
    service = Simulator(SimulatorConfig(autostart=False))
    system = LocalSystem([service])
    try:
        before = service.world.checkpoint()
        reply = service.queries.experiment(ExperimentRequest(trials=(PrimitiveTrial(primitive="hill"),) * 2)).result(
            120.0
        )
        after = service.world.checkpoint()
        assert [each.status for each in reply.outcomes] == ["ok", "ok"]
        assert reply.outcomes[0] == reply.outcomes[1]
        assert reply.robot_hash == ROBOT.hash
        assert np.array_equal(before.physics, after.physics)
        assert before.meta == after.meta
    finally:
        system.close()
