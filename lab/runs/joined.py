"""World, estimator and walker joined by function calls, in the order of a control tick: a walk without a bus."""

from typing import Any

import numpy as np

from surefoot.schemas.topics import TICK_S
from surefoot.services.estimator.feet.contact import touch_rows
from surefoot.services.estimator.stream import Estimator
from surefoot.services.simulator.world import PhysicsWorld
from surefoot.services.walker.interface import WalkerInputs


def sense(world: PhysicsWorld, estimator: Estimator) -> tuple[WalkerInputs, Any]:
    """Return what the walker gets in this tick, and the estimate it comes from; the truth stays in the world."""
    samples = world.samples
    imu, joints, contacts = samples.imu, samples.joints, samples.contacts
    if imu is not None:
        estimator.imu(imu.stamp_ns, imu.gyro, imu.acc)
    touch = None if contacts is None else np.array([any(foot) for foot in contacts.touch])
    if joints is not None and contacts is not None:
        estimator.joints(joints.stamp_ns, joints.position, touch_rows(contacts.touch))
    estimate, pose = estimator.estimate(), estimator.pose()
    inputs = WalkerInputs(
        stamp=TICK_S * world.tick, roll=estimate.roll, pitch=estimate.pitch,
        rate=tuple(estimate.angular_velocity.tolist()), x=float(pose.position[0]), y=float(pose.position[1]),
        yaw=pose.yaw, estimate_stamp=1e-9 * estimate.stamp_ns, initialised=estimate.initialised,
        joints=None if joints is None else joints.position, contacts=touch,
    )  # fmt: skip
    return inputs, estimate
