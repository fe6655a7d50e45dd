"""Many episodes side by side, one action in each per call; base of the Gymnasium environments."""

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
"""Number of parallel episodes from which on more than one thread is used."""


class BatchRoom(NamedTuple):
    """Work arrays of a step of many episodes: inputs and results, one row per episode."""

    episodes: Ints
    """Number of the episode that begins next in each row, which selects its random draws, (count,)."""
    chosen: Ints
    """Index of the action that each episode takes next, (count,)."""
    renew: Flags
    """True for episodes that restart in this call, False for those that take their action, (count,)."""
    observation: Array
    """Observations of the episodes, (count, OBSERVATION)."""
    mask: Flags
    """True for actions that are allowed in each episode, False for others, (count, A)."""
    reward: Array
    """Reward of the last action of each episode, (count,)."""
    terminated: Flags
    """True for episodes that ended because the robot reached the goal, (count,)."""
    truncated: Flags
    """True for episodes that ended at the time limit, (count,)."""


@free_kernel
def _observe(model: ModelTables, state: EpisodeState, e: int, batch: BatchRoom) -> None:
    """Write row e of the batch: observation, mask of allowed actions, and the flags of goal and time limit."""
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
    """Return the chosen action of an episode, or the first turn or walk in place of one that is not allowed."""
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
    """Begin the flagged episodes of a part (first, end), and do one action in each of its others, in place."""
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
    """Simulated episodes of a navigating robot, side by side.

    An observation is distance of the goal m, sine and cosine of its bearing, entropy nats, drift rad/m, 1 = blocked.

    Args:
        model: navigation model of the robot.
        count: number of episodes at a time, 1 to 100000.

    Attributes:
        observation: (count, 6).
        reward: reward of the last action, (count,) s.
        terminated: true where the goal was reached, (count,).
        truncated: true where the time is out, (count,).
        mask: actions that are allowed, (count, A).
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
        """Begin a new episode where `which` (count,) is True; the others stay as they are."""
        self._room.renew[:] = which
        self._call(only_renew=True)

    def act(self, chosen: Ints) -> None:
        """Do one action in each of the n episodes; `chosen`: index of the action, (n,).

        Raises:
            SurefootError: another number of actions, or one that the model does not have.
        """
        self.step(chosen, np.zeros(self.count, dtype=np.bool_))

    def step(self, chosen: Ints, renew: Flags) -> None:
        """Do one action in each of the n episodes, or begin a new one instead.

        Args:
            chosen: index of the action, (n,).
            renew: True where a new episode begins, (n,).

        Raises:
            SurefootError: another number of actions, or one that the model does not have.
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
