"""Can a quadruped stand on three legs, and where must its trunk lean to? Lifts each leg in turn."""

import numpy as np

import surefoot

robot = surefoot.robots.load("lupo")
q = surefoot.robots.stance(robot)
points, com = surefoot.robots.feet(robot, q), surefoot.robots.com(robot, q)
for leg, name in enumerate(robot.leg_names):
    rest = surefoot.stability.contacts(np.delete(points, leg, axis=0), friction=0.6)
    middle = surefoot.stability.region(rest).inner.mean(axis=0)
    print(f"{name} up: margin {1e3 * surefoot.stability.margin(rest, com):+.0f} mm, lean by {middle - com[:2]} m")
