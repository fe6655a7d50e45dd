"""Search over beliefs as a peer of the planner: a sure robot goes to the goal, and equal seeds give equal choices."""

import numpy as np
import pytest

from benchmarks.bench_navigator_belief import Peer
from surefoot.services.navigator.environment.draws import seed
from surefoot.services.navigator.environment.model import episode_state
from surefoot.services.navigator.environment.world import scatter
from surefoot.services.navigator.policy.arrays import LAST, STATUS, arrays
from surefoot.services.navigator.policy.library import find
from surefoot.services.navigator.policy.params import load

MODEL = load("paper", ["drift.per_10cm_deg=0"])
WORLD = arrays(MODEL)
COV = np.diag([0.01, 0.01, 0.01, 0.01]) ** 2


def floor():
    state = episode_state(WORLD)
    seed(state.rng, 1, 2, 3)
    scatter(WORLD.scene, state.rng, state.marks, state.first)
    return state.marks, state.first


@pytest.mark.parametrize(("kind", "sims"), [("rollouts", 16), ("tree", 400)])
@pytest.mark.parametrize(("heading", "wanted"), [(0.0, "walk"), (-1.6, "left"), (1.6, "right")])
def test_a_sure_robot_turns_to_the_goal_and_walks_there(kind, sims, heading, wanted):
    planner = find("planner", MODEL, WORLD)
    status = np.zeros(STATUS)
    status[LAST] = -1.0
    chosen = [
        Peer(WORLD, planner, find("tuned", MODEL, WORLD), kind, sims, 8, 2.0, 2.0).decide(
            floor(), 7, np.array([2.0, 0.0, heading, 0.0]), COV, status
        )
        for _ in range(2)
    ]
    assert [WORLD.names[i] for i in chosen] == [wanted, wanted]
