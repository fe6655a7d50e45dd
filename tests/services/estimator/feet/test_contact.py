"""Contact points of robots."""

import numpy as np
import pytest

from surefoot.robot.reader import load_robot
from surefoot.services.estimator.feet.contact import contact_points, point_feet, probabilities, sole_feet


def test_a_sole_has_three_points_in_its_plane():
    normal = np.array([[0.0, 1.0, 0.0], [0.6, 0.0, 0.8]])
    points = sole_feet(normal, 0.1)
    assert points.foot.tolist() == [0, 0, 0, 1, 1, 1]
    np.testing.assert_allclose(np.linalg.norm(points.place, axis=1), 0.1)
    for f in range(2):
        np.testing.assert_allclose(points.place[3 * f : 3 * f + 3] @ normal[f], 0.0, atol=1e-15)
        np.testing.assert_allclose(points.place[3 * f : 3 * f + 3].sum(axis=0), 0.0, atol=1e-15)


@pytest.mark.parametrize(
    ("robot", "points", "round_feet"), [("nao", 6, False), ("bioloid", 6, False), ("ragno", 6, True)]
)
def test_points_of_the_robots(robot, points, round_feet):
    found = contact_points(load_robot(robot))
    assert len(found.foot) == points
    assert (found.radius > 0.0).all() == round_feet
    if not round_feet:
        assert 0.05 < np.linalg.norm(found.place[0]) < 0.2
    assert found.switches.shape == ((6, 1, 3) if round_feet else (2, 4, 3))
    np.testing.assert_allclose(found.switches[:, :, 2], 0.0, atol=1e-9)  # in the sole, in which the foot's centre is


def test_probabilities_of_feet_are_those_of_their_points():
    points = sole_feet(np.array([[0.0, 0.0, 1.0]] * 2), 0.1)
    np.testing.assert_allclose(probabilities(points.foot, np.array([1.0, 0.0])), [0.98] * 3 + [0.0] * 3)
    assert np.isnan(probabilities(point_feet(np.zeros(1)).foot, np.array([np.nan]))).all()
