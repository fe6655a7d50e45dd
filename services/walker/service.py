"""The walker service: walk commands in, joint commands out.

With four or six legs it requests footholds and a stability check before each step; a biped walks without either.
"""

import dataclasses
from typing import Any

from pydantic import Field

from surefoot.geometry import rotations
from surefoot.geometry.heightmap import HeightMapError
from surefoot.lockstep.config import ServiceConfig
from surefoot.lockstep.join import Delayed, TickInputs
from surefoot.lockstep.service import Service
from surefoot.robot.reader import load_robot
from surefoot.schemas import topics
from surefoot.schemas.base import Message
from surefoot.schemas.cmd import WalkCommand, WalkReply
from surefoot.schemas.hw import EmergencyStop, JointCommand
from surefoot.schemas.state import Odometry, VelocityEstimate
from surefoot.schemas.topics import Topic

from .advisors import Advisors
from .biped.gait import BipedWalker
from .commander import Commander
from .gait import Gait
from .interface import WalkerOutputs
from .legged.gait import LeggedWalker
from .legged.params import WalkerParams
from .memory import MemoryFile
from .messages import gait_message, heights_of, newest_map, walker_inputs
from .rehearsal import rehearse


class WalkerConfig(ServiceConfig):
    """Settings of the walker service: requests, memory file, changes to the gait of robots with four or six legs."""

    hip_height_m: float | None = Field(default=None, gt=0, lt=1, description="m, base_link over the ground")
    stride_m: float | None = Field(default=None, gt=0, lt=1, description="m, way of the trunk in one gait cycle")
    period_s: float | None = Field(default=None, gt=0, lt=10, description="s, two steps of the tripod gait")
    clearance_m: float | None = Field(default=None, gt=0, lt=1, description="m, height of a swing over the ground")
    ask_footholds: bool = Field(default=True, description="ask footholds/select for each landing")
    ask_stability: bool = Field(default=True, description="ask stability/check before each step")
    memory: str | None = Field(
        default=None, description="file of this run that keeps the command for a walker that is started again"
    )


class Walker(Service[WalkerConfig]):
    """Service that walks the robot, and the only one that may command its joints."""

    name = "walker"
    Config = WalkerConfig
    inputs = (
        topics.STATE_VELOCITY, topics.STATE_ODOMETRY, topics.HW_JOINTS, topics.HW_CONTACTS, topics.TERRAIN_MAP,
        topics.STATE_ELEVATION, Delayed(topics.STATE_STABILITY), Delayed(topics.NAVIGATOR_ORDER),
    )  # fmt: skip
    outputs = (topics.CMD_JOINTS, topics.STATE_GAIT)
    serves = (topics.CMD_WALK,)
    calls = (topics.FOOTHOLDS_SELECT, topics.STABILITY_CHECK)
    observes = (topics.CMD_ESTOP,)

    def on_start(self) -> None:
        self.robot = load_robot(self.config.robot)
        chosen = {name: getattr(self.config, name) for name in ("hip_height_m", "stride_m", "period_s", "clearance_m")}
        changes = {name: value for name, value in chosen.items() if value is not None}
        self.params = None if self.robot.kind == "biped" else WalkerParams.for_robot(self.robot, **changes)
        self.memory = MemoryFile(self.config.memory)
        self.on_reset()
        self.handle(topics.CMD_WALK, self.walk)

    def rehearse(self) -> None:
        rotations.quat_from_rpy(0.0, 0.0, 0.1)
        mapped = self.params is not None
        rehearse(LeggedWalker(self.robot, self.params) if mapped else BipedWalker(self.robot), mapped=mapped)

    def on_reset(self) -> None:
        ask = {"footholds": self.config.ask_footholds, "stability": self.config.ask_stability}
        self.advisors = Advisors(self.robot, self.call, **ask)
        self.gait: Gait = (
            BipedWalker(self.robot)
            if self.params is None
            else LeggedWalker(self.robot, self.params, self.advisors.select, self.advisors.check)
        )
        self.commander = Commander(self.gait, self.memory, self.log)
        self._map: object = None
        self._out: WalkerOutputs | None = None
        self._estimate: tuple[VelocityEstimate, Odometry] | None = None

    def walk(self, request: WalkCommand) -> WalkReply:
        """Accept or refuse a command and return the reply; one with ``at_tick`` waits for that tick."""
        return self.commander.walk(request)

    def on_message(self, topic: Topic[Any], message: Message) -> None:
        """Store the reason of an emergency stop: walks are refused from then on, and the driver holds the joints."""
        if isinstance(message, EmergencyStop):
            self.commander.stopped = message.reason or "no reason given"

    def on_tick(self, inputs: TickInputs) -> None:
        self.advisors.begin(inputs.tick.epoch, inputs.number)
        self._take_map(inputs)
        self.commander.begin(inputs.tick.epoch, inputs.number)
        velocity, odometry, order = (
            inputs.get(topics.STATE_VELOCITY),
            inputs.get(topics.STATE_ODOMETRY),
            inputs.get(topics.NAVIGATOR_ORDER),
        )
        for stance in () if odometry is None else odometry.stances:
            self.advisors.outcomes.ended(self.robot.leg_names[stance.foot], stance.slip, stance.healthy)
        if order is not None:
            self.commander.obey(order)
        if velocity is not None and odometry is not None:  # one may be left out in paced time
            self._estimate = velocity, odometry
        out = self._held(inputs.tick.held) or self.gait.step(walker_inputs(inputs, self._estimate))
        self._out = out
        self.commander.keep()
        degraded = self.advisors.missing or self.commander.refused
        self.publish(topics.STATE_GAIT, gait_message(out, degraded, self.commander.order, order is not None))
        self.publish(
            topics.CMD_JOINTS, JointCommand(position=None if out.command is None else tuple(out.command.tolist()))
        )

    def _held(self, held: bool) -> WalkerOutputs | None:
        """Return the last set-points again while the driver holds the joints and the gait pauses; else None."""
        if not held or self._out is None:
            return None
        stopped = self.commander.stopped
        reason = f"emergency stop: {stopped}" if stopped else "the driver holds the joints: no command came"
        return dataclasses.replace(self._out, state="hold", reason=reason)

    def _take_map(self, inputs: TickInputs) -> None:
        message = newest_map(inputs, self._map)
        if message is None or message is self._map:
            return
        self._map = message
        try:
            self.gait.set_map(heights_of(message))
        except HeightMapError as error:
            self.gait.set_map(None)
            self.log("error", f"{type(message).__name__} refused: {error}")


SERVICE = Walker
