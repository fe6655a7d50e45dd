"""Many episodes side by side, one action in each per call; what the Gymnasium environments are made of."""

import math
import os
from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from surefoot.errors import SurefootError
from surefoot.kernels.jit import free_kernel
from surefoot.services.navigator.environment.world import act, begin, cells, room_for, work_space_of
from surefoot.services.navigator.policy.arrays import (
    BLOCKED,
    CUT_OFF,
    GOAL_X,
    GOAL_Y,
    KIND,
    OUTCOME,
    REACHED,
    STATUS,
    TIME,
    TURNING,
    WALK,
    arrays,
)
from surefoot.services.navigator.policy.choose import allow, features
from surefoot.services.navigator.policy.params import NavigationModel

Array = NDArray[np.float64]
Ints = NDArray[np.int64]
Flags = NDArray[np.bool_]

OBSERVATION = 6
THREADED = 512
"""Episodes from which on more than one thread pays."""


@free_kernel
def _observe(
    scene: Array, actions: Array, mean: Array, cov: Array, status: Array, observation: Array, mask: Flags
) -> None:
    d, phi, h = features(mean, cov, scene[GOAL_X], scene[GOAL_Y])
    observation[0] = min(d, 100.0)
    observation[1], observation[2] = math.sin(phi), math.cos(phi)
    observation[3] = min(max(h, -50.0), 50.0)
    observation[4] = min(max(mean[3], -50.0), 50.0) if mean.size > 3 else 0.0
    observation[5] = status[BLOCKED]
    allow(actions, scene, status, mask)


@free_kernel
def _step(
    scene: Array,
    actions: Array,
    switching: Array,
    run: int,
    start: int,
    end: int,
    renew: Flags,
    only_renew: bool,
    chosen: Ints,
    episodes: Ints,
    stride: int,
    rng: NDArray[np.uint64],
    marks: Array,
    first: Ints,
    truth: Array,
    mean: Array,
    cov: Array,
    ahead_mean: Array,
    ahead_cov: Array,
    status: Array,
    noise: Array,
    gain: Array,
    work: Array,
    observation: Array,
    mask: Flags,
    reward: Array,
    terminated: Flags,
    truncated: Flags,
) -> None:
    """Begin or act in episodes start .. end - 1; noise, gain and work are scratch of the caller."""
    for e in range(start, end):
        if renew[e]:
            begin(
                scene,
                run,
                episodes[e],
                rng[e],
                marks[e],
                first[e],
                truth[e],
                mean[e],
                cov[e],
                ahead_mean[e],
                ahead_cov[e],
                status[e],
            )
            episodes[e] += stride
            reward[e] = 0.0
        elif only_renew:
            continue
        else:
            action = chosen[e]
            if not mask[e, action]:
                wanted = TURNING if status[e, BLOCKED] > 0.0 else WALK
                for a in range(actions.shape[0]):
                    if actions[a, KIND] == wanted:
                        action = a
                        break
            reward[e] = act(
                scene,
                actions,
                switching,
                run,
                episodes[e] - stride,
                action,
                rng[e],
                marks[e],
                first[e],
                truth[e],
                mean[e],
                cov[e],
                ahead_mean[e],
                ahead_cov[e],
                status[e],
                noise,
                gain,
                work,
            )
        terminated[e] = status[e, OUTCOME] == REACHED
        truncated[e] = status[e, OUTCOME] == CUT_OFF
        _observe(scene, actions, ahead_mean[e], ahead_cov[e], status[e], observation[e], mask[e])


class Batch:
    """Episodes side by side.

    Args:
        model: the robot.
        count: number of episodes at a time, 1 to 100000.

    Attributes:
        observation: what is observed, (count, OBSERVATION).
        reward: of the last action, (count,).
        terminated: the goal was reached, (count,).
        truncated: out of time, (count,).
        mask: the actions that are allowed, (count, A).
    """

    def __init__(self, model: NavigationModel, count: int) -> None:
        if not 1 <= count <= 100_000:
            raise SurefootError("invalid", f"got {count}, allowed are 1 to 100000 episodes at a time", "num_envs")
        self.world, self.count = arrays(model), count
        n, a, (nx, ny) = self.world.states, len(self.world.names), cells(self.world.scene)
        self.observation, self.reward = np.zeros((count, OBSERVATION)), np.zeros(count)
        self.terminated, self.truncated = np.zeros(count, dtype=np.bool_), np.zeros(count, dtype=np.bool_)
        self.mask = np.ones((count, a), dtype=np.bool_)
        self._status = np.zeros((count, STATUS))
        self._state = (
            np.zeros((count, 4), dtype=np.uint64),
            np.zeros((count, room_for(self.world.scene), 2)),
            np.zeros((count, nx * ny + 1), dtype=np.int64),
            np.zeros((count, 6)),
            np.zeros((count, n)),
            np.zeros((count, n, n)),
            np.zeros((count, n)),
            np.zeros((count, n, n)),
            self._status,
        )
        self._out = self.observation, self.mask, self.reward, self.terminated, self.truncated
        self._none = np.zeros(count, dtype=np.bool_)
        self._chosen = np.zeros(count, dtype=np.int64)
        threads = min(os.cpu_count() or 1, max(1, count // THREADED))
        edges = [count * i // threads for i in range(threads + 1)]
        self._parts = list(pairwise(edges))
        self._rooms = [(np.zeros(4), np.zeros((2, max(0, n - 4))), work_space_of(n)) for _ in range(threads)]
        self._pool = ThreadPoolExecutor(threads) if threads > 1 else None
        self.reseed(0)

    def reseed(self, seed: int) -> None:
        """Let the next episodes be those of a seed (>= 0), from the first on."""
        if seed < 0:
            raise SurefootError("invalid", f"got {seed}, allowed is a seed >= 0", "seed")
        self._run = (seed % (1 << 62)) + 1
        self._episodes = np.arange(self.count, dtype=np.int64)

    @property
    def seconds(self) -> Array:
        """Time of each episode so far, s, (count,)."""
        return self._status[:, TIME]

    def begin(self, which: Flags) -> None:
        """Begin a new episode where `which` (count,) says so."""
        self._call(which, self._chosen, only=True)

    def act(self, chosen: Ints) -> None:
        """Do one action in each episode."""
        self.step(chosen, self._none)

    def step(self, chosen: Ints, renew: Flags) -> None:
        """Do one action in each episode, or begin a new one where `renew` says so."""
        count = len(self.world.names)
        if chosen.shape != (self.count,) or chosen.min() < 0 or chosen.max() >= count:
            raise SurefootError(
                "invalid", f"got actions {chosen!r}, allowed are {self.count} of 0 to {count - 1}", "action"
            )
        self._call(renew, chosen, only=False)

    def _call(self, renew: Flags, chosen: Ints, *, only: bool) -> None:
        if self._pool is None:
            self._part(0, renew, chosen, only)
        else:
            list(self._pool.map(lambda i: self._part(i, renew, chosen, only), range(len(self._parts))))

    def _part(self, i: int, renew: Flags, chosen: Ints, only: bool) -> None:
        w, (start, end) = self.world, self._parts[i]
        constants = w.scene, w.actions, w.switching, self._run, start, end
        _step(*constants, renew, only, chosen, self._episodes, self.count, *self._state, *self._rooms[i], *self._out)
