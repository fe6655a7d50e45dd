"""What forces must the feet bear? The smallest ones that hold a robot of 20 N."""

import numpy as np

import surefoot

feet = surefoot.stability.contacts([[0.1, 0.1, 0.0], [0.1, -0.1, 0.0], [-0.1, 0.0, 0.0]], friction=0.5)
forces = surefoot.stability.forces(feet, com=[0.02, 0.01], weight=20.0)
print("it falls" if forces is None else np.round(forces, 2))
