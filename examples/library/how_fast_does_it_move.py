"""How fast does it move? Samples in, one by one, velocity and tilt out; here of a simulated robot that is pushed."""

import surefoot

world = surefoot.simulation.world("ragno", terrain="slope")
estimator = surefoot.estimation.estimator("ragno")
for _ in range(120):
    world.step_tick(world.command)
    imu, joints, contacts = world.samples.imu, world.samples.joints, world.samples.contacts
    if imu is not None:
        estimator.imu(imu.stamp_ns, imu.gyro, imu.acc)
    if joints is not None and contacts is not None:
        estimator.joints(joints.stamp_ns, joints.position, [any(foot) for foot in contacts.touch])
now = estimator.estimate()
print(f"v = {now.velocity.round(4)} m/s, pitch {now.pitch:+.3f} rad, standing {now.standing}")
