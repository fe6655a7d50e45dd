"""Ground that gives way: feet that sink while they stand, on grass, mats or soft legs, land too high at each step.

A foot that stands is taken to stay, so that a trunk that sinks with it is believed to keep its height: the next foot
lands too high by as much. Over the landings of some seconds, with z_i the height of the ground under a foot that lands
at t_i, and h_(i-1) the last height under the foot that landed before,

    s = S(z_i - h_(i-1))/(S(t_i - t_(i-1)) + T_0),   T_0 = `sink_least_s`

with decaying sums S, is the speed of sinking. It counts from `least_sink` on, and beyond `sink_slopes` times the climb
of a slope of the ground, as far as feet that stand together show or hide one, `most_slope` at most. All standing points
then share a random walk of their height, s `sink_walk`. The height that is still wrong is corrected by known levels of
the ground (`level`), without a turn of the trunk, and the velocity by its lag (`follow` in `update`).
"""

import math

from surefoot.arrays import Array
from surefoot.kernels.jit import kernel

from .layout import LEVEL, LEVELS, M
from .noise import FIXED
from .state import BestState


@kernel
def forget_levels(memory: Array) -> None:
    """Forget levels, unevenness, slope and softness of the ground in `BestState.memory` (124,), in place."""
    memory[M.sunk : M.sinks + 1] = 0.0
    memory[M.levels : M.levels + LEVEL * LEVELS] = 0.0
    memory[M.uneven] = FIXED.step_sd**2
    memory[M.slope : M.slope + 5] = 0.0


@kernel
def _store(state: BestState, speed: float) -> None:
    """Store the speed at which feet sink, m/s, in the memory of the state and of its hypotheses, in place."""
    state.memory[M.sinks] = speed
    for h in range(state.weight.size):
        state.mode_memory[h, M.sinks] = speed


@kernel
def learn_sinking(state: BestState, v: Array, z: float, slope: float) -> None:
    """Learn the speed of sinking from a foot that lands, in place.

    Args:
        state: state of the filter; its memory is changed.
        v: velocity of the IMU, odom axes, (3,) m/s.
        z: height of the ground under the foot, m, odom.
        slope: slope of the ground, rad, by feet that stood at the same time; infinite: the ground has no levels.
    """
    memory = state.memory
    dt, rise = memory[M.age] - memory[M.landed_at], z - memory[M.landed]
    if not 0.0 <= dt < FIXED.sink_s or memory[M.landed_at] == 0.0:
        memory[M.sunk] = memory[M.sunk + 1] = 0.0
        _store(state, 0.0)
        return
    fade = math.exp(-dt / FIXED.sink_s)
    memory[M.sunk], memory[M.sunk + 1] = fade * memory[M.sunk], fade * memory[M.sunk + 1] + dt
    level, on = math.isfinite(slope), memory[M.sinks] != 0.0
    if level and abs(rise) < FIXED.same_level:
        memory[M.sunk] += rise
    speed = memory[M.sunk] / (memory[M.sunk + 1] + FIXED.sink_least_s)
    climbs = min(slope + FIXED.hidden_slope, FIXED.most_slope) * math.sqrt(v[0] * v[0] + v[1] * v[1])
    least = (0.5 if on else 1.0) * max(FIXED.least_sink, FIXED.sink_slopes * climbs if level else 0.0)
    even = abs(memory[M.sunk]) > FIXED.sink_scatter * math.sqrt(memory[M.uneven])
    known = on or (level and even and memory[M.sunk + 1] >= 2.0 * FIXED.sink_least_s)
    _store(state, speed if known and abs(speed) > least else 0.0)
