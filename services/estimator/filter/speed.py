"""Limit of the speed: an estimate beyond it is an error, unless the feet show it too."""

import math

import numpy as np
from numpy.typing import NDArray

from surefoot.arrays import Array
from surefoot.kernels.jit import inner_kernel, kernel

from ..params import UNKNOWN_SPEED
from .hypotheses import collapse, likeliest
from .layout import M, X
from .state import BestState, forget_velocity

SHOWN = 8.0
"""Speed, m/s, up to which feet are believed: quadrupeds gallop at 4 to 6."""
FITTING_NIS = 9.0
"""Mean normalised innovation squared, 3 expected, up to which the feet fit the velocity."""


@kernel
def _speed(x: Array, memory: Array) -> float:
    """Return an upper bound of the published speed, m/s, from x (21 + 3 K,) and memory (124,) of `BestState`."""
    v, lag = 0.0, 0.0
    for i in range(3):
        v += x[X.vel + i] ** 2
        lag += memory[M.lag + i] ** 2
    return math.sqrt(v) + math.sqrt(lag)


@inner_kernel
def limit_speed(state: BestState, foot: NDArray[np.int64], most: float) -> None:
    """Forget velocity and hypotheses, in place, if the speed exceeds a limit.

    Args:
        state: state of the filter; changed.
        foot: index of the foot of each contact point, (K,).
        most: limit, m/s; where the feet fit the velocity it is `SHOWN`.
    """
    at = likeliest(state)
    memory = state.memory if at < 0 else state.mode_memory[at]
    fastest = _speed(state.x, memory) if at < 0 else 0.0
    for h in range(state.weight.size):
        if state.weight[h] > 0.0:
            fastest = max(fastest, _speed(state.mode_x[h], state.mode_memory[h]))
    if memory[M.unfit] == 0.0 and memory[M.nis] < FITTING_NIS:
        most = max(most, SHOWN)
    if fastest > most:
        collapse(state, foot)
        forget_velocity(state, UNKNOWN_SPEED)
