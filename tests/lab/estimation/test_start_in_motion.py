"""Walks whose inertial unit is shaken by every step, begun from a rest or seen from their middle on."""

from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from surefoot.lab.estimation.faults import from_the_middle
from surefoot.lab.estimation.track import track
from tests.lab.estimation.test_foreign_motion import tilts, trotted, trotting

SPEED, BEGIN_S, SEEDS = 0.5, 6.0, 3
SHAKEN, SHAKEN_S = 0.4, 0.05  # standard deviation of the accelerometer's error, m/s^2, and time for which it lasts, s


def shaken(stamps: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Errors of an accelerometer that last for some time, (n, 3) m/s^2."""
    keep = np.exp(-np.median(np.diff(stamps)) / SHAKEN_S)
    error = np.zeros((len(stamps), 3))
    for i in range(1, len(stamps)):
        error[i] = keep * error[i - 1] + np.sqrt(1.0 - keep**2) * SHAKEN * rng.standard_normal(3)
    return error


def test_a_start_in_a_shaken_walk_is_as_sure_and_as_good_as_the_walk_allows() -> None:
    """The noise of the walk is not known yet: a start with that of a robot at rest blames the feet for it."""
    log = trotting(SPEED, BEGIN_S + 5.0)
    nees, first, later = [], [], []
    for seed in range(SEEDS):
        cut = from_the_middle(replace(log, q=log.q + shaken(log.seconds, np.random.default_rng(seed))), BEGIN_S)
        found, t = track("best", cut), cut.seconds
        at = BEGIN_S + t
        speed = np.gradient(trotted(SPEED, at), at)
        true = Rotation.from_rotvec(tilts(at)).inv().apply(np.outer(speed, [1.0, 0.0, 0.0]))
        off, started = found.v - true, found.flags["initialised"]
        begins, goes_on = started & (t < 2.5), started & (t > 3.0)
        assert started[t > 1.0].all()
        nees.append(
            np.einsum("ni,nij,nj->n", off[begins], np.linalg.inv(found.p[begins, 3:, 3:]), off[begins]).mean() / 3
        )
        first.append((off[begins] ** 2).sum(axis=1).mean())
        later.append((off[goes_on] ** 2).sum(axis=1).mean())
    assert np.mean(nees) < 2.2
    assert np.mean(first) < 2.5 * np.mean(later)


def test_the_first_steps_after_a_rest_are_not_surer_than_the_walk_allows() -> None:
    """A rest shows the noise of the sensors alone: the error of the first steps was nine times its stated deviation."""
    log, nees = trotting(SPEED, 5.0), []
    walks, first = log.seconds > 3.0, (log.seconds > 3.0) & (log.seconds < 3.5)
    for seed in range(SEEDS):
        error = shaken(log.seconds, np.random.default_rng(seed)) * walks[:, None]
        found = track("best", replace(log, q=log.q + error))
        speed = np.gradient(trotted(SPEED, log.seconds), log.seconds)
        true = Rotation.from_rotvec(tilts(log.seconds)).inv().apply(np.outer(speed, [1.0, 0.0, 0.0]))
        off = (found.v - true)[first]
        nees.append(np.einsum("ni,nij,nj->n", off, np.linalg.inv(found.p[first, 3:, 3:]), off).mean() / 3)
    assert np.mean(nees) < 20.0
