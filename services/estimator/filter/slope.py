"""Gentle slopes that are taken for level: errors of height and tilt that feet on one level cannot show.

A floor and a slope of some milliradians look alike: the accelerometer's bias hides the tilt of the trunk, and feet that
stand at the same time differ by less than their steps. The filter takes either for level. With a slope s of the ground,
(2,), rise per metre along x and y of odom, each of standard deviation `hidden_slope`, and the level part D of the way
over ground that was taken to be level, height z and attitude err by

    dz = -s D,   xi = (-s_y, s_x, 0)

which the published covariance of pose and gravity contains beside that of the filter. On a way that closes, D is 0.
"""

from surefoot.arrays import Array
from surefoot.geometry.constants import GRAVITY
from surefoot.kernels.jit import kernel

from .layout import LEVEL, LEVELS, E, M, X
from .noise import FIXED
from .state import BestState


@kernel
def learn_level_way(memory: Array, x: Array, levelled: bool) -> None:
    """Add the way since the last landing of a foot to the way D over ground that was taken to be level, in place.

    With each landing on no level, D shrinks, as the corrections by earlier levels lose their effect.

    Args:
        memory: `BestState.memory`, (124,); changed.
        x: state of the filter, `BestState.x`.
        levelled: True if the foot that lands has been put on a level of the ground.
    """
    memory[M.levelled] = 1.0 if levelled else (1.0 - FIXED.learn_ground) * memory[M.levelled]
    for i in range(2):
        memory[M.level_way + i] += memory[M.levelled] * (x[X.pos + i] - memory[M.landed_pos + i])
        memory[M.landed_pos + i] = x[X.pos + i]


@kernel
def add_to_pose(memory: Array, cov: Array) -> None:
    """Add the errors of height and tilt by a hidden slope to the covariance of the pose, in place.

    Args:
        memory: `BestState.memory`, (124,).
        cov: covariance of x, y, z, m, and rotation about x, y, z of odom, rad, (6, 6); changed.
    """
    square, x, y = FIXED.hidden_slope**2, memory[M.level_way], memory[M.level_way + 1]
    cov[2, 2] += square * (x * x + y * y)
    square *= memory[M.levelled]
    for i, by in ((3, square * y), (4, -square * x)):
        cov[i, i] += square
        cov[2, i] += by
        cov[i, 2] += by


@kernel
def add_to_gravity(memory: Array, up: Array, cov: Array) -> None:
    """Add the error of the tilt by a hidden slope to the covariance of gravity, in place.

    Args:
        memory: `BestState.memory`, (124,).
        up: unit vector that points up, IMU axes, (3,).
        cov: covariance whose first three rows are those of gravity, IMU axes, m/s^2, (3, 3) or larger; changed.
    """
    square = memory[M.levelled] * (GRAVITY * FIXED.hidden_slope) ** 2
    for i in range(3):
        cov[i, i] += square
        for k in range(3):
            cov[i, k] -= square * up[i] * up[k]


@kernel
def give_to_filter(state: BestState) -> None:
    """Move the variance of the height by a hidden slope into the filter and the levels of the ground, in place.

    A source that measures the height can correct it then, and levels do not take the correction back.
    """
    memory, square = state.memory, 0.0
    for i in range(2):
        square += (FIXED.hidden_slope * memory[M.level_way + i]) ** 2
        memory[M.level_way + i] = 0.0
    state.cov[E.pos + 2, E.pos + 2] += square
    for h in range(state.weight.size):
        if state.weight[h] > 0.0:
            state.mode_cov[h, E.pos + 2, E.pos + 2] += square
    for j in range(LEVELS):
        if memory[M.levels + LEVEL * j + 1] > 0.0:
            memory[M.levels + LEVEL * j + 1] += square
