"""How fast does it move? Samples in, one by one, velocity and tilt out; here of a simulated robot."""

import surefoot

world = surefoot.simulation.world("ragno", terrain="slope")
estimator = surefoot.estimation.estimator("ragno")
for _ in range(120):
    world.step_tick(world.command)
    if imu := world.samples.imu:
        estimator.imu(imu.stamp_ns, imu.gyro, imu.acc)
    if (joints := world.samples.joints) and (contacts := world.samples.contacts):
        estimator.joints(joints.stamp_ns, joints.position, [any(foot) for foot in contacts.touch])
now = estimator.estimate()
print(f"v = {now.velocity.round(4)} m/s, pitch {now.pitch:+.3f} rad, standing {now.standing}")
