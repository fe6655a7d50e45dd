"""Feet that sink while they stand, as on grass, mats or soft legs: each step seems to land above the last.

A foot that stands is taken to stay, so that a trunk that sinks with it is believed to keep its height: the next foot
lands too high by as much. Over the landings of some seconds, z_i the height of the ground under a foot that lands at
t_i, and h_(i-1) that under the landing before as levels of the ground left it,

    s = S(z_i - h_(i-1))/(S(t_i - t_(i-1)) + T_0),   T_0 = `sink_least_s`

with decaying sums S, is the speed of sinking. It counts from `least_sink` on, and beyond what a slope that is taken for
level ground makes of the way. The height is unsure by s (t_i - t_(i-1)) more then, so that levels correct it, and the
velocity learns what they take off: see `follow`.
"""

import math

from surefoot.arrays import Array
from surefoot.kernels.jit import kernel

from .layout import M
from .noise import FIXED
from .state import BestState


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
    if math.isfinite(slope) and abs(rise) < FIXED.same_level:
        memory[M.sunk] += rise
    speed = memory[M.sunk] / (memory[M.sunk + 1] + FIXED.sink_least_s)
    climbs = FIXED.sink_slopes * min(slope + FIXED.sink_slope, FIXED.most_slope) * math.sqrt(v[0] * v[0] + v[1] * v[1])
    least = max(FIXED.least_sink * (1.0 if memory[M.sinks] == 0.0 else 0.5), climbs)
    _store(state, speed if abs(speed) > least else 0.0)
