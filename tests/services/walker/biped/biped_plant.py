"""A biped in its world: simulator, estimator and walker joined by function calls, as the services are by the bus."""

import numpy as np

from surefoot.robot.reader import load_robot
from surefoot.services.estimator.feet.contact import touch_rows
from surefoot.services.estimator.stream import Estimator
from surefoot.services.simulator.ground.terrain import make_terrain
from surefoot.services.simulator.physics.perturb import perturbation
from surefoot.services.simulator.world import PhysicsWorld, WorldConfig
from surefoot.services.walker.biped.gait import BipedWalker
from surefoot.services.walker.interface import WalkerInputs


class Plant:
    """One robot that can be told to walk."""

    def __init__(self, name, seed=0, level=0.0, drift=0.0, **params):
        self.robot = load_robot(name)
        differs = perturbation(level, seed, self.robot.nj, self.robot.kind)
        config = WorldConfig(perturbation=differs, drift=drift)
        self.world = PhysicsWorld(self.robot, make_terrain("flat"), seed, config)
        self.estimator = Estimator.for_robot(self.robot)
        self.walker = BipedWalker(self.robot, **params)
        self.pending = self.world.command.copy()
        self.out = None

    def tick(self, blind=False):
        """One control tick; `blind`: the estimator says nothing new."""
        imu, joints, contacts = self.world.samples
        if imu is not None and not blind:
            self.estimator.imu(imu.stamp_ns, imu.gyro, imu.acc)
        touch = None if contacts is None else np.array([any(foot) for foot in contacts.touch])
        if joints is not None and not blind:
            self.estimator.joints(joints.stamp_ns, joints.position, touch_rows(contacts.touch))
        e, pose = self.estimator.estimate(), self.estimator.pose()
        self.out = self.walker.step(
            WalkerInputs(
                stamp=0.01 * self.world.tick,
                roll=e.roll,
                pitch=e.pitch,
                rate=tuple(e.angular_velocity),
                x=pose.position[0],
                y=pose.position[1],
                yaw=pose.yaw,
                estimate_stamp=1e-9 * e.stamp_ns,
                initialised=e.initialised,
                joints=None if joints is None else joints.position,
                contacts=touch,
            )
        )
        command, self.pending = self.pending, self.world.command if self.out.command is None else self.out.command
        self.world.step_tick(command)
        return self.out

    def until(self, done, limit=3000, **how):
        """Tick until `done(out)`; returns the ticks it took."""
        for n in range(limit):
            if done(self.tick(**how)):
                return n + 1
        raise AssertionError(f"not reached in {limit} ticks: {self.out}")

    def stand(self):
        """Wait for the calibrated stance."""
        self.until(lambda out: out.state == "standing", 600)
        return self

    @property
    def fallen(self):
        return bool(self.world.truth().fallen)
