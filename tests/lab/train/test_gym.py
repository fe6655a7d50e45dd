"""The Gymnasium environments: the checker's demands, and one equals many."""

import numpy as np
import pytest

from surefoot.lab.train.batch import EpisodeBatch
from surefoot.services.navigator.policy.params import load

pytestmark = pytest.mark.filterwarnings("ignore::UserWarning", "ignore::DeprecationWarning")

try:
    import gymnasium
except ImportError:
    gymnasium = None
needs_gym = pytest.mark.skipif(gymnasium is None, reason="gymnasium is not installed: pip install surefoot[gym]")


def test_each_of_many_is_as_if_it_were_alone():
    model = load("paper", ["scene.time_limit=60"])
    many = EpisodeBatch(model, 5)
    many.begin(np.ones(5, dtype=np.bool_))
    actions = np.random.default_rng(0).integers(0, 4, size=(30, 5))
    trace = []
    for row in actions:
        many.act(row)
        trace.append((many.observation.copy(), many.reward.copy()))
    for e in range(5):
        alone = EpisodeBatch(model, 1)
        for _ in range(e + 1):
            alone.begin(np.ones(1, dtype=np.bool_))
        for row, (seen, reward) in zip(actions, trace, strict=True):
            alone.act(row[e : e + 1])
            assert np.array_equal(alone.observation[0], seen[e])
            assert alone.reward[0] == reward[e]


def test_threads_change_nothing():
    model = load("paper")
    few, many = EpisodeBatch(model, 10), EpisodeBatch(model, 2000)
    for b in (few, many):
        b.reseed(3)
        b.begin(np.ones(b.count, dtype=np.bool_))
        for _ in range(5):
            b.act(np.zeros(b.count, dtype=np.int64))
    assert np.array_equal(few.observation, many.observation[:10])


@needs_gym
def test_check_env_passes():
    from gymnasium.utils.env_checker import check_env

    from surefoot.lab.train.gym import NavigatorEnv

    check_env(NavigatorEnv(), skip_render_check=True)
    check_env(NavigatorEnv(load("nao")), skip_render_check=True)


@needs_gym
def test_termination_and_truncation_are_apart():
    from surefoot.lab.train.gym import NavigatorEnv

    env = NavigatorEnv(load("paper", ["scene.goal_x=0.3", "filter.heading_sd_deg=0", "drift.per_10cm_deg=0"]))
    env.reset(seed=1)
    for _ in range(4):
        _, reward, terminated, truncated, _ = env.step(0)
        if terminated:
            break
    assert (terminated, truncated, reward) == (True, False, 200.0)
    env = NavigatorEnv(load("paper", ["scene.time_limit=2"]))
    env.reset(seed=1)
    ends = [env.step(0)[2:4] for _ in range(2)]
    assert ends == [(False, False), (False, True)]


@needs_gym
def test_the_vector_environment_equals_single_ones_and_begins_anew():
    from surefoot.lab.train.gym import NavigatorEnv, NavigatorVectorEnv

    model = load("paper", ["scene.time_limit=9"])
    vector, single = NavigatorVectorEnv(3, model), NavigatorEnv(model)
    seen, _ = vector.reset(seed=7)
    alone, _ = single.reset(seed=7)
    assert np.array_equal(seen[0], alone)
    assert vector.observation_space.contains(seen)
    for step in range(12):
        seen, reward, terminated, truncated, _ = vector.step(np.zeros(3, dtype=np.int64))
        if step < 6:
            alone, one, *_ = single.step(0)
            assert np.array_equal(seen[0], alone)
            assert reward[0] == one
        if step == 5:
            assert truncated.all()
        if step == 6:
            assert not truncated.any()
            assert not terminated.any()
            assert (reward == 0).all()
