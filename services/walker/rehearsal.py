"""Rehearsal of the walker: the robot stands up, walks and stops, with servos that reach every set-point."""

from typing import Any

import numpy as np

from surefoot.geometry.heightmap import HeightMap
from surefoot.schemas.topics import TICK_S

from .interface import MotionCommand, WalkerInputs

STAND_TICKS, WALK_TICKS = 120, 150
SIZE, CELL = 41, 0.02
"""`SIZE`: number of cells along a side of the flat rehearsal map; `CELL`: edge of a cell, m."""


def rehearse(walker: Any, mapped: bool) -> None:
    """Move a walker through stand, steps and stop, so that every kernel of its gait is loaded.

    Args:
        walker: a walker of legged robots or bipeds that nothing else uses.
        mapped: True if it uses a terrain map.
    """
    robot = walker.robot
    if mapped:
        origin = (-0.5 * SIZE * CELL, -0.5 * SIZE * CELL)
        walker.set_map(HeightMap(z=np.zeros((SIZE, SIZE), dtype=np.float32), cell=CELL, origin=origin))
    joints, stance = robot.neutral.copy(), np.ones(len(robot.legs), dtype=np.bool_)
    for tick in range(STAND_TICKS + WALK_TICKS):
        if tick == STAND_TICKS:
            walker.command(MotionCommand("walk", distance=0.5))
        now = TICK_S * tick
        out = walker.step(
            WalkerInputs(
                stamp=now, pitch=0.01, estimate_stamp=now, initialised=True, joints=joints, contacts=stance, margin=0.02
            )
        )
        joints, stance = joints if out.command is None else out.command.copy(), out.stance.copy()
