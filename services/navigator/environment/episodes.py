"""Simulation of whole episodes of a policy, one after the other, in a kernel."""

import math

import numpy as np

from surefoot.arrays import Array, Record, named
from surefoot.kernels.jit import free_kernel

from ..belief.ukf import THETA, X, Y, wrap
from ..policy import arrays as slots
from ..policy.arrays import Arrays, ModelTables
from ..policy.choose import ChoiceRoom, PolicyTables, choose, room_to_choose
from ..policy.decider import Policy
from .model import EpisodeRoom, EpisodeState, episode_room, episode_state
from .world import act, begin

RESULT = named("seconds ended decisions stands turns error nees_sum nees_at")
"""Fields of an episode's result: duration, s; outcome (1 goal reached, 2 cut off); numbers of actions, stands and
turns; final error of the estimate, m; sum over decisions of the pose's NEES (normalised estimation error squared, 3
degrees of freedom); NEES after decision 20."""
NEES_DECISION = 20
"""Ordinal of the decision after which the pose's normalised estimation error squared (NEES) is kept in the result."""


@free_kernel
def nees(truth: Array, mean: Array, cov: Array) -> float:
    """Return the normalised error squared e^T P^-1 e of a pose, 3 degrees of freedom.

    Args:
        truth: true x, y (m), heading (rad), frame map, (3,) or longer.
        mean: believed x, y (m), heading (rad), (3,) or longer; e = truth - mean with the heading wrapped.
        cov: covariance of `mean`, (3, 3) or larger; P is its first 3x3 block.
    """
    e0, e1, e2 = truth[X] - mean[X], truth[Y] - mean[Y], wrap(truth[THETA] - mean[THETA])
    l00 = math.sqrt(cov[0, 0])
    l10, l20 = cov[1, 0] / l00, cov[2, 0] / l00
    l11 = math.sqrt(cov[1, 1] - l10 * l10)
    l21 = (cov[2, 1] - l20 * l10) / l11
    l22 = math.sqrt(cov[2, 2] - l20 * l20 - l21 * l21)
    y0 = e0 / l00
    y1 = (e1 - l10 * y0) / l11
    y2 = (e2 - l20 * y0 - l21 * y1) / l22
    return y0 * y0 + y1 * y1 + y2 * y2


@free_kernel
def _run(
    policy: PolicyTables,
    knows: bool,
    model: ModelTables,
    run: int,
    start: int,
    state: EpisodeState,
    rooms: tuple[EpisodeRoom, ChoiceRoom],
    results: Record,
) -> None:
    """Simulate episodes one after the other and write their results, a record each, (count,).

    Args:
        policy: policy that decides the actions.
        knows: True = the policy gets true pose and drift; False: the belief.
        model: actions and scene.
        run: seed of the series of episodes.
        start: number of the first episode.
        state: state of an episode, overwritten.
        rooms: scratch of the episode and of the decision.
        results: written, (count,) records with the fields of `RESULT`.
    """
    room, choice = rooms
    scene, status, truth, sure = model.scene[0], state.status, state.truth, np.zeros((4, 4))
    for e in range(results.shape[0]):
        begin(scene, run, start + e, state)
        stands, turns, total = 0, 0, 0.0
        while status.outcome == slots.RUNNING:
            if knows:
                for i in range(4):
                    state.ahead_mean[i] = truth[i]
            cov = sure if knows else state.ahead_cov
            chosen = choose(policy, model, state.ahead_mean, cov, scene.goal_x, scene.goal_y, status, choice)
            act(model, run, start + e, chosen, state, room)
            stands += model.actions[chosen].kind == slots.STAND
            turns += model.actions[chosen].kind == slots.TURNING
            error = nees(truth, state.mean, state.cov)
            total += error
            if status.steps == NEES_DECISION:
                results[e].nees_at = error
        found = results[e]
        found.seconds, found.ended, found.decisions = status.time, status.outcome, status.steps
        found.stands, found.turns, found.nees_sum = stands, turns, total
        found.error = math.sqrt((truth[X] - state.mean[X]) ** 2 + (truth[Y] - state.mean[Y]) ** 2)


def run_episodes(world: Arrays, policy: Policy, run: int, start: int, count: int, knows: bool = False) -> Record:
    """Return the results of episodes start .. start + count - 1 of seed `run`, a record each, (count,).

    Fields: `seconds` (s), `ended` (1 goal reached, 2 cut off), `decisions`, `stands` and `turns` (counts), `error`
    (distance of the belief from the truth at the end, m), `nees_sum` and `nees_at` (normalised errors squared of the
    pose: sum over all decisions, and the one after decision 20, 0 in shorter episodes).

    Args:
        world: arrays of the model.
        policy: decides the actions.
        run: seed; equal seeds and episodes have equal floors, drifts and starts, whatever the policy.
        start: number of the first episode.
        count: number of episodes.
        knows: the policy gets true pose and drift instead of the belief, a limit that no filter can beat.
    """
    n, state = world.states, episode_state(world)
    if knows:
        state = state._replace(ahead_mean=np.zeros(max(n, 4)))
    rooms, results = (episode_room(n), room_to_choose(n, len(world.names))), np.zeros(count, RESULT)
    _run(policy.tables, knows, world.tables, run, start, state, rooms, results)
    return results
