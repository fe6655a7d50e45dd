"""Simulated world, estimator and walker connected by function calls in the order of a control tick, without a bus."""

import time
from typing import Any

import numpy as np
from numpy.typing import NDArray

from surefoot.schemas.topics import TICK_S
from surefoot.services.estimator.feet.contact import touch_rows
from surefoot.services.estimator.stream import Estimator
from surefoot.services.simulator.world import PhysicsWorld
from surefoot.services.walker.gait import Gait
from surefoot.services.walker.interface import WalkerInputs, WalkerOutputs


def feed(world: PhysicsWorld, estimator: Estimator) -> None:
    """Feed the simulated sensor samples of the present tick to an estimator, without the ground truth."""
    samples = world.samples
    imu, joints, contacts = samples.imu, samples.joints, samples.contacts
    if imu is not None:
        estimator.imu(imu.stamp_ns, imu.gyro, imu.acc)
    if joints is not None and contacts is not None:
        estimator.joints(joints.stamp_ns, joints.position, touch_rows(contacts.touch))


def sense(world: PhysicsWorld, estimator: Estimator) -> tuple[WalkerInputs, Any]:
    """Feed the sensor samples of the present tick to an estimator; return the walker's inputs, and the estimate."""
    feed(world, estimator)
    joints, contacts = world.samples.joints, world.samples.contacts
    estimate, pose = estimator.estimate(), estimator.pose()
    inputs = WalkerInputs(
        stamp=TICK_S * world.tick, roll=estimate.roll, pitch=estimate.pitch,
        rate=tuple(estimate.angular_velocity.tolist()), x=float(pose.position[0]), y=float(pose.position[1]),
        yaw=pose.yaw, estimate_stamp=1e-9 * estimate.stamp_ns, initialised=estimate.initialised,
        joints=None if joints is None else joints.position,
        contacts=None if contacts is None else np.array([any(foot) for foot in contacts.touch]),
    )  # fmt: skip
    return inputs, estimate


class JoinedLoop:
    """Control loop of simulated world, estimator and walker in one process, with the actuation delay of bus servos.

    A tick is `decide`, then any readings or commands of the caller, then `act`.

    Args:
        world: simulated robot and terrain.
        walker: gait that commands the joints.
        delay: actuation delay, control ticks.
    """

    def __init__(self, world: PhysicsWorld, walker: Gait, delay: int = 1) -> None:
        self.world, self.walker = world, walker
        self.estimator = Estimator.for_robot(world.robot)
        self.out: WalkerOutputs | None = None
        """Outputs of the walker in the present control tick; None before the first one."""
        self.costs_us: list[float] = []
        """Wall time of the walker in each control tick so far, us."""
        self._pending: list[NDArray[np.float64]] = [world.command.copy()] * delay

    def decide(self) -> WalkerOutputs:
        """Run the estimator and the walker on the sensor samples of this tick; return the outputs of the walker."""
        inputs, _ = sense(self.world, self.estimator)
        began = time.perf_counter()
        out = self.out = self.walker.step(inputs)
        self.costs_us.append(1e6 * (time.perf_counter() - began))
        return out

    def act(self) -> None:
        """Advance the world by a control tick with the joint command of `delay` ticks ago."""
        command = None if self.out is None else self.out.command
        self._pending.append(self.world.command if command is None else command)
        self.world.step_tick(self._pending.pop(0))
