"""A biped in its world: simulator, estimator and walker joined by function calls, as the services are by the bus."""

import math

from surefoot.lab.runs.joined import sense
from surefoot.robot.reader import load_robot
from surefoot.services.estimator.stream import Estimator
from surefoot.services.simulator.ground.terrain import make_terrain
from surefoot.services.simulator.physics.perturb import perturbation
from surefoot.services.simulator.world import PhysicsWorld, WorldConfig
from surefoot.services.walker.biped.gait import BipedWalker
from surefoot.services.walker.interface import MotionCommand


class Unheard:
    """An estimator that gets no samples."""

    def __init__(self, estimator):
        self.estimate, self.pose = estimator.estimate, estimator.pose

    def imu(self, *sample):
        pass

    joints = imu


def standing(out):
    return out.state == "standing"


class Plant:
    """A robot that obeys commands."""

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
        """Step by one control tick; `blind`: the estimator gets no samples."""
        inputs, _ = sense(self.world, Unheard(self.estimator) if blind else self.estimator)
        self.out = self.walker.step(inputs)
        command, self.pending = self.pending, self.world.command if self.out.command is None else self.out.command
        self.world.step_tick(command)
        return self.out

    def run(self, ticks):
        """Tick so often."""
        for _ in range(ticks):
            self.tick()

    def until(self, done, limit=3000, **how):
        """Tick until `done(out)`; returns the ticks it took."""
        for n in range(limit):
            if done(self.tick(**how)):
                return n + 1
        raise AssertionError(f"not reached in {limit} ticks: {self.out}")

    def stand(self):
        """Wait for the calibrated stance."""
        self.until(standing, 600)
        return self

    def begin(self, *command, **options):
        """Wait for the calibrated stance and give a command, by the arguments of `MotionCommand`."""
        assert self.stand().walker.command(MotionCommand(*command, **options)).accepted
        return self

    def restart(self):
        """Put a new walker in place of the old one, which takes up what that kept; returns it."""
        kept = self.walker.kept()
        self.walker = BipedWalker(self.robot)
        self.walker.resume(kept)
        return kept

    @property
    def yaw(self):
        """Heading of the upright robot, rad."""
        w, _, _, z = self.world.truth().quat_wxyz
        return 2 * math.atan2(z, w)

    @property
    def fallen(self):
        return bool(self.world.truth().fallen)
