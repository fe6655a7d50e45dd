"""Where are the feet, and which joint angles put them elsewhere?"""

import numpy as np

import surefoot

robot = surefoot.robots.load("ragno")
feet = surefoot.robots.feet(robot, surefoot.robots.stance(robot))
print(dict(zip(robot.leg_names, np.round(feet, 3).tolist(), strict=True)))
print(np.round(surefoot.robots.joints(robot, feet + np.array([0.01, 0.0, 0.005])), 3), "rad")
