"""Does it slide? A robot stands on a slope of 15 degrees, which is dry, then wet, then slippery."""

import numpy as np

import surefoot

world = surefoot.simulation.world("ragno", terrain="slope")
for friction in (0.7, 0.3, 0.2):
    world.set("friction", friction)
    start = np.array(world.truth().position)
    for _ in range(50):
        world.step_tick(world.command)
    print(f"friction {friction}: {1e3 * np.linalg.norm(world.truth().position - start):.2f} mm in 0.5 s")
