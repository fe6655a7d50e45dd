"""Torque limits of commands: they bind their own command, weak servos stay weak, checkpoints keep them."""

import numpy as np
import pytest

from surefoot.robot.reader import load_robot
from surefoot.services.simulator.ground.terrain import make_terrain
from surefoot.services.simulator.physics.faults import Fault
from surefoot.services.simulator.world import PhysicsWorld, WorldConfig
from tests.services.simulator.stepping import steps
from tests.services.simulator.test_world import march

RAGNO = load_robot("ragno")


@pytest.fixture
def flat() -> PhysicsWorld:
    return PhysicsWorld(RAGNO, make_terrain("flat"), config=WorldConfig(imu_profile="ideal"))


def test_a_torque_limit_holds_for_its_command_only(flat: PhysicsWorld) -> None:
    """Limp servos let the robot down; a limit above what standing takes changes nothing; none sets it up again."""
    steps(flat, 33, RAGNO.neutral)
    load, height = np.abs(flat.data.actuator_force).copy(), flat.truth().position[2]
    ample = np.full(RAGNO.nj, 1.5 * load.max())
    steps(flat, 100, RAGNO.neutral, ample)
    assert flat.truth().position[2] == pytest.approx(height, abs=1e-4)
    scarce = 0.3 * load
    for _ in range(100):
        flat.step_tick(RAGNO.neutral, scarce)
        assert (np.abs(flat.data.actuator_force) <= scarce + 1e-6).all()
    assert flat.truth().position[2] < height - 0.02
    steps(flat, 200, RAGNO.neutral)
    assert np.abs(flat.data.actuator_force).max() > scarce.max()
    assert flat.truth().position[2] > height - 0.01


def test_a_torque_limit_never_raises_what_a_weak_servo_can(flat: PhysicsWorld) -> None:
    own = RAGNO.joints[0].servo.max_torque
    limit = np.full(RAGNO.nj, 0.8 * own)
    flat.add_fault(Fault("servo_weak", 3, 0.05, "", 0.5))
    seen = []
    for _ in range(12):
        flat.step_tick(RAGNO.neutral, limit)
        seen.append(float(flat.model.actuator_forcerange[flat.address.actuators[0], 1]))
    assert sorted(set(seen)) == pytest.approx([0.5 * own, 0.8 * own])
    flat.step_tick(RAGNO.neutral, 9.0 * limit)
    assert flat.model.actuator_forcerange[flat.address.actuators[0], 1] == own


def test_a_torque_limit_outlives_a_checkpoint(flat: PhysicsWorld) -> None:
    limit = np.full(RAGNO.nj, 0.1)
    for tick in range(7):
        flat.step_tick(march(tick), limit)
    saved = flat.checkpoint()
    flat.reset()
    assert flat.model.actuator_forcerange[flat.address.actuators[0], 1] == RAGNO.joints[0].servo.max_torque
    flat.restore(saved)
    flat.step_tick()
    assert np.abs(flat.data.actuator_force).max() <= 0.1 + 1e-6
    assert flat.checkpoint().sha256 != saved.sha256
