"""Feet seen from the IMU."""

import numpy as np
import pytest

from surefoot.robot.reader import load_robot
from surefoot.services.estimator.feet import mount as feet


def test_mount_puts_feet_into_imu_axes():
    robot = load_robot("ragno")
    mount = feet.foot_mount(robot)
    turned = mount._replace(rot_imu_from_base=np.diag([-1.0, -1.0, 1.0]), imu_position=np.array([0.01, 0.0, 0.02]))
    p, _ = feet.feet_in_imu(mount, robot.neutral)
    q, _ = feet.feet_in_imu(turned, robot.neutral)
    np.testing.assert_allclose(q, (p - [0.01, 0.0, 0.02]) * [-1.0, -1.0, 1.0], atol=1e-14)
    assert mount.radius.tolist() == [robot.foot_radius] * 6


def test_unknown_feet_are_lifted():
    position, rot = np.ones((3, 3)), np.tile(np.eye(3), (3, 1, 1))
    contact = np.array([[1.0, 0.0], [0.2, 0.7], [np.nan, np.nan]])
    same = feet.known_feet(position, rot, contact)
    np.testing.assert_array_equal(same[0], position)
    np.testing.assert_array_equal(same[2], [1.0, 0.7, np.nan])
    np.testing.assert_array_equal(same[3], [0b01, 0b10, 0b11])
    assert same[4]
    position[0, 2], rot[1, 0, 1] = np.nan, np.inf
    clean = feet.known_feet(position, rot, contact)
    assert np.isfinite(clean[0]).all()
    np.testing.assert_array_equal(clean[1], np.tile(np.eye(3), (3, 1, 1)))
    np.testing.assert_array_equal(clean[2], [0.0, 0.0, np.nan])
    assert clean[4]  # the third may stand
    assert not feet.known_feet(position[:2], rot[:2], contact[:2])[4]


def test_a_bare_mount_has_no_joints():
    with pytest.raises(AssertionError):
        feet.feet_in_imu(feet.bare_mount(2), np.zeros(3))
