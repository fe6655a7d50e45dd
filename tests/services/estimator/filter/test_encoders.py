"""Jumps of encoders beside thrown trunks, and switches that hang beside those that open and close."""

import math

import numpy as np
import pytest

from surefoot.geometry import rotations
from surefoot.services.estimator.filter import monitor
from surefoot.services.estimator.filter.encoders import jumped
from surefoot.services.estimator.filter.layout import SENSOR_COLUMNS, S
from surefoot.services.estimator.filter.samples import SampleStore
from surefoot.services.estimator.filter.switches import judge_switches

FINE = 2000  # steps of the true motion in a second
STEP_S = 1.0 / 30.0


def thrown(seed: int, jump_m: float = 0.0, slack: float = 0.0) -> SampleStore:
    """Return samples of a foot that stands below a trunk whose acceleration and rate change all the time.

    The true motion is integrated at 2 kHz; the inertial unit gives means over 10 ms, the encoders a place at 30 Hz, of
    which the last two may be off by `jump_m` and the stamps by a part `slack` of a step.
    """
    rng = np.random.default_rng(seed)
    t = np.arange(round(0.25 * FINE)) / FINE
    waves = rng.uniform(20.0, 60.0, (6, 1)) * t + rng.uniform(0.0, 2.0 * math.pi, (6, 1))
    acc = np.sin(waves[:3]).T * rng.uniform(10.0, 20.0, 3)
    rate = np.sin(waves[3:]).T * rng.uniform(0.5, 2.0, 3)
    rot, vel, pos = np.empty((t.size, 3, 3)), np.empty((t.size, 3)), np.empty((t.size, 3))
    r, v, p = rotations.matrix_from_rpy(*rng.uniform(-0.3, 0.3, 3)), rng.normal(0.0, 0.5, 3), np.zeros(3)
    for i in range(t.size):
        rot[i], vel[i], pos[i] = r, v, p
        turn = rate[i] / FINE
        angle = np.linalg.norm(turn)
        axis = np.cross(np.eye(3), turn / angle)
        r = r @ (np.eye(3) + math.sin(angle) * axis + (1.0 - math.cos(angle)) * axis @ axis)
        p, v = p + v / FINE + 0.5 * acc[i] / FINE**2, v + acc[i] / FINE
    felt = np.einsum("nij,ni->nj", rot, acc + np.array([0.0, 0.0, 9.81]))
    imu = np.concatenate([rate, felt], axis=1).reshape(-1, FINE // 100, 6).mean(axis=1)
    at = (0.05 + STEP_S * (np.arange(4) + slack * rng.uniform(-0.5, 0.5, 4))) * FINE
    rows, place = np.round(at).astype(int), rng.normal(0.0, 0.3, 3)
    feet = np.einsum("nij,ni->nj", rot[rows], place - pos[rows])
    feet[2:] += jump_m * np.array([0.6, 0.0, 0.8])
    return SampleStore(
        (np.arange(1, len(imu) + 1) * 10_000_000), imu, (rows * (1_000_000_000 // FINE)), feet[:, None].copy(),
        np.tile(np.eye(3), (4, 1, 1, 1)), np.ones((4, 1)), np.ones((4, 1), dtype=np.int64),
    )  # fmt: skip


def bent(samples: SampleStore) -> float:
    """Return by how far the middle step is from the mean of its neighbours as the encoders show it, m."""
    steps = np.diff(samples.feet[:, 0], axis=0)
    return float(np.linalg.norm(steps[1] - 0.5 * (steps[0] + steps[2])))


@pytest.mark.parametrize("slack", [0.0, 0.3])
def test_a_foot_that_stands_does_not_jump_when_the_trunk_is_thrown(slack: float) -> None:
    stores = [thrown(seed, slack=slack) for seed in range(60)]
    assert sum(bent(store) > 0.015 for store in stores) > 10  # the encoders alone would show jumps
    assert not any(jumped(store, 3, 0, 0, 0.0) > 0.0 for store in stores)


def test_an_encoder_that_jumps_is_found_below_a_thrown_trunk() -> None:
    stores = [thrown(seed, jump_m=0.03) for seed in range(60)]
    seen = [jumped(store, 3, 0, 0, 0.0) > 0.0 for store in stores]
    assert all(found for found, store in zip(seen, stores, strict=True) if bent(store) > 0.015)
    assert sum(seen) > 45


def judged(open_s: float, more: float = 1.25, *, flies: bool = False, others: int = 1) -> list[bool]:
    """Return which switches of four feet are wrong after 2 s in which the first ones contradict their motion.

    They open and close every `open_s`; while they are closed their feet move more than others, by the logarithm `more`.
    """
    sensors, dt = np.zeros((4, SENSOR_COLUMNS)), 1.0 / 30.0
    for k in range(60):
        closed = (k * dt) % (2.0 * open_s) >= open_s
        contact, size = np.array([0.0, 1.0, 0.0, 1.0]), np.array([-0.5, -2.0, -0.5, -2.0])
        contact[:others], size[:others] = float(closed), -1.75 + more if closed else -1.5 - more
        judge_switches(sensors, size, contact, dt, flies, False)
    return [bool(wrong) for wrong in sensors[:, S.switch] > 0.5]


def test_one_switch_that_opens_and_closes_does_not_hang() -> None:
    assert judged(0.1, 0.4) == [False, False, False, False]
    assert judged(10.0, 0.4) == [True, False, False, False]


def test_one_switch_that_is_inverted_is_found() -> None:
    assert judged(0.15) == [True, False, False, False]


def test_two_switches_that_contradict_their_motion_may_be_swapped() -> None:
    assert judged(0.1, 0.4, others=2)[:2] == [True, True]


def test_no_open_switch_is_wrong_while_the_robot_flies() -> None:
    assert judged(10.0, flies=True) == [False, False, False, False]


@pytest.mark.parametrize("aloft", [False, True])
def test_half_of_a_contradiction_names_a_switch_while_none_is_closed(aloft: bool) -> None:
    sensors, size, contact = np.zeros((2, SENSOR_COLUMNS)), np.array([-2.0, -1.8]), np.zeros(2)
    for _ in range(60):
        judge_switches(sensors, size, contact, 1.0 / 30.0, False, aloft)
    assert [bool(wrong) for wrong in sensors[:, S.switch] > 0.5] == [aloft, False]


FAST_NS, STANDS = 5_000_000, 20
"""Step of fast samples, ns, and samples of a stance, and of a swing."""


def fast(leap: float, missed: int, off: int = 0) -> SampleStore:
    """Return fast samples of a foot that jumps by `leap` m to where it lands, for five steps.

    Args:
        leap: m, along x.
        missed: number of the landing from which its switch stays open.
        off: sample from which the encoders are 2 cm off; 0: never.
    """
    n = 10 * STANDS
    step, at = np.arange(n) // (2 * STANDS), np.arange(n) % (2 * STANDS)
    closed = at >= STANDS
    feet = np.zeros((n, 1, 3))
    feet[:, 0, 0] = 0.001 * np.where(closed, -at, at) + np.where(closed, leap, 0.0)
    feet[:, 0, 1] = 0.02 if off else 0.0
    feet[:off, 0, 1] = 0.0
    level = np.tile([0.0, 0.0, 0.0, 0.0, 0.0, 9.81], (n, 1))
    contact = (closed & (step < missed)).astype(float)[:, None]
    stamps = FAST_NS * np.arange(1, n + 1)
    return SampleStore(stamps, level, stamps, feet, np.tile(np.eye(3), (n, 1, 1, 1)), contact, contact.astype(np.int64))


def mistrust(store: SampleStore) -> tuple[float, float]:
    """Return the mistrust in the switch of a foot and in its encoders after all samples."""
    own = np.zeros(SENSOR_COLUMNS)
    for row in range(3, len(store.feet)):
        monitor._learn_jump(own, store, row, 0)
    return float(own[S.switch]), float(own[S.jump])


def test_a_foot_that_always_jumps_where_it_lands_has_a_wrong_switch_once_that_stays() -> None:
    assert mistrust(fast(0.15, 9)) == (0.0, 0.0)
    assert mistrust(fast(0.15, 4)) == (1.0, 0.0)
    assert mistrust(fast(0.15, 0)) == (0.0, 1.0)  # that jumps belong to landings was never seen


def test_an_offset_that_begins_beside_a_landing_is_a_jump() -> None:
    for off in (STANDS - 1, STANDS + 1, 3 * STANDS - 1):
        assert mistrust(fast(0.0, 9, off)) == (0.0, 1.0)
