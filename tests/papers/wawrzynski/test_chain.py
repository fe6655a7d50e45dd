"""Equations (5)-(14): the recursion against derivatives of the foot's position, and the printed signs."""

import numpy as np
import pytest

from surefoot.papers.wawrzynski import chain as legs
from surefoot.papers.wawrzynski.synthetic import bioloid_chains
from surefoot.robot.reader import load_robot
from surefoot.services.estimator.feet.mount import feet_in_imu, foot_mount

STENCIL = ((-2, 1.0 / 12.0), (-1, -8.0 / 12.0), (1, 8.0 / 12.0), (2, -1.0 / 12.0))


def derivative(function, h=1e-3):
    """Five-point derivative at 0."""
    return sum(weight * function(k * h) for k, weight in STENCIL) / h


def pose_of(chain, theta):
    return legs.foot_pose(legs.descend(chain, theta, np.zeros(theta.size), np.zeros(3)))


def cases():
    rng = np.random.default_rng(3)
    for name in ("ragno", "messor"):
        robot = load_robot(name)
        for leg in range(robot.nlegs):
            q = rng.uniform(robot.joint_lower, robot.joint_upper)
            chain = legs.chain_from_robot(robot, leg)
            yield chain, legs.chain_angles(chain, q), legs.chain_angles(chain, rng.normal(size=robot.nj)), rng
    for chain in bioloid_chains():
        for _ in range(5):
            yield chain, rng.uniform(-0.8, 0.8, 6), rng.normal(size=6), rng


def test_kinematics_and_gyro_is_minus_dp_minus_w_cross_p():
    for chain, theta, rate, rng in cases():
        w = rng.normal(size=3)
        state = legs.descend(chain, theta, rate, w)
        p, _ = legs.foot_pose(state)
        dp = derivative(lambda s, c=chain, t=theta, r=rate: pose_of(c, t + s * r)[0])
        v = legs.velocity_kinematics_gyro(state, np.zeros(3))
        np.testing.assert_allclose(v, -dp - np.cross(w, p), atol=2e-11)


def test_kinematics_alone_is_the_derivative_in_a_foot_that_keeps_its_orientation():
    for chain, theta, rate, _ in cases():

        def imu_in_foot(s, c=chain, t=theta, r=rate):
            p, rot = pose_of(c, t + s * r)
            return -rot.T @ p

        state = legs.descend(chain, theta, rate, np.zeros(3))
        _, rot = legs.foot_pose(state)
        np.testing.assert_allclose(legs.velocity_kinematics(state), rot @ derivative(imu_in_foot), atol=2e-11)


def test_a_pivot_under_the_ankle_is_the_fixed_point():
    for chain, theta, rate, rng in cases():
        w, pivot = rng.normal(size=3), rng.normal(size=3) * 0.05
        state = legs.descend(chain, theta, rate, w)

        def point(s, c=chain, t=theta, r=rate, at=pivot):
            p, rot = pose_of(c, t + s * r)
            return p + rot @ at

        expected = -derivative(point) - np.cross(w, point(0.0))
        np.testing.assert_allclose(legs.velocity_kinematics_gyro(state, pivot), expected, atol=2e-11)


def test_foot_turns_by_12():
    for chain, theta, rate, rng in cases():
        w = rng.normal(size=3)
        state = legs.descend(chain, theta, rate, w)
        _, rot = legs.foot_pose(state)
        spin = derivative(lambda s, c=chain, t=theta, r=rate: pose_of(c, t + s * r)[1]) @ rot.T
        relative = np.array([spin[2, 1], spin[0, 2], spin[1, 0]])  # of the foot against the IMU, IMU axes
        np.testing.assert_allclose(rot @ state.w_1, w + relative, atol=1e-10)


def test_the_printed_signs_are_wrong():
    """(8) with p x z theta' and (12) with the IMU's z axis miss the identity by decimetres and radians per second."""
    chain, rng = bioloid_chains()[0], np.random.default_rng(5)
    theta, rate, w = rng.uniform(-0.8, 0.8, 6), rng.normal(size=6), rng.normal(size=3)
    p, v8, w12, axes = np.zeros(3), np.zeros(3), chain.imu_axes @ w, chain.imu_axes
    z = np.array([0.0, 0.0, 1.0])
    for i in range(5, -1, -1):
        c, s = np.cos(theta[i]), np.sin(theta[i])
        turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
        rot = turn @ chain.rot[i]
        p = turn @ chain.shift[i] + rot @ p
        v8 = rot @ v8 + np.cross(p, z) * rate[i]
        axes = rot @ axes
        w12 = rot @ w12 - axes[:, 2] * rate[i]
    state = legs.descend(chain, theta, rate, w)
    np.testing.assert_allclose(p, state.p_1, atol=1e-12)
    assert np.linalg.norm(v8 - state.v_1) > 0.1
    assert np.linalg.norm(w12 - state.w_1) > 1.0


@pytest.mark.parametrize("name", ["ragno", "messor"])
def test_chain_of_a_robot_ends_at_its_foot(name):
    robot, rng = load_robot(name), np.random.default_rng(1)
    mount = foot_mount(robot)
    for leg in range(robot.nlegs):
        q = rng.uniform(robot.joint_lower, robot.joint_upper)
        chain = legs.chain_from_robot(robot, leg)
        p, _ = pose_of(chain, legs.chain_angles(chain, q))
        np.testing.assert_allclose(p, feet_in_imu(mount, q)[0][leg], atol=1e-14)


def test_straight_legs_of_the_biped_hang_level():
    for side, chain in zip((1.0, -1.0), bioloid_chains(), strict=True):
        p, rot = pose_of(chain, np.zeros(6))
        np.testing.assert_allclose(p[1], side * 0.0385, atol=1e-12)
        np.testing.assert_allclose(rot[:, 0], [0.0, 0.0, 1.0], atol=1e-12)
