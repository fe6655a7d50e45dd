"""Training of a Sarsa(lambda) navigation policy in batches of episodes, with a checkpoint after each."""

import hashlib
import io
import json
from collections.abc import Callable
from dataclasses import asdict, dataclass, field
from pathlib import Path

import numpy as np

from surefoot.disk import whole
from surefoot.errors import SurefootError
from surefoot.services.navigator.policy.arrays import Arrays, arrays
from surefoot.services.navigator.policy.choose import NUMBERS, SARSA, PolicyTables
from surefoot.services.navigator.policy.decider import Policy
from surefoot.services.navigator.policy.grids import D_MAX, GRID, LAYER_MAX, LAYER_MIN, MIRRORED
from surefoot.services.navigator.policy.library import provenance_of
from surefoot.services.navigator.policy.params import NavigationModel

from .learning import (
    ACCUMULATE,
    ALPHA_FIRST,
    ALPHA_LAST,
    AVERAGE_FROM,
    EPS_FIRST,
    EPS_LAST,
    LAMBDA,
    SETTINGS,
    Lessons,
    learn,
    learning_room,
)

PIECE = 100  # episodes between two notes of progress


@dataclass(frozen=True)
class Schedule:
    """Settings of a Sarsa(lambda) training; defaults were chosen by 20 trainings per candidate (seeds 100 to 119).

    The tables are functions of the entropy h of the pose, nats, of the distance d to the goal, m, and of its bearing
    phi, rad, with values at the points of a grid. The grid step of phi, 18 deg, matters most: with 15 deg the time to
    the goal is 1.2 s longer in the mean of 20 trainings and 5 s in the worst, with 13 deg 4 s and 13 s.

    Attributes:
        episodes: number of training episodes; 1500 in Osswald et al. (2010).
        alpha: step size at the first and the last episode.
        eps: probability of a random action at the first and the last episode.
        trace: lambda of Sarsa(lambda), 0 to 1: factor on a trace per action, in addition to the discount.
        accumulate: True: traces add up; False: the larger trace replaces the smaller.
        shape: number of grid points of h, d and phi.
        d_max: largest distance of the grid, m.
        h_range: smallest and largest entropy of the grid, nats.
        mirrored: True: mirrored states (left and right exchanged) share their values; False: they do not.
        average_from: share of the episodes from which on the tables are averaged; 1 = the last table is used.
    """

    episodes: int = 1500
    alpha: tuple[float, float] = (0.3, 0.02)
    eps: tuple[float, float] = (0.3, 0.01)
    trace: float = 0.85
    accumulate: bool = False
    shape: tuple[int, int, int] = (2, 10, 20)
    d_max: float = 6.0
    h_range: tuple[float, float] = (-8.0, -2.0)
    mirrored: bool = True
    average_from: float = 0.7

    def sha256(self) -> str:
        """SHA-256 of all settings of a training, hexadecimal."""
        return hashlib.sha256(json.dumps(asdict(self), sort_keys=True).encode()).hexdigest()


@dataclass
class Training:
    """Sarsa(lambda) training of a navigation policy in progress; a checkpoint file holds its state."""

    model: NavigationModel
    seed: int
    schedule: Schedule = field(default_factory=Schedule)
    done: int = 0

    def __post_init__(self) -> None:
        self.world: Arrays = arrays(self.model)
        count = len(self.world.names)
        self.table = np.zeros((*self.schedule.shape, count))
        self.mean_table = np.zeros_like(self.table)
        self.seconds = np.full(self.schedule.episodes, np.nan)
        s, self.settings = self.schedule, np.zeros(SETTINGS)
        self.settings[[ALPHA_FIRST, ALPHA_LAST, EPS_FIRST, EPS_LAST]] = *s.alpha, *s.eps
        self.settings[[LAMBDA, ACCUMULATE, AVERAGE_FROM]] = s.trace, s.accumulate, s.average_from
        self.grid = np.zeros(GRID)
        self.grid[[D_MAX, LAYER_MIN, LAYER_MAX, MIRRORED]] = s.d_max, *s.h_range, -1.0 if s.mirrored else 0.0
        self._lessons = Lessons(self.table, self.mean_table, self.grid, self.settings, self.seconds)
        self._room = learning_room(self.world, self.table.size)

    def advance(self, episodes: int) -> None:
        """Train the policy over the next `episodes` episodes, at most to the end of the schedule."""
        end = min(self.done + episodes, self.schedule.episodes)
        learn(self._lessons, self.world.tables, self.seed + 1, self.done, end, self._room)
        self.done = end

    def policy(self) -> Policy:
        """Return the policy learned so far, from the averaged table once there is one."""
        averaged = self.schedule.average_from < 1.0 and self.mean_table.any()
        steps = max(1, self.schedule.episodes - 1)
        count = sum(e / steps >= self.schedule.average_from for e in range(self.done))
        table = self.mean_table / max(1, count) if averaged else self.table.copy()
        about = provenance_of(
            self.model,
            "sarsa",
            seed=str(self.seed),
            episodes=str(self.done),
            schedule_sha256=self.schedule.sha256(),
            schedule=json.dumps(asdict(self.schedule), sort_keys=True),
        )
        tables = PolicyTables(SARSA, np.zeros(NUMBERS), table, self.grid, np.eye(3))
        return Policy("sarsa", self.world.names, tables, about)

    def identity(self) -> str:
        """Return the SHA-256 of model, schedule and seed, by which a checkpoint is matched to its training."""
        return hashlib.sha256(f"{self.model.sha256()} {self.schedule.sha256()} {self.seed}".encode()).hexdigest()

    def keep(self, path: Path) -> None:
        """Write the state of the training to a checkpoint file, completely or not at all."""
        buffer = io.BytesIO()
        np.savez_compressed(
            buffer,
            identity=np.str_(self.identity()),
            done=np.int64(self.done),
            table=self.table,
            mean_table=self.mean_table,
            seconds=self.seconds,
        )
        with whole(path) as part:
            part.write_bytes(buffer.getvalue())

    def take_up(self, path: Path) -> None:
        """Load the state of the training from a checkpoint (raises SurefootError: of another training, or damaged)."""
        try:
            with np.load(io.BytesIO(path.read_bytes()), allow_pickle=False) as file:
                held = {name: file[name] for name in ("identity", "done", "table", "mean_table", "seconds")}
        except Exception as error:
            raise SurefootError("invalid", f"{path}: is no checkpoint ({type(error).__name__})", "resume") from None
        if str(held["identity"]) != self.identity():
            raise SurefootError(
                "invalid", f"{path}: is of another model, schedule or seed, allowed is {self.identity()[:12]}", "resume"
            )
        self.done = int(held["done"])
        self.table[:], self.mean_table[:], self.seconds[:] = held["table"], held["mean_table"], held["seconds"]


def train(training: Training, checkpoint: Path | None, note: Callable[[Training], None]) -> Policy:
    """Run a Sarsa(lambda) training to its end and return the learned policy.

    Args:
        training: training to begin or to continue.
        checkpoint: file to which the training is saved every PIECE episodes; None = it is not saved.
        note: called with the training every PIECE episodes.
    """
    while training.done < training.schedule.episodes:
        training.advance(PIECE)
        if checkpoint is not None:
            training.keep(checkpoint)
        note(training)
    return training.policy()
