"""Ticks of a world in a row."""

import numpy as np

from surefoot.services.simulator.world import PhysicsWorld


def steps(world: PhysicsWorld, ticks: int, *command: np.ndarray) -> None:
    """Step a world by a number of ticks with one command (set-points, torque limits), or with the last one."""
    for _ in range(ticks):
        world.step_tick(*command)
