"""Does it slide? A robot on a slope of 15 degrees, on dry and on wet ground."""

import numpy as np

import surefoot

for friction in (0.7, 0.3, 0.2):
    try:
        world = surefoot.simulation.world("ragno", terrain="slope", friction=friction)
    except surefoot.SurefootError as error:
        print(f"friction {friction}: {str(error)[:50]}")
        continue
    start = np.array(world.truth().position)
    for _ in range(50):
        world.step_tick(world.command)
    print(f"friction {friction}: {1e3 * np.linalg.norm(world.truth().position - start):.2f} mm in 0.5 s")
