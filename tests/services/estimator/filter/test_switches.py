"""Switches of two feet that contradict the height of one over the other."""

import numpy as np
import pytest

from surefoot.arrays import Array
from surefoot.services.estimator.filter.layout import HEIGHTS, SENSOR_COLUMNS, S
from surefoot.services.estimator.filter.switches import judge_heights, rewired

BOTH_S, ONE_S = 0.3, 0.5
"""Time on both feet, and on one."""


def steps(seed: int, rate_hz: float, rough_m: float) -> tuple[Array, Array]:
    """Return heights (n, 2) m of two feet that walk for 20 steps over ground of random heights, and contacts (n, 2).

    A foot in the air rises by 2 to 5 cm over the higher one of its two places, all heights scatter by 0.5 mm.
    """
    rng = np.random.default_rng(seed)
    ground, heights, contact = rng.uniform(0.0, rough_m, 2), [], []
    both, one = round(BOTH_S * rate_hz), round(ONE_S * rate_hz)
    for k in range(20):
        f, to = k % 2, rng.uniform(0.0, rough_m)
        phase = (np.arange(one) + 0.5) / one
        over = np.sin(np.pi * phase) * (rng.uniform(0.02, 0.05) + abs(to - ground[f]))
        rows, stands = np.tile(ground, (both + one, 1)), np.ones((both + one, 2))
        rows[both:, f] = ground[f] + phase * (to - ground[f]) + over
        stands[both:, f] = 0.0
        ground[f] = to
        heights.append(rows)
        contact.append(stands)
    all_heights = np.concatenate(heights)
    return all_heights + rng.normal(0.0, 5e-4, all_heights.shape), np.concatenate(contact)


def judged(heights: Array, contact: Array, rate_hz: float, *, shows: bool = True) -> Array:
    """Return the sensors of the feet after all samples; mistrust does not fade."""
    own, sensors = np.zeros(HEIGHTS), np.zeros((2, SENSOR_COLUMNS))
    sensors[:, S.wired] = foot = np.arange(2)
    for (a, b), closed in zip(heights, contact, strict=True):
        judge_heights(own, sensors, a - b, rewired(closed, sensors, foot), 1.0 / rate_hz, shows)
    return sensors


@pytest.mark.parametrize("rough_m", [0.0, 0.01, 0.15])
@pytest.mark.parametrize("rate_hz", [33.0, 200.0])
def test_no_switch_is_wrong_on_any_ground(rate_hz: float, rough_m: float) -> None:
    for seed in range(40):
        sensors = judged(*steps(seed, rate_hz, rough_m), rate_hz)
        assert sensors[:, S.switch].tolist() == [0.0, 0.0]
        assert sensors[:, S.wired].tolist() == [0.0, 1.0]


@pytest.mark.parametrize("closed", [0.0, 1.0])
@pytest.mark.parametrize("foot", [0, 1])
def test_a_switch_that_hangs_is_found_at_the_next_step(foot: int, closed: float) -> None:
    for seed in range(20):
        heights, contact = steps(seed, 100.0, 0.0)
        stands = np.flatnonzero(contact.sum(axis=1) == 2.0)
        at = int(stands[stands > 400][seed % 25])
        contact[at:, foot] = closed
        sensors = judged(heights[: at + 160], contact[: at + 160], 100.0)
        assert sensors[:, S.switch].tolist() == [float(foot == f) for f in range(2)]
        assert sensors[:, S.wired].tolist() == [0.0, 1.0]


def test_swapped_switches_are_swapped_back_and_forth() -> None:
    for seed in range(20):
        heights, contact = steps(seed, 100.0, 0.0)
        at = 400 + 13 * seed
        contact[at:] = contact[at:, ::-1]
        sensors = judged(heights, contact, 100.0)
        assert sensors[:, S.switch].tolist() == [0.0, 0.0]
        assert sensors[:, S.wired].tolist() == [1.0, 0.0]
        contact[1000:] = contact[1000:, ::-1]
        assert judged(heights, contact, 100.0)[:, S.wired].tolist() == [0.0, 1.0]


def test_open_switches_of_a_robot_that_leaps_are_right() -> None:
    heights, contact = steps(0, 100.0, 0.0)
    contact[400:, :] = 0.0
    assert judged(heights, contact, 100.0, shows=False)[:, S.switch].tolist() == [0.0, 0.0]
    assert judged(heights, contact, 100.0)[:, S.switch].sum() == 1.0
