"""How much friction does this stand need? The least coefficient with a margin of 1 cm between two tilted plates."""

import numpy as np

import surefoot

points, normals = [[0.2, 0.1, 0.0], [0.2, -0.1, 0.0], [-0.2, 0.0, 0.0]], [[-0.5, 0, 1], [-0.5, 0, 1], [0.5, 0, 1]]
for mu in np.arange(0.05, 1.0, 0.05):
    feet = surefoot.stability.contacts(points, normals, friction=float(mu))
    if surefoot.stability.margin(feet, com=[0.05, 0.0]) > 0.01:
        print(f"a coefficient of {mu:.2f} is enough")
        break
