"""Truth of the feet: sliding is distinguished from rolling, stances are counted."""

import mujoco
import numpy as np
import pytest

from surefoot.robot.reader import load_robot
from surefoot.services.simulator.ground.terrain import make_terrain
from surefoot.services.simulator.physics.model import Physics
from surefoot.services.simulator.physics.truth import GATE_N, LIFT_TICKS
from surefoot.services.simulator.world import TICK_STEPS, PhysicsWorld, WorldConfig
from tests.services.simulator.stepping import steps

RAGNO = load_robot("ragno")


@pytest.fixture(scope="module")
def world() -> PhysicsWorld:
    return PhysicsWorld(
        RAGNO, make_terrain("flat"), config=WorldConfig(imu_profile="ideal", physics=Physics(friction=0.7))
    )


def test_a_trunk_that_sinks_rolls_the_feet_but_hardly_slides_them(world: PhysicsWorld) -> None:
    world.reset()
    start = world.truth().foot_position
    for k in range(25):
        q, bend = RAGNO.neutral.copy(), 0.05 * np.sin(2.0 * np.pi * k / 100.0)
        for leg in RAGNO.legs:
            q[leg.joints[1]] += bend
            q[leg.joints[2]] -= bend
        world.step_tick(q)
    truth = world.truth()
    moved = np.linalg.norm((truth.foot_position - start)[:, :2], axis=1)
    assert moved.min() > 0.1e-3
    np.testing.assert_allclose(truth.foot_displacement, moved, atol=1e-9)
    assert truth.contact_sliding.max() < 0.05 * moved.min()


def test_sliding_is_the_way_of_a_robot_that_is_pulled(world: PhysicsWorld) -> None:
    world.reset()
    world.set("friction", 0.02)
    world.push((1.5, 0.0, 0.0), 0.3)
    start = world.truth()
    steps(world, 40)
    truth = world.truth()
    way = truth.position[0] - start.position[0]
    assert way > 0.02
    np.testing.assert_allclose(truth.contact_sliding, way, rtol=0.05)
    np.testing.assert_allclose(truth.foot_displacement, way, rtol=0.05)


def test_sliding_is_the_integral_of_the_contact_points_velocity(world: PhysicsWorld) -> None:
    """Against MuJoCo's own velocities and contact forces, looked up after every physics step."""
    world.reset()
    world.set("friction", 0.02)
    world.push((1.5, 0.3, 0.0), 0.3)
    m, d = world.model, world.data
    expected, velocity, wrench = np.zeros(6), np.zeros(6), np.zeros(6)
    for _ in range(40):
        world.tick += 1
        world.disturb.before_step(world.tick, d, None)
        for _ in range(TICK_STEPS):
            mujoco.mj_step(m, d)
            for i in range(d.ncon):  # contacts and velocities both belong to the state before integration
                foot = world.address.foot_of_geom[d.contact[i].geom].max()
                body = int(world.address.foot_bodies[foot])
                mujoco.mj_contactForce(m, d, i, wrench)
                mujoco.mj_objectVelocity(m, d, mujoco.mjtObj.mjOBJ_XBODY, body, velocity, 0)
                at = velocity[3:] + np.cross(velocity[:3], d.contact[i].pos - d.xpos[body])
                expected[foot] += np.hypot(at[0], at[1]) * m.opt.timestep * (wrench[0] >= GATE_N)
        world.steps += TICK_STEPS
        world._finish_tick()
    assert expected.min() > 0.01
    np.testing.assert_allclose(world.truth().contact_sliding, expected, rtol=0.005)


def test_stances_are_counted_and_a_bounce_is_none(world: PhysicsWorld) -> None:
    world.reset()
    lifted = RAGNO.neutral.copy()
    lifted[RAGNO.legs[1].joints[1]] += 0.5
    for _ in range(3):
        steps(world, 40, lifted)
        truth = world.truth()
        assert truth.foot_force_n[1] == 0.0
        assert truth.contact_sliding[1] == truth.foot_displacement[1] == 0.0
        steps(world, 40, RAGNO.neutral)
    assert world.truth().stances.tolist() == [0, 3, 0, 0, 0, 0]
    feet = world.tracker.feet
    feet.below[0] = LIFT_TICKS - 2  # two ticks without force: still the same stance
    before = feet.start[0].copy()
    world.step_tick(RAGNO.neutral)
    assert world.truth().foot_force_n[0] > GATE_N
    np.testing.assert_array_equal(feet.start[0], before)


def test_trunk_contact_is_a_fall_that_stays(world: PhysicsWorld) -> None:
    world.reset()
    folded = RAGNO.neutral.copy()
    folded[[leg.joints[1] for leg in RAGNO.legs]] = np.radians(85.0)
    steps(world, 100, folded)
    assert world.truth().fallen
    steps(world, 150, RAGNO.neutral)
    assert world.truth().fallen
    world.reset()
    assert not world.truth().fallen
