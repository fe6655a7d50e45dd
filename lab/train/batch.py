"""Batches of simulated navigation episodes, one action in each per call; base of the Gymnasium environments."""

import math
import os
from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from surefoot.arrays import Array, Flags, Ints
from surefoot.errors import SurefootError
from surefoot.kernels.jit import free_kernel
from surefoot.services.navigator.belief.ukf import DRIFT
from surefoot.services.navigator.environment.model import EpisodeRoom, EpisodeState, episode_room, episode_state
from surefoot.services.navigator.environment.world import act, begin
from surefoot.services.navigator.policy import arrays as slots
from surefoot.services.navigator.policy.arrays import ModelTables, arrays
from surefoot.services.navigator.policy.choose import allow, features
from surefoot.services.navigator.policy.params import NavigationModel

OBSERVATION = 6
THREADED = 512
"""Least number of episodes per thread if a batch uses several threads; below twice this number it uses one."""


class BatchRoom(NamedTuple):
    """Inputs and results of a step of `count` parallel episodes, one row per episode."""

    episodes: Ints
    """Index of the episode that begins next in each row, which selects its random draws, (count,)."""
    chosen: Ints
    """Index of the action that each episode takes next, (count,)."""
    renew: Flags
    """True for episodes that restart in this call, False for those that take their action, (count,)."""
    observation: Array
    """Observations (count, 6): goal distance m, sine and cosine of bearing, entropy nats, drift rad/m, 1 = blocked."""
    mask: Flags
    """True for actions that are allowed in each episode, False for others, (count, A)."""
    reward: Array
    """Reward of the last action of each episode, (count,): minus its duration, s, or the bonus at the goal."""
    terminated: Flags
    """True for episodes that ended because the robot reached the goal, else False, (count,)."""
    truncated: Flags
    """True for episodes that ended at the time limit, else False, (count,)."""


@free_kernel
def _observe(model: ModelTables, state: EpisodeState, e: int, batch: BatchRoom) -> None:
    """Write row e of the batch: observation, mask of allowed actions, flags of goal reached and of time limit."""
    mean, status, row = state.ahead_mean, state.status, batch.observation[e]
    d, phi, h = features(mean, state.ahead_cov, model.scene[0].goal_x, model.scene[0].goal_y)
    row[0] = min(d, 100.0)
    row[1], row[2] = math.sin(phi), math.cos(phi)
    row[3] = min(max(h, -50.0), 50.0)
    row[4] = min(max(mean[DRIFT], -50.0), 50.0) if mean.size > DRIFT else 0.0
    row[5] = status.blocked
    batch.terminated[e] = status.outcome == slots.REACHED
    batch.truncated[e] = status.outcome == slots.CUT_OFF
    allow(model, status, batch.mask[e])


@free_kernel
def _allowed(model: ModelTables, batch: BatchRoom, e: int, blocked: bool) -> int:
    """Return the chosen action of episode e; if it is not allowed, the first turn (while blocked) or walk instead."""
    if not batch.mask[e, batch.chosen[e]]:
        wanted = slots.TURNING if blocked else slots.WALK
        for a in range(model.actions.shape[0]):
            if model.actions[a].kind == wanted:
                return a
    return batch.chosen[e]


@free_kernel
def _step(
    model: ModelTables,
    run: int,
    part: tuple[int, int],
    only_renew: bool,
    states: EpisodeState,
    batch: BatchRoom,
    room: EpisodeRoom,
) -> None:
    """Begin flagged episodes in rows first .. end - 1, and execute one action in each other one, in place."""
    stride = batch.episodes.size
    for e in range(part[0], part[1]):
        state = EpisodeState(
            states.rng[e], states.marks[e], states.first[e], states.truth[e], states.mean[e], states.cov[e],
            states.ahead_mean[e], states.ahead_cov[e], states.status[e],
        )  # fmt: skip
        if batch.renew[e]:
            begin(model.scene[0], run, batch.episodes[e], state)
            batch.episodes[e] += stride
            batch.reward[e] = 0.0
        elif only_renew:
            continue
        else:
            action = _allowed(model, batch, e, state.status.blocked > 0.0)
            batch.reward[e] = act(model, run, batch.episodes[e] - stride, action, state, room)
        _observe(model, state, e, batch)


class EpisodeBatch:
    """Batch of simulated episodes of a navigating robot, advanced in parallel.

    An observation is distance of the goal m, sine and cosine of its bearing, entropy nats, drift rad/m, 1 = blocked.

    Args:
        model: navigation model of the robot.
        count: number of parallel episodes, 1 to 100000.

    Attributes:
        observation: observations, (count, 6).
        reward: minus the duration of the last action, s, or the bonus at the goal, (count,).
        terminated: True where the goal was reached, (count,).
        truncated: True where the time limit was reached, (count,).
        mask: True for actions that are allowed, (count, A).
    """

    def __init__(self, model: NavigationModel, count: int) -> None:
        if not 1 <= count <= 100_000:
            raise SurefootError("invalid", f"got {count}, allowed are 1 to 100000 episodes at a time", "num_envs")
        self.world, self.count = arrays(model), count
        self._states, n = episode_state(self.world, count), self.world.states
        self._room = BatchRoom(
            np.arange(count, dtype=np.int64),
            np.zeros(count, dtype=np.int64),
            np.zeros(count, dtype=np.bool_),
            np.zeros((count, OBSERVATION)),
            np.ones((count, len(self.world.names)), dtype=np.bool_),
            np.zeros(count),
            np.zeros(count, dtype=np.bool_),
            np.zeros(count, dtype=np.bool_),
        )
        *_, self.observation, self.mask, self.reward, self.terminated, self.truncated = self._room
        threads = min(os.cpu_count() or 1, max(1, count // THREADED))
        self._parts = list(pairwise(count * i // threads for i in range(threads + 1)))
        self._rooms = [episode_room(n) for _ in range(threads)]
        self._pool = ThreadPoolExecutor(threads) if threads > 1 else None
        self.reseed(0)

    def reseed(self, seed: int) -> None:
        """Set the seed (>= 0) of the following episodes, starting with the first episode of that seed."""
        if seed < 0:
            raise SurefootError("invalid", f"got {seed}, allowed is a seed >= 0", "seed")
        self._run = (seed % (1 << 62)) + 1
        self._room.episodes[:] = range(self.count)

    @property
    def seconds(self) -> Array:
        """Simulated time since the beginning of each episode, (count,) s."""
        return self._states.status["time"]

    def begin(self, which: Flags) -> None:
        """Begin a new episode where `which` (count,) is True; leave the other episodes unchanged."""
        self._room.renew[:] = which
        self._call(only_renew=True)

    def act(self, chosen: Ints) -> None:
        """Execute one action in each of the n episodes; `chosen`: index of the action, (n,).

        Raises:
            SurefootError: `chosen` has another length, or an index that the model does not have.
        """
        self.step(chosen, np.zeros(self.count, dtype=np.bool_))

    def step(self, chosen: Ints, renew: Flags) -> None:
        """Execute one action in each of the n episodes, or begin a new episode instead.

        Args:
            chosen: index of the action, (n,).
            renew: True where a new episode begins, False where the action is executed, (n,).

        Raises:
            SurefootError: `chosen` has another length, or an index that the model does not have.
        """
        count = len(self.world.names)
        if chosen.shape != (self.count,) or chosen.min() < 0 or chosen.max() >= count:
            raise SurefootError(
                "invalid", f"got actions {chosen!r}, allowed are {self.count} of 0 to {count - 1}", "action"
            )
        self._room.chosen[:], self._room.renew[:] = chosen, renew
        self._call(only_renew=False)

    def _call(self, *, only_renew: bool) -> None:
        def part(bounds: tuple[int, int], room: EpisodeRoom) -> None:
            _step(self.world.tables, self._run, bounds, only_renew, self._states, self._room, room)

        if self._pool is None:
            part(self._parts[0], self._rooms[0])
        else:
            list(self._pool.map(part, self._parts, self._rooms))
