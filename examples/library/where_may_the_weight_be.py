"""Where may the centre of mass be? The support region on a slope that two feet lean against."""

import numpy as np

import surefoot

points = [[0.1, 0.1, 0.0], [0.1, -0.1, 0.0], [-0.1, 0.1, 0.05], [-0.1, -0.1, 0.05]]
normals = [[-0.3, 0.0, 1.0], [-0.3, 0.0, 1.0], [0.3, 0.0, 1.0], [0.3, 0.0, 1.0]]
region = surefoot.stability.region(surefoot.stability.contacts(points, normals, friction=0.4))
print(f"{region.status}: {1e4 * region.area:.0f} cm2, known to {1e3 * region.gap:.2f} mm")
print(np.round(region.inner, 3))
