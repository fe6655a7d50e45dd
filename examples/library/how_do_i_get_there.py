"""How do I get there? A route around a wall, at a distance from it."""

import numpy as np

import surefoot

cells = np.zeros((60, 80))
cells[20:60, 38:42] = 100  # a wall, 2 m long
floor = surefoot.navigation.grid(cells, cell=0.05)
route = surefoot.navigation.plan(floor, start=(1.0, 2.0), goal=(3.0, 2.0), radius=0.2)
print(f"{route.length:.2f} m, never closer than {route.clearance:.2f} m to the wall")
print(np.round(route.waypoints, 2))
