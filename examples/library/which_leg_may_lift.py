"""Which leg may be lifted now? The margin that stays without each."""

import surefoot

robot = surefoot.robots.load("ragno")
q = surefoot.robots.stance(robot)
feet = surefoot.stability.contacts(surefoot.robots.feet(robot, q), friction=0.5)
left = surefoot.stability.lifts(feet, surefoot.robots.com(robot, q))
for name, margin in zip(robot.leg_names, left, strict=True):
    print(f"without {name}: {1e3 * margin:.0f} mm")
