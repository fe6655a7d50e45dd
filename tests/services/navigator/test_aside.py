"""Where a lost robot walks whose sights fit two places: to landmarks that differ, free at both, not too far."""

import math

import numpy as np
import pytest

from surefoot.services.navigator.aside import ENOUGH, way_aside
from surefoot.services.navigator.belief.apart import AROUND, FAR, telling
from surefoot.services.navigator.belief.landmarks import FloorLandmarks
from surefoot.services.navigator.goals import NavigationGoal
from surefoot.services.navigator.pilot import Pilot
from surefoot.services.navigator.planning.costs import prepare
from surefoot.services.navigator.planning.grid import OCCUPIED, FloorGrid
from tests.services.navigator.belief.floors import EASY, unit
from tests.services.navigator.test_pilot import ACTS, Run, TowardsGoal

HERE = (0.0, 0.0, 0.0)
THERE = (20.0, 0.0, math.pi)
"""Pose at which the floor looks as it does at HERE, but for some landmarks."""


def twin(seed, new=0, at=(2.0, 0.0)):
    """Two floors of 6 x 6 m, alike from HERE and THERE but for a number of new landmarks at a place of the first."""
    rng = np.random.default_rng(seed)
    own, looks = rng.uniform(-3.0, 3.0, (200, 2)), unit(rng.standard_normal((200, 8)))
    more = np.array(at) + rng.uniform(-0.3, 0.3, (new, 2))
    places = np.vstack((own, (20.0, 0.0) - own, more))
    return FloorLandmarks(places, np.vstack((looks, looks, unit(rng.standard_normal((new, 8))))))


def grid(walls):
    """Costs of a floor from (-3, -3) to (23, 3), m, with walls as rows and columns of cells of 0.1 m."""
    cells = np.zeros((60, 260), dtype=np.int8)
    for rows, cols in walls:
        cells[rows, cols] = OCCUPIED
    return prepare(FloorGrid(cells, 0.1, (-3.0, -3.0)))


@pytest.mark.parametrize("seed", range(5))
def test_landmarks_that_differ_are_counted_as_one_by_one(seed):
    world, rng = twin(seed, new=10), np.random.default_rng(seed)
    poses = np.array([HERE, THERE]) + rng.uniform(-0.1, 0.1, (2, 3))
    ends = rng.uniform(-2.0, 2.0, (5, 2))
    look = 0.5
    for end, found in zip(ends, telling(poses, ends, world, look), strict=True):
        count = 0
        for one, other in (poses, poses[::-1]):
            for place, shown in zip(world.positions, world.descriptors, strict=True):
                z = np.exp(-1j * one[2]) * complex(*(place - one[:2]))
                if abs(z - complex(*end)) < AROUND:
                    image = complex(*other[:2]) + np.exp(1j * other[2]) * z
                    near = np.hypot(*(world.positions - (image.real, image.imag)).T) < FAR
                    count += not (near & (np.linalg.norm(world.descriptors - shown, axis=1) < look)).any()
        assert found == count


@pytest.mark.parametrize("at", [(2.0, 0.0), (-1.6, 1.6), (0.0, -2.5)])
def test_the_way_leads_to_the_landmarks_that_differ_and_no_farther(at):
    way = way_aside((HERE, THERE), twin(1, new=20, at=at), EASY, None)
    assert way is not None
    assert math.dist(way, at) < AROUND + 0.3
    assert math.hypot(*way) < math.hypot(*at)


def test_a_floor_that_is_there_twice_has_no_such_way():
    world = twin(1)
    assert way_aside((HERE, THERE), world, EASY, None) is None
    assert way_aside((HERE,), world, EASY, None) is None
    assert way_aside((), world, EASY, None) is None


def test_a_way_is_free_at_every_place_that_it_may_be():
    world = twin(1, new=20)
    for wall in ((slice(0, 60), 40), (slice(0, 60), 219)):  # 1 m ahead at HERE, at THERE
        way = way_aside((HERE, THERE), world, EASY, grid([wall]))
        assert way is None or way[0] < 0.9
    open_way = way_aside((HERE, THERE), world, EASY, grid([]))
    assert open_way == way_aside((HERE, THERE), world, EASY, None)
    assert open_way is not None
    assert open_way[0] > 0.9
    assert telling(np.array([HERE, THERE]), np.array([open_way]), world, 0.5)[0] >= ENOUGH


def searching(way, blocked=False):
    run = Run()
    run.pilot = Pilot(ACTS, commands=True, aside=lambda: way)
    goal = NavigationGoal("g", ((1.5, 0.0),), "towards", 0.0, start=(0.0, 0.0))
    run.pilot.begin(goal, TowardsGoal())
    run.blocked, run.lost = blocked, True
    assert run.finish() == ("failed", "lost")
    return run, goal


def test_a_robot_that_stays_lost_walks_aside_three_times_and_looks_around_after_each():
    run, goal = searching((0.3, 0.0))
    assert goal.recoveries["walk_aside"] == 3
    assert goal.recoveries["turn_and_look"] == 4 * 7
    assert run.walker.x**2 + run.walker.y**2 > 0.04


@pytest.mark.parametrize(("way", "blocked"), [(None, False), ((0.3, 0.0), True)])
def test_a_lost_robot_walks_nowhere_without_a_way_or_before_an_obstacle(way, blocked):
    run, _ = searching(way, blocked)
    assert (run.walker.x, run.walker.y) == (0.0, 0.0)
