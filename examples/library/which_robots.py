"""Which robots are there, and how heavy are they?"""

import surefoot

for name in surefoot.robots.names():
    robot = surefoot.robots.load(name)
    print(f"{name}: a {robot.kind} with {robot.nj} joints and {robot.mass:.2f} kg")
