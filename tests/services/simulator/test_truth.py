"""Truth of the feet: sliding is told from rolling, stances are counted."""

import mujoco
import numpy as np
import pytest

from services.simulator.model import Physics
from services.simulator.terrain import make_terrain
from services.simulator.truth import GATE_N, LIFT_TICKS
from services.simulator.world import TICK_STEPS, World, WorldConfig
from surefoot.robot import load_robot

RAGNO = load_robot("ragno")


@pytest.fixture(scope="module")
def world() -> World:
    return World(RAGNO, make_terrain("flat"), config=WorldConfig(imu_profile="ideal", physics=Physics(friction=0.7)))


def test_a_trunk_that_sinks_rolls_the_feet_but_hardly_slides_them(world: World) -> None:
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


def test_sliding_is_the_way_of_a_robot_that_is_pulled(world: World) -> None:
    world.reset()
    world.set("friction", 0.02)
    world.push((1.5, 0.0, 0.0), 0.3)
    start = world.truth()
    for _ in range(40):
        world.step_tick()
    truth = world.truth()
    way = truth.position[0] - start.position[0]
    assert way > 0.02
    np.testing.assert_allclose(truth.contact_sliding, way, rtol=0.05)
    np.testing.assert_allclose(truth.foot_displacement, way, rtol=0.05)


def test_sliding_per_tick_equals_the_integral_of_the_contact_velocity(world: World) -> None:
    """The sum over ticks against the tangential velocity of the contact point at every physics step."""
    world.reset()
    world.set("friction", 0.02)
    world.push((1.5, 0.0, 0.0), 0.3)
    m, d, feet = world.model, world.data, world.address.foot_bodies
    fine = np.zeros(6)
    velocity = np.zeros(6)
    for _ in range(40):
        world.disturb.before_step(world.tick + 1, d, None)
        world.tick += 1
        for _ in range(TICK_STEPS):
            mujoco.mj_step(m, d)
            mujoco.mj_kinematics(m, d)
            mujoco.mj_comPos(m, d)
            mujoco.mj_comVel(m, d)
            for i, body in enumerate(feet):
                mujoco.mj_objectVelocity(m, d, mujoco.mjtObj.mjOBJ_XBODY, int(body), velocity, 0)
                local = RAGNO.legs[i].foot.position
                arm = d.xmat[body].reshape(3, 3) @ local - [0.0, 0.0, RAGNO.foot_radius]
                at = velocity[3:] + np.cross(velocity[:3], arm)
                fine[i] += np.hypot(at[0], at[1]) * m.opt.timestep
        world.steps += TICK_STEPS
        world._finish_tick()
    assert fine.min() > 0.01
    np.testing.assert_allclose(world.truth().contact_sliding, fine, rtol=0.03, atol=1e-4)


def test_stances_are_counted_and_a_bounce_is_none(world: World) -> None:
    world.reset()
    lifted = RAGNO.neutral.copy()
    lifted[RAGNO.legs[1].joints[1]] += 0.5
    for _ in range(3):
        for _ in range(40):
            world.step_tick(lifted)
        truth = world.truth()
        assert truth.foot_force_n[1] == 0.0
        assert truth.contact_sliding[1] == truth.foot_displacement[1] == 0.0
        for _ in range(40):
            world.step_tick(RAGNO.neutral)
    assert world.truth().stances.tolist() == [0, 3, 0, 0, 0, 0]
    feet = world.tracker.feet
    feet.below[0] = LIFT_TICKS - 2  # two ticks without force: still the same stance
    before = feet.start[0].copy()
    world.step_tick(RAGNO.neutral)
    assert world.truth().foot_force_n[0] > GATE_N
    np.testing.assert_array_equal(feet.start[0], before)


def test_trunk_contact_is_a_fall_that_stays(world: World) -> None:
    world.reset()
    folded = RAGNO.neutral.copy()
    folded[[leg.joints[1] for leg in RAGNO.legs]] = np.radians(85.0)
    for _ in range(100):
        world.step_tick(folded)
    assert world.truth().fallen
    for _ in range(150):
        world.step_tick(RAGNO.neutral)
    assert world.truth().fallen
    world.reset()
    assert not world.truth().fallen
