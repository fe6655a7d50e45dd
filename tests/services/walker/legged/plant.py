"""A robot without physics: servos are perfect, feet stop nothing, switches close when a foot is at the ground."""

from typing import Any

import numpy as np

from surefoot.geometry.heightmap import HeightMap
from surefoot.robot.description import Robot
from surefoot.robot.reader import load_robot
from surefoot.services.walker.interface import MotionCommand, WalkerInputs, WalkerOutputs
from surefoot.services.walker.legged.gait import LeggedWalker
from surefoot.services.walker.legged.params import WalkerParams

ROBOT = load_robot("ragno")
PARAMS = WalkerParams.for_robot(ROBOT)
KINEMATICS_TICKS = 3  # close to the 33 ms of the real sensors


class Plant:
    """Closes the loop around a walker by kinematics only; flat ground at z = 0 without a map."""

    def __init__(self, walker: LeggedWalker, heights: HeightMap | None = None, initialised: bool = True) -> None:
        self.walker = walker
        self.heights = heights
        self.initialised = initialised
        self.tick = 0
        self.joints = walker.robot.neutral.copy()
        self.contacts = np.ones(walker.robot.nlegs, dtype=np.bool_)
        self.estimate_age = 0.0
        self.tilt, self.turn = np.zeros(2), np.zeros(2)  # estimated roll and pitch, rad, and their rates, rad/s
        self.out: WalkerOutputs | None = None
        if heights is not None:
            walker.set_map(heights)

    def inputs(self) -> WalkerInputs:
        due = self.tick % KINEMATICS_TICKS == 0
        s, now = self.walker.state, 0.01 * self.tick
        return WalkerInputs(
            stamp=now,
            roll=float(self.tilt[0]),
            pitch=float(self.tilt[1]),
            rate=(float(self.turn[0]), float(self.turn[1]), 0.0),
            x=float(s.body[0]),
            y=float(s.body[1]),
            yaw=s.yaw,
            estimate_stamp=now - self.estimate_age,
            initialised=self.initialised,
            joints=self.joints.copy() if due else None,
            contacts=self.contacts.copy() if due else None,
        )

    def step(self) -> WalkerOutputs:
        s = self.walker.state
        self.out = self.walker.step(self.inputs())
        self.joints = s.q.copy()
        ground = np.zeros(len(s.feet))
        if self.heights is not None:
            ground = self.heights.height(s.feet[:, 0], s.feet[:, 1])
        self.contacts = s.feet[:, 2] - self.walker.robot.foot_radius <= ground + 1e-3
        self.tick += 1
        return self.out

    def run(self, seconds: float) -> list[WalkerOutputs]:
        return [self.step() for _ in range(round(100 * seconds))]

    def until(self, *states: str, limit: float = 60.0) -> list[WalkerOutputs]:
        """Step until the walker is in one of the states."""
        outs: list[WalkerOutputs] = []
        while not outs or outs[-1].state not in states:
            outs.append(self.step())
            assert len(outs) < 100 * limit, f"never in {states}, but in {outs[-1].state}: {outs[-1].reason}"
        return outs

    def obey(self, command: MotionCommand, limit: float = 60.0) -> list[WalkerOutputs]:
        """Stand up if need be, give the command, return the ticks until it is done or refused."""
        if self.out is None:
            self.run(1.0)
        reply = self.walker.command(command)
        assert reply.accepted, reply
        self.step()
        return self.until("standing", "refused", limit=limit)


def plant(robot: Robot = ROBOT, **kwargs: Any) -> Plant:
    """A robot on flat ground; its walker with these arguments."""
    return Plant(LeggedWalker(robot, **kwargs))


def begun(command: MotionCommand, robot: Robot = ROBOT) -> Plant:
    """A robot that has stood for a second and accepted a command."""
    found = plant(robot)
    found.run(1.0)
    assert found.walker.command(command).accepted
    return found


def obeyed(command: MotionCommand, **kwargs: Any) -> tuple[Plant, list[WalkerOutputs]]:
    """A robot that has obeyed a command, and the outputs of its ticks; its walker with these arguments."""
    found = plant(**kwargs)
    return found, found.obey(command)
