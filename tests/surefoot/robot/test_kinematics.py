import re
from pathlib import Path

import mujoco
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from surefoot.errors import FieldError
from surefoot.robot import kinematics as kin
from surefoot.robot.leg_tree import feet_and_jacobians, leg_arrays
from surefoot.robot.reader import load_robot, robot_names
from surefoot.services.simulator.physics.joints import place_joints
from surefoot.services.simulator.physics.model import build_model

ROBOTS = {name: load_robot(name) for name in robot_names()}
ROBOTS["toy_biped"] = load_robot(Path(__file__).parent / "toy_biped.toml")
HEXAPODS = [name for name, robot in ROBOTS.items() if robot.kind == "hexapod"]
EXACT = 1e-9


def random_pose(robot, rng):
    return rng.uniform(robot.joint_lower, robot.joint_upper)


@pytest.fixture(scope="module", params=sorted(ROBOTS))
def compiled(request):
    robot = ROBOTS[request.param]
    model, addresses = build_model(robot)
    return robot, model, mujoco.MjData(model), addresses


@pytest.fixture
def rng():
    return np.random.default_rng(1)


def poses(compiled, rng, count):
    """Yield random joint angles, each when the robot in MuJoCo has them."""
    robot, model, data, addresses = compiled
    for _ in range(count):
        q = random_pose(robot, rng)
        data.qpos[:] = 0.0
        data.qpos[3] = 1.0
        place_joints(data.qpos, addresses, q)
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        yield q


def per_joint(addresses, columns):
    """Columns of a Jacobian (or a force) by degree of freedom, summed over the axes of each motor."""
    out = columns[..., addresses.joint_dof].copy()
    for j, dof in zip(addresses.coupled, addresses.coupled_dof, strict=True):
        out[..., j] += columns[..., dof]
    return out


def foot_centre(data, addresses, leg):
    body = addresses.bodies[leg.foot.link]
    return data.xpos[body] + data.xmat[body].reshape(3, 3) @ leg.foot.position


def test_forward_equals_mujoco(compiled, rng):
    robot, _, data, addresses = compiled
    for q in poses(compiled, rng, 100):
        rot, pos = kin.forward(robot.model, q)
        assert np.abs(pos - data.xpos[addresses.bodies]).max() < EXACT
        assert np.abs(rot.reshape(-1, 9) - data.xmat[addresses.bodies]).max() < EXACT
        for leg, foot in zip(robot.legs, kin.foot_positions(robot.model, q), strict=True):
            centre = foot_centre(data, addresses, leg)
            assert np.abs(foot - centre).max() < EXACT


def com_jacobian(robot, q):
    return kin.com_jacobian_of(robot.model, *kin.forward(robot.model, q))


def test_centre_of_mass_equals_mujoco(compiled, rng):
    robot, model, data, addresses = compiled
    jac = np.zeros((3, model.nv))
    for q in poses(compiled, rng, 100):
        mujoco.mj_jacSubtreeCom(model, data, jac, addresses.trunk)
        assert np.abs(kin.com(robot.model, q) - data.subtree_com[addresses.trunk]).max() < EXACT
        assert np.abs(com_jacobian(robot, q) - per_joint(addresses, jac)).max() < EXACT
    assert kin.total_mass(robot.model) == pytest.approx(model.body_subtreemass[0], abs=1e-12)


def test_foot_jacobians_equal_mujoco(compiled, rng):
    robot, model, data, addresses = compiled
    jac = np.zeros((3, model.nv))
    for q in poses(compiled, rng, 100):
        ours = kin.foot_jacobians(robot.model, q)
        feet, jacobians = feet_and_jacobians(leg_arrays(robot.model), q)
        assert (feet == kin.foot_positions(robot.model, q)).all()
        assert (jacobians == ours).all()
        for i, leg in enumerate(robot.legs):
            centre = foot_centre(data, addresses, leg)
            mujoco.mj_jac(model, data, jac, None, centre, addresses.foot_bodies[i])
            theirs = per_joint(addresses, jac)[:, list(leg.joints)]
            assert np.abs(ours[i, :, : len(leg.joints)] - theirs).max() < EXACT


@pytest.mark.parametrize("shape", [(3,), (26,), (25, 1)])
def test_angles_of_another_shape_are_refused_with_both_shapes(shape):
    with pytest.raises(FieldError, match=re.escape(f"q: got shape {shape}, expected (25,)")):
        feet_and_jacobians(leg_arrays(ROBOTS["nao"].model), np.zeros(shape))


def test_gravity_torques_equal_mujoco_bias_on_a_slope(compiled, rng):
    robot, model, data, addresses = compiled
    g_up = 9.81 * np.array([0.28, -0.6, np.sqrt(1 - 0.28**2 - 0.6**2)])
    model.opt.gravity[:] = -g_up
    data.qvel[:] = 0.0
    for q in poses(compiled, rng, 20):
        mujoco.mj_forward(model, data)
        expected = per_joint(addresses, data.qfrc_bias)
        assert np.abs(kin.gravity_torques(robot.model, q, g_up) - expected).max() < EXACT


@pytest.mark.parametrize("name", sorted(ROBOTS))
def test_jacobians_equal_finite_differences(name, rng):
    robot, step = ROBOTS[name], 1e-6
    for _ in range(5):
        q = random_pose(robot, rng)
        feet, com = kin.foot_jacobians(robot.model, q), com_jacobian(robot, q)
        for j, unit in enumerate(np.eye(robot.nj)):
            up, down = q + step * unit, q - step * unit
            d_com = (kin.com(robot.model, up) - kin.com(robot.model, down)) / (2 * step)
            d_feet = (kin.foot_positions(robot.model, up) - kin.foot_positions(robot.model, down)) / (2 * step)
            assert np.abs(com[:, j] - d_com).max() < 1e-8
            for i, leg in enumerate(robot.legs):
                expected = feet[i, :, leg.joints.index(j)] if j in leg.joints else np.zeros(3)
                assert np.abs(d_feet[i] - expected).max() < 1e-8


@pytest.mark.parametrize("name", HEXAPODS)
@given(shares=st.lists(st.floats(0.0, 1.0), min_size=18, max_size=18))
def test_ik_finds_the_foot_again(name, shares):
    robot = ROBOTS[name]
    q = robot.joint_lower + np.array(shares) * (robot.joint_upper - robot.joint_lower)
    feet = kin.foot_positions(robot.model, q)
    found, reachable = kin.legs_ik(robot.model, feet)
    local = forward_share(robot, q)
    for i, leg in enumerate(robot.legs):
        if local[i] > 1e-6:  # the foot lies outside the coxa axis, so the solution is unique and in the limits
            assert reachable[i]
            assert np.abs(kin.foot_positions(robot.model, found)[i] - feet[i]).max() < 1e-7
            if q[leg.joints[2]] < -1e-3:  # away from the straight knee
                assert np.abs(found[list(leg.joints)] - q[list(leg.joints)]).max() < 1e-5


def forward_share(robot, q):
    """Distance of each foot from the coxa axis along the leg, (L,): negative behind the axis."""
    c, f, t = robot.model.segment.T
    q2, q3 = q[robot.model.leg_joints[:, 1]], q[robot.model.leg_joints[:, 2]]
    return c + f * np.cos(q2) + t * np.cos(q2 + q3)


def random_points_are_reached_or_refused(robot, hip, size, rng, times):
    """Points about the hips (L, 3) m: joints within limits, and reachable where the foot is found there."""
    hits = 0
    for _ in range(times):
        leg = int(rng.integers(robot.nlegs))
        joints = list(robot.legs[leg].joints)
        target = hip[leg] + rng.uniform(-size, size, 3)
        angles, reachable = kin.leg_ik(robot.model, leg, target)
        assert np.all(angles >= robot.joint_lower[joints])
        assert np.all(angles <= robot.joint_upper[joints])
        q = robot.neutral.copy()
        q[joints] = angles
        error = np.linalg.norm(kin.foot_positions(robot.model, q)[leg] - target)
        assert reachable == (error < 1e-6)
        hits += reachable
    assert hits > 20


@pytest.mark.parametrize("name", HEXAPODS)
def test_ik_of_random_points_never_claims_what_it_misses(name, rng):
    robot = ROBOTS[name]
    hips = [leg.hip for leg in robot.legs]
    random_points_are_reached_or_refused(robot, hips, 1.2 * robot.model.segment[0].sum(), rng, 2000)


@pytest.mark.parametrize("name", HEXAPODS)
def test_ik_out_of_reach_points_the_leg_at_the_target(name):
    robot = ROBOTS[name]
    c, f, t = robot.model.segment[1]
    target = robot.legs[1].hip + np.array([0.0, c + f + t + 0.02, 0.0])
    q3, reachable = kin.leg_ik(robot.model, 1, target)
    assert not reachable
    assert np.allclose(q3, 0.0, atol=1e-9)


def test_ik_refuses_nan():
    _, reachable = kin.leg_ik(ROBOTS["ragno"].model, 0, np.array([np.nan, 0.0, 0.0]))
    assert not reachable


@pytest.mark.parametrize("name", HEXAPODS)
def test_legs_are_mirror_images(name, rng):
    robot = ROBOTS[name]
    half = robot.nj // 2
    sign = np.tile([-1.0, 1.0, 1.0], half // 3)
    for _ in range(20):
        left = rng.uniform(robot.joint_lower[:half], robot.joint_upper[:half])
        q = np.concatenate([left, sign * left])
        feet = kin.foot_positions(robot.model, q)
        assert np.allclose(feet[:3] * [1, -1, 1], feet[3:])
        assert kin.com(robot.model, q)[1] == pytest.approx(0.0, abs=1e-12)
