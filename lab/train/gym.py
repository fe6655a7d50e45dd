"""Navigation environment with the interface of Gymnasium: one episode at a time, or many in parallel.

Needs the extra `surefoot[gym]`. Observation (6,): distance of the goal by the estimate (m), sine and cosine of its
bearing, entropy of the pose (nats), estimated drift (rad/m), 1 while blocked. Action: index into the model's actions.
Reward: minus the duration of the action, s, or the bonus at the goal. `terminated` = goal reached, `truncated` = time
limit reached; `info` has the seconds so far and `action_mask`. An action that is not allowed is replaced: by a turn
while blocked, else by the first walk.
"""

from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium.vector import AutoresetMode
from numpy.typing import NDArray

from surefoot.arrays import Array
from surefoot.services.navigator.policy.params import NavigationModel, load

from .batch import OBSERVATION, EpisodeBatch

LOW = np.array([0.0, -1.0, -1.0, -50.0, -50.0, 0.0])
HIGH = np.array([100.0, 1.0, 1.0, 50.0, 50.0, 1.0])


class NavigatorEnv(gym.Env[Array, np.int64]):
    """Gymnasium environment with one navigating robot; an action is an index into the model's actions.

    An observation (6,) is distance of the goal m, sine and cosine of its bearing, entropy of the pose nats, drift
    rad/m, 1 = blocked. The reward is minus the seconds of the action, or the bonus at the goal.

    Args:
        model: navigation model, or its name or file.
        render_mode: without effect, as nothing is drawn.
    """

    metadata = {"render_modes": []}  # noqa: RUF012 - as gymnasium declares it

    def __init__(self, model: NavigationModel | str = "paper", render_mode: str | None = None) -> None:
        self.model = load(model) if isinstance(model, str) else model
        self._batch = EpisodeBatch(self.model, 1)
        self.render_mode = render_mode
        self.action_space = gym.spaces.Discrete(len(self._batch.world.names))
        self.observation_space = gym.spaces.Box(LOW, HIGH, (OBSERVATION,), np.float64)

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Array, dict[str, Any]]:
        """Begin the first episode of a seed, or, for None, the next episode of the present seed.

        Returns:
            Observation (6,): distance of the goal m, sine and cosine of its bearing, entropy nats, drift rad/m, 1 =
            blocked;
            info: `seconds` so far and `action_mask`.
        """
        super().reset(seed=seed)
        if seed is not None:
            self._batch.reseed(seed)
        self._batch.begin(np.ones(1, dtype=np.bool_))
        return self._batch.observation[0].copy(), self._info()

    def step(self, action: np.int64) -> tuple[Array, float, bool, bool, dict[str, Any]]:
        """Execute one action, given by its index.

        Returns:
            Observation (6,): distance of the goal m, sine and cosine of its bearing, entropy nats, drift rad/m, 1 =
            blocked; reward, s; True if the goal was reached; True if the time limit was; info: `seconds` so far and
            `action_mask`.
        """
        self._batch.act(np.array([action], dtype=np.int64))
        b = self._batch
        return b.observation[0].copy(), float(b.reward[0]), bool(b.terminated[0]), bool(b.truncated[0]), self._info()

    def _info(self) -> dict[str, Any]:
        return {"seconds": float(self._batch.seconds[0]), "action_mask": self._batch.mask[0].astype(np.int8)}


class NavigatorVectorEnv(gym.vector.VectorEnv[Array, NDArray[np.int64], NDArray[Any]]):
    """Gymnasium vector environment with many navigating robots; an ended episode restarts at the next step.

    Args:
        num_envs: number of robots, each in its own episode.
        model: navigation model, or its name or file.
    """

    metadata = {"autoreset_mode": AutoresetMode.NEXT_STEP, "render_modes": []}  # noqa: RUF012 - as gymnasium declares it

    def __init__(self, num_envs: int, model: NavigationModel | str = "paper") -> None:
        self.model = load(model) if isinstance(model, str) else model
        self._batch = EpisodeBatch(self.model, num_envs)
        self.num_envs, self.render_mode = num_envs, None
        self.single_action_space = gym.spaces.Discrete(len(self._batch.world.names))
        self.single_observation_space = gym.spaces.Box(LOW, HIGH, (OBSERVATION,), np.float64)
        self.action_space = gym.vector.utils.batch_space(self.single_action_space, num_envs)
        self.observation_space = gym.vector.utils.batch_space(self.single_observation_space, num_envs)
        self._ended = np.zeros(num_envs, dtype=np.bool_)

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Array, dict[str, Any]]:
        """Begin a new episode of each of the n robots, of a new seed if one is given.

        Returns:
            Observations (n, 6): distance of the goal m, sine and cosine of its bearing, entropy nats, drift rad/m, 1 =
            blocked; infos: `seconds` so far, (n,), and `action_mask`, (n, A).
        """
        if seed is not None:
            self._batch.reseed(seed)
        self._ended[:] = False
        self._batch.begin(np.ones(self.num_envs, dtype=np.bool_))
        return self._batch.observation.copy(), self._info()

    def step(
        self, actions: NDArray[np.int64]
    ) -> tuple[Array, Array, NDArray[np.bool_], NDArray[np.bool_], dict[str, Any]]:
        """Execute one action in each of the n episodes, or begin a new one if it has ended; `actions`: indices (n,).

        Returns:
            Observations (n, 6), as `reset` returns them; rewards (n,), s; True where the goal was reached (n,), and
            where the time limit was (n,); infos.
        """
        b = self._batch
        b.step(np.asarray(actions, dtype=np.int64), self._ended)
        np.logical_or(b.terminated, b.truncated, out=self._ended)
        return b.observation.copy(), b.reward.copy(), b.terminated.copy(), b.truncated.copy(), self._info()

    def _info(self) -> dict[str, Any]:
        return {"seconds": self._batch.seconds.copy(), "action_mask": self._batch.mask.astype(np.int8)}
