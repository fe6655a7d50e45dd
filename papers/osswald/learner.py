"""Sarsa(lambda) of Osswald et al., section V-B, in plain Python, which shows paths and checks the kernel.

    delta = r + gamma Q(s', a') - Q(s, a),  Q(s', .) = 0 at the goal
    E[c, a] = max(E[c, a], w_c),  T += alpha delta E,  E *= gamma lambda

with w_c the weights of the 8 points of the grid around s. An episode that starts from the table of a training returns
the path and leaves the table that the kernel of the training gets, bit for bit.
"""

import numpy as np

from surefoot.arrays import Array, Record
from surefoot.lab.train import learning
from surefoot.lab.train.sarsa import Training
from surefoot.services.navigator.environment.draws import below, seed, stream, uniform
from surefoot.services.navigator.policy.arrays import REACHED
from surefoot.services.navigator.policy.choose import NUMBERS, SARSA, PolicyTables, choose, features, room_to_choose

from .episode import Episode, follow


class Learner:
    """Learner by Sarsa(lambda) during one episode of a training, as Osswald et al. state it.

    Args:
        training: training whose next episode is run; it is not changed.

    Attributes:
        table: action values, at first those of the training, (layers, nd, nphi, A) s.
    """

    def __init__(self, training: Training) -> None:
        self.training, self.table = training, training.table.copy()
        w, s, count = training.world, training.settings, len(training.world.names)
        part = training.done / max(1, training.schedule.episodes - 1)
        self._alpha = s[learning.ALPHA_FIRST] * (s[learning.ALPHA_LAST] / s[learning.ALPHA_FIRST]) ** part
        self._eps = s[learning.EPS_FIRST] * (s[learning.EPS_LAST] / s[learning.EPS_FIRST]) ** part
        self._decay = w.tables.scene[0].gamma * s[learning.LAMBDA]
        self._room = room_to_choose(w.states, count)
        self._policy = PolicyTables(SARSA, np.zeros(NUMBERS), self.table, training.grid, np.eye(3))
        self._cells, self._weights = np.zeros(8, dtype=np.int64), np.zeros(8)
        self._traces: dict[int, float] = {}
        self._value, self._started = 0.0, False
        self._explore = stream()
        seed(self._explore, training.seed + 1, training.done, learning.EXPLORE)

    def walk(self) -> Episode:
        """Run the next episode of the training while learning from it, and return its course."""
        return follow(self.training.world, self.decide, self.training.seed + 1, self.training.done)

    def decide(self, mean: Array, cov: Array, status: Record, reward: float) -> int:
        """Learn from the reward of the last action, and return the index of the next one.

        Args:
            mean: estimated x, y (m), heading (rad) and more, frame map, (n,).
            cov: covariance of the estimate, (n, n).
            status: counters and flags of the episode, a record STATUS, see `EpisodeState`.
            reward: minus the seconds of the last action, plus a bonus at the goal.
        """
        chosen, following = 0, 0.0
        if status.outcome != REACHED:
            chosen = self._choose(mean, cov, status)
            following = self._room.values[chosen]
        flat = self.table.reshape(-1)
        if self._started:
            step = self._alpha * (reward + self.training.world.tables.scene[0].gamma * following - self._value)
            for cell, trace in self._traces.items():
                flat[cell] += step * trace
            self._traces = {
                c: t * self._decay for c, t in self._traces.items() if t * self._decay > learning.LEAST_TRACE
            }
        self._started = True
        self._mark(mean, cov, chosen)
        return chosen

    def _choose(self, mean: Array, cov: Array, status: Record) -> int:
        w, mask = self.training.world, self._room.mask
        goal = float(w.tables.scene[0].goal_x), float(w.tables.scene[0].goal_y)
        chosen = choose(self._policy, w.tables, mean, cov, *goal, status, self._room)
        if uniform(self._explore) < self._eps and status.blocked == 0.0:
            chosen = below(self._explore, mask.size)
            while not mask[chosen]:
                chosen = below(self._explore, mask.size)
        return chosen

    def _mark(self, mean: Array, cov: Array, chosen: int) -> None:
        """Update the traces by the believed state and the chosen action, and store Q(s, a).

        `mean` (n,), `cov` (n, n): believed x, y (m), heading (rad) and more, frame map; `chosen`: index of a.
        """
        w, t = self.training.world, self.training
        d, phi, h = features(mean, cov, float(w.tables.scene[0].goal_x), float(w.tables.scene[0].goal_y))
        flip = learning.corners(self.table, t.grid, d, phi, h, self._cells, self._weights)
        own = int(w.tables.actions[chosen].mirror) if flip > 0.0 else chosen
        self._value, flat = 0.0, self.table.reshape(-1)
        for corner, weight in zip(self._cells, self._weights, strict=True):
            cell, old = int(corner) + own, self._traces.get(int(corner) + own)
            self._value += float(weight) * float(flat[cell])
            if weight > learning.LEAST_TRACE:
                added = (old or 0.0) + weight if t.settings[learning.ACCUMULATE] > 0.0 else max(old or 0.0, weight)
                self._traces[cell] = float(added)


def paths(training: Training, every: int) -> tuple[tuple[int, Episode], ...]:
    """Run a training to its end; return number and course of every `every`-th episode."""
    found: list[tuple[int, Episode]] = []
    while training.done < training.schedule.episodes:
        found.append((training.done, Learner(training).walk()))
        training.advance(every)
    return tuple(found)
