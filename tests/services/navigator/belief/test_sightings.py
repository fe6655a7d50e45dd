"""Memory of a lost robot: bounded in size and in work for any time; a portioned search finds what a whole one does."""

import math

import numpy as np
import pytest

from surefoot.services.navigator.belief.places import TRIED
from surefoot.services.navigator.belief.relocalise import Relocaliser
from surefoot.services.navigator.belief.sightings import FORGET_S, LONGEST, MOST, SightingMemory
from tests.services.navigator.belief.floors import EASY, LENGTH, ROUGH, Eye, floor, relocalise
from tests.services.navigator.belief.test_relocalise import glances

HERE = (0.0, 0.0, 0.0)
TRUTH = np.array([2.0, 0.1, 0.3])


def test_a_quarter_of_an_hour_of_frames_takes_no_more_room_than_a_minute() -> None:
    memory, eye = SightingMemory(EASY, LENGTH), Eye(floor(1, 40.0, copied=0.5), EASY, 1, recognised=0.45, false=0.3)
    frames = [eye.look(TRUTH)[0] for _ in range(200)]
    size = sum(array.nbytes for array in memory.tables)
    for i in range(9_000):
        memory.add(frames[i % 200], HERE, 0.1 * i)
    assert sum(array.nbytes for array in memory.tables) == size
    place, _, _, count, total = memory.seen_from(HERE, 10_000)
    assert len(place) <= MOST
    assert count.max() == LONGEST
    assert total <= MOST * LONGEST


def test_what_was_not_seen_again_is_forgotten() -> None:
    memory, eye = SightingMemory(EASY, LENGTH), Eye(floor(1), EASY, 1, recognised=0.5)
    memory.add(eye.look(TRUTH)[0], HERE, 0.0)
    assert len(memory.seen_from(HERE, 99)[0]) > 0
    later = eye.look(TRUTH + np.array([0.0, 0.0, math.pi]))[0]
    memory.add(later, HERE, FORGET_S + 1.0)
    assert len(memory.seen_from(HERE, 99)[0]) == len(later)


def test_sightings_lie_as_they_do_from_another_pose() -> None:
    memory, eye = SightingMemory(ROUGH, LENGTH), Eye(floor(1), ROUGH, 1, recognised=0.5)
    memory.add(eye.look(TRUTH)[0], HERE, 0.0)
    place, spread, *_ = memory.seen_from(HERE, 99)
    turned, its_spread, *_ = memory.seen_from((0.3, -0.2, 0.7), 99)
    c, s = math.cos(0.7), math.sin(0.7)
    back = turned @ np.array([[c, s], [-s, c]]) + (0.3, -0.2)
    assert back == pytest.approx(place, abs=1e-12)
    assert its_spread[:, 0] + its_spread[:, 2] == pytest.approx(spread[:, 0] + spread[:, 2], rel=0.2)


@pytest.mark.parametrize("noise", [EASY, ROUGH])
def test_a_search_in_portions_returns_what_a_whole_one_does_and_no_portion_is_large(noise) -> None:
    world, work = floor(3, 60.0, copied=0.5), 4000
    seen = glances(Eye(world, noise, 3, recognised=0.45, false=0.1), TRUTH, 10)
    whole, parts = relocalise(seen, world, noise), Relocaliser(world, noise)
    for i, glance in enumerate(seen):
        parts.add(glance.seen, glance.pose, 0.1 * i)
    found, steps, most, before = parts.step(HERE, work), 1, 0, 0
    while found is None:
        assert parts._search is not None
        now = int(parts._search.cursor[TRIED])
        most, before = max(most, now - before), now
        found, steps = parts.step(HERE, work), steps + 1
    assert steps > 3
    assert most <= work / parts.sightings.seen_from(HERE, 64)[3].size + 1
    assert (found.pose, found.probability, found.reason) == (whole.pose, whole.probability, whole.reason)
    assert parts.step(HERE, work) is None  # nothing new was seen


def test_a_look_after_an_hour_takes_no_more_work_than_the_first() -> None:
    """Work is counted by kernels, in comparisons, so the test does not depend on the machine."""
    world = floor(3, 60.0, copied=0.5)
    eye, parts = Eye(world, EASY, 3, recognised=0.45, false=0.1), Relocaliser(world, EASY)
    frames = [eye.look(TRUTH)[0] for _ in range(100)]
    portions = []
    for i in range(3000):
        parts.add(frames[i % 100], HERE, 0.1 * i)
        if i % 500 == 499:
            count = 1
            while parts.step(HERE, 4000) is None:
                count += 1
            portions.append(count)
    assert max(portions) <= 2 * min(portions)
