"""The policies of the live navigator: the same kernels that training and evaluation use."""

import math

import numpy as np
from numpy.typing import NDArray

from surefoot.errors import Refusal
from surefoot.schemas.navigation import PolicyReply
from surefoot.services.navigator.belief.tracker import Motion
from surefoot.services.navigator.config import NavigatorConfig
from surefoot.services.navigator.pilot import Act, Choice, Point
from surefoot.services.navigator.policy import choose as kernels
from surefoot.services.navigator.policy.arrays import (
    BLOCKED,
    KIND,
    LAST,
    NO_ACTION,
    PER_10CM,
    STAND,
    STANDS,
    STATUS,
    TURNING,
    TURNS,
    Arrays,
    arrays,
)
from surefoot.services.navigator.policy.params import Action, NavigationModel, load

Array = NDArray[np.float64]


class LivePolicy:
    """One policy at work."""

    def __init__(
        self,
        name: str,
        kind: int,
        numbers: Array,
        world: Arrays,
        table: Array | None = None,
        grid: Array | None = None,
        shown: Array | None = None,
    ) -> None:
        self.name, self.kind, self.numbers, self.world = name, kind, numbers, world
        self.table = np.zeros((1, 2, 2, len(world.names))) if table is None else table
        self.grid = np.array([0.0, 1.0, 0.0, 1.0, 0.0]) if grid is None else grid
        self.shown = np.eye(3) if shown is None else shown
        self.begin()

    def begin(self) -> None:
        """Forget the run of actions so far: a new goal."""
        self.status = np.zeros(STATUS)
        self.status[LAST] = NO_ACTION

    def decide(self, mean: Array, cov: Array, goal: Point, blocked: bool) -> Choice:
        """Return the next action for a belief (4,), (4, 4) as it will be when that action begins."""
        w, status = self.world, self.status
        status[BLOCKED] = float(blocked)
        count = len(w.names)
        values, mask = np.zeros(count), np.zeros(count, dtype=np.bool_)
        work = kernels.work_space_to_choose(mean.size, count)
        index = int(
            kernels.choose(
                self.kind,
                self.numbers,
                self.table,
                self.grid,
                self.shown,
                w.actions,
                w.scene,
                w.switching,
                mean,
                cov,
                goal[0],
                goal[1],
                status,
                values,
                mask,
                work,
            )
        )
        kind = int(w.actions[index, KIND])
        status[LAST] = index
        status[STANDS] = status[STANDS] + 1 if kind == STAND else 0
        status[TURNS] = status[TURNS] + 1 if kind == TURNING else 0
        values[~mask] = math.nan
        return Choice(index, tuple(values.tolist()), self._reason(index, values, blocked))

    def _reason(self, index: int, values: Array, blocked: bool) -> str:
        return "blocked ahead: turn" if blocked else f"{self.name}: {self.world.names[index]} is worth most"


def act_of(name: str, action: Action) -> Act:
    """Return an action of the model as what is ordered and what becomes of it."""
    return Act(
        name,
        action.kind,
        Motion(
            action.forward, 0.0, math.radians(action.turn_deg), action.forward,
            along=action.along_sd**2, across=action.across_sd**2,
            heading=math.radians(action.heading_sd_deg) ** 2,
            drifting=(math.radians(action.drift_walk_deg) * PER_10CM) ** 2,
        ),
        action.duration,
    )  # fmt: skip


class Policies:
    """The policies of one configuration.

    Args:
        config: of the service.
    """

    def __init__(self, config: NavigatorConfig) -> None:
        overrides = [f"use={config.actions!r}"] if config.actions else []
        self.model: NavigationModel = load(config.params, overrides)
        self.world = arrays(self.model)
        self.acts = tuple(act_of(name, action) for name, action in zip(self.model.names, self.model.used, strict=True))
        self.default = config.policy

    def find(self, name: str | None) -> LivePolicy:
        """Return a policy by name or file (raises Refusal)."""
        name = name or self.default
        numbers = np.zeros(kernels.NUMBERS)
        numbers[[kernels.STAND_ABOVE, kernels.TURN_BEYOND, kernels.STEER_GAIN]] = -3.5, math.radians(18.0), 1.0
        if name in ("hand", "steer"):
            return LivePolicy(name, kernels.STEER if name == "steer" else kernels.HAND, numbers, self.world)
        raise Refusal("unknown_policy", f"policy must be one of hand, steer, got {name!r}", "policy")

    def choose(self, name: str) -> None:
        """Make a policy the default (raises Refusal)."""
        self.find(name)
        self.default = name

    def message(self) -> PolicyReply:
        """Return the default policy and those that ship."""
        return PolicyReply(policy=self.default, known=("hand", "steer"), actions=self.model.names)
