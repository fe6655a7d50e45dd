"""Simulated robot whose own controller makes it trot, without the walker: `surefoot up examples/trot/system.yaml`."""

import math

import numpy as np
from numpy.typing import NDArray

from surefoot.lockstep.launch import main
from surefoot.robot.kinematics import foot_positions, legs_ik
from surefoot.schemas.hw import JointCommand
from surefoot.schemas.topics import TICK_S
from surefoot.services.simulator.service import Simulator, SimulatorConfig


class TrotConfig(SimulatorConfig):
    speed: float = 0.58  # m/s, planned; feet slide and servos lag, so it is another one
    period_s: float = 0.4  # of two steps
    duty: float = 0.5  # share of it in which a foot stands
    lift_m: float = 0.05  # height of a swing
    leap_m: float = 0.0  # by which a standing leg pushes; 0.03 with a duty of 0.4 takes the robot off the ground
    rest_s: float = 1.0  # standing before it sets off
    together: bool = False  # all legs in one phase: it hops


class TrottingRobot(Simulator):
    Config = TrotConfig
    config: TrotConfig

    def on_start(self) -> None:
        super().on_start()
        self.robot = self.run.robot
        self.neutral = feet = foot_positions(self.robot.model, self.robot.neutral)
        diagonal = (feet[:, 0] > feet[:, 0].mean()) == (feet[:, 1] > 0.0)
        self.phase = np.where(diagonal | self.config.together, 0.0, 0.5)

    def feet(self, seconds: float) -> NDArray[np.float64]:
        """Return wanted foot centres (L, 3) m, base_link, `seconds` s after the trot began."""
        c, feet, begin = self.config, self.neutral.copy(), min(1.0, seconds)
        stride = c.speed * c.duty * c.period_s * begin
        for foot, phase in zip(feet, (seconds / c.period_s + self.phase) % 1.0, strict=True):
            if phase < c.duty:
                foot[0] += stride * (0.5 - phase / c.duty)
                foot[2] -= c.leap_m * begin * math.sin(math.pi * phase / c.duty)
            else:
                swing = (phase - c.duty) / (1.0 - c.duty)
                foot[0] += stride * (swing - math.sin(2.0 * math.pi * swing) / math.pi - 0.5)
                foot[2] += c.lift_m * begin * math.sin(math.pi * swing) ** 2
        return feet

    def actuate(self, tick: int, command: JointCommand | None) -> None:
        seconds, robot = tick * TICK_S - self.config.rest_s, self.robot
        joints = robot.neutral if seconds < 0.0 else legs_ik(robot.model, self.feet(seconds))[0]
        joints = np.clip(joints, robot.joint_lower, robot.joint_upper)
        super().actuate(tick, JointCommand(position=tuple(joints.tolist())))  # in place of `command`


if __name__ == "__main__":
    main(TrottingRobot)
