"""Slopes that are taken for level: their errors are published, and a source that measures the height corrects them."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from surefoot.geometry.constants import GRAVITY
from surefoot.lab.estimation.external import Externals
from surefoot.lab.estimation.log import Log
from surefoot.lab.estimation.track import Track, track
from surefoot.services.estimator.filter.layout import LEVEL, MEMORY, E, M, X
from surefoot.services.estimator.filter.noise import FIXED
from surefoot.services.estimator.filter.slope import add_to_gravity, add_to_pose, give_to_filter, learn_level_way
from surefoot.services.estimator.filter.state import new_state
from surefoot.services.estimator.inputs.external import ExternalSample
from tests.lab.estimation.test_foreign_motion import tilts, trotted, trotting

SPEED, SECONDS = 0.5, 24.0


def climbing(slope: float) -> Log:
    """A trot up a slope with an accelerometer whose bias hides it."""
    log = trotting(SPEED, SECONDS, slope=slope)
    return replace(log, q=log.q + np.array([-GRAVITY * slope, 0.0, 0.05]))


def climbed(log: Log, found: Track) -> np.ndarray:
    """Height over that of the rest before the first step, (n,) m."""
    return found.position[:, 2] - found.position[np.searchsorted(log.seconds, 2.5), 2]


@pytest.mark.parametrize("slope", [0.0105, -0.0105, 0.005])
def test_height_and_tilt_on_a_gentle_slope_are_within_three_published_deviations(slope: float) -> None:
    log = climbing(slope)
    found, walks = track("best", log), log.seconds > 4.0
    assert found.pose is not None
    way = trotted(SPEED, log.seconds)
    off = climbed(log, found) - slope * way
    assert abs(off[-1]) > 0.03  # taken for level, which feet alone cannot help
    assert (off[walks] ** 2 < 9.0 * found.pose[walks, 2, 2]).all()
    up = Rotation.from_rotvec(tilts(log.seconds)).inv().apply([0.0, 0.0, GRAVITY])
    wrong = (found.g - up)[walks]
    nees = np.einsum("ni,nij,nj->n", wrong, np.linalg.pinv(found.p[walks, :3, :3]), wrong) / 2.0
    assert nees.mean() < 3.0
    assert found.flags["filter_ok"][walks].all()


def test_a_camera_corrects_the_height_on_a_slope_and_levels_do_not_take_it_back() -> None:
    """The camera sees the last 6 s only, when the height is off by many deviations of the filter alone."""
    slope, log = 0.0105, climbing(0.0105)
    rng, samples, stamps = np.random.default_rng(0), [], []
    for i in range(1, len(log.stamp_ns), 20):
        seen = 0.05 < log.seconds[i] < 3.0 or log.seconds[i] > SECONDS - 6.0
        if seen:
            way = float(trotted(SPEED, log.seconds[i]))
            place = np.array([way, 0.0, slope * way]) + 0.005 * rng.standard_normal(3)
            noise = 0.005**2 * np.eye(3)
            samples.append(
                ExternalSample(position=place, position_covariance=noise, yaw=0.0, yaw_variance=1e-4).row()[0]
            )
            stamps.append(int(log.stamp_ns[i]))
    whole = np.array(stamps)
    found = track("best", replace(log, external=Externals(whole, whole, np.array(samples))))
    assert found.externals is not None
    assert found.externals.left_out < 0.05 * len(samples)
    assert climbed(log, found)[-1] == pytest.approx(slope * trotted(SPEED, log.seconds[-1]), abs=0.02)


def test_covariances_are_those_of_random_slopes() -> None:
    """80 000 slopes: the height a level ground hides, and the turn that makes the slope level."""
    rng, memory, way = np.random.default_rng(1), np.zeros(MEMORY), np.array([3.0, -1.0])
    memory[M.level_way : M.level_way + 2], memory[M.levelled] = way, 1.0
    slopes = FIXED.hidden_slope * rng.standard_normal((80_000, 2))
    normal = np.hstack([-slopes, np.ones((len(slopes), 1))])
    turn = np.cross(normal, [0.0, 0.0, 1.0])  # takes the normal of the ground to the vertical, for small slopes
    errors = np.column_stack([np.zeros((len(slopes), 2)), -slopes @ way, turn])
    wanted, found = errors.T @ errors / len(slopes), np.zeros((6, 6))
    add_to_pose(memory, found)
    assert found == pytest.approx(wanted, abs=3e-6)
    rot = Rotation.from_rotvec([0.3, -0.2, 1.0]).as_matrix()
    g = GRAVITY * np.array([rot.T @ Rotation.from_rotvec(one).as_matrix() @ [0.0, 0.0, 1.0] for one in turn[:4000]])
    found = np.zeros((3, 3))
    add_to_gravity(memory, np.ascontiguousarray(rot[2]), found)
    assert found == pytest.approx(np.cov(g.T), abs=2e-4)


def test_a_way_that_closes_hides_nothing() -> None:
    memory, x = np.zeros(MEMORY), np.zeros(X.points)
    for place in ((0.0, 0.0), (2.0, 0.0), (2.0, 1.0), (0.0, 1.0), (0.0, 0.0)):
        x[X.pos : X.pos + 2] = place
        learn_level_way(memory, x, True)
    assert memory[M.level_way : M.level_way + 2] == pytest.approx([0.0, 0.0])
    x[X.pos] = 5.0
    for _ in range(100):
        learn_level_way(memory, x, False)  # no level: the ground shows its height
    x[X.pos], before = 9.0, memory[M.level_way]
    learn_level_way(memory, x, False)
    assert memory[M.level_way] == pytest.approx(before, abs=1e-4)
    assert memory[M.levelled] < 1e-4


def test_the_filter_takes_over_what_levels_hide() -> None:
    state = new_state(4)
    state.memory[M.level_way], state.memory[M.levels + 1] = 10.0, 1e-6
    before = state.cov[E.pos + 2, E.pos + 2]
    give_to_filter(state)
    square = (10.0 * FIXED.hidden_slope) ** 2
    assert state.cov[E.pos + 2, E.pos + 2] == pytest.approx(before + square)
    assert state.memory[M.levels + 1] == pytest.approx(1e-6 + square)
    assert state.memory[M.levels + LEVEL + 1] == 0.0  # no level there
    assert state.memory[M.level_way] == 0.0
