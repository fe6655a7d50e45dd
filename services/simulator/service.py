"""Simulator service: replaces all hardware, drives simulated time, and answers the queries ``sim/*``."""

from typing import Any

from pydantic import Field

from surefoot.lockstep.config import ServiceConfig
from surefoot.lockstep.driver import Driver, DueSample
from surefoot.robot.reader import load_robot
from surefoot.schemas import sim, topics
from surefoot.schemas.base import Message
from surefoot.schemas.hw import EmergencyStop, JointCommand
from surefoot.schemas.topics import Topic

from . import world as worlds
from .messages import sample_messages, sight_messages, truth_message
from .queries import SimulatorQueries
from .run import SimulatedRun
from .world import PhysicsWorld

STATUS_TICKS = 100


class SimulatorConfig(ServiceConfig):
    """Settings of the simulator: world, services and real-time factor of the first run, before any ``sim/reset``."""

    expect: tuple[str, ...] = Field(default=(), description="services that must be ready before the first run begins")
    terrain: str = Field(default="flat", description="terrain of the first run")
    seed: int = Field(default=0, ge=0, lt=2**31, description="seed of the first run")
    autostart: bool = Field(default=True, description="begin a paced run at once instead of waiting for sim/reset")
    rtf: float = Field(default=1.0, ge=0, le=1000, description="real-time factor of that run, 0 = as fast as it goes")


class Simulator(Driver[SimulatorConfig]):
    """Driver that publishes the hardware topics from a simulated MuJoCo world, and applies joint commands to it."""

    name = "simulator"
    Config = SimulatorConfig
    outputs = (
        topics.HW_IMU, topics.HW_JOINTS, topics.HW_CONTACTS, topics.HW_LANDMARKS, topics.HW_IMAGE, topics.HW_DEPTH,
        topics.HW_RANGE, topics.SIM_TRUTH, topics.TERRAIN_MAP, topics.TERRAIN_LANDMARKS, topics.SIM_STATUS,
    )  # fmt: skip
    observes = (topics.CMD_ESTOP,)
    serves = (
        topics.SIM_JOIN, topics.HW_DESCRIPTION, topics.TERRAIN_MAP_GET, topics.SIM_RESET, topics.SIM_STEP,
        topics.SIM_PAUSE, topics.SIM_SPEED, topics.SIM_PUSH, topics.SIM_PLACE, topics.SIM_SET, topics.SIM_FAULT,
        topics.SIM_CHECKPOINT, topics.SIM_RESTORE, topics.SIM_STATUS_GET, topics.SIM_FEATURES, topics.SIM_EXPERIMENT,
        topics.TERRAIN_LANDMARKS_GET,
    )  # fmt: skip

    def on_start(self) -> None:
        c = self.config
        world = sim.World(terrain=c.terrain)
        first = sim.ResetRequest(seed=c.seed, world=world, expect=c.expect, mode="paced", rtf=c.rtf)
        self.run = SimulatedRun(self, load_robot(c.robot), first)
        self.queries = SimulatorQueries(self.run)
        for query, handler in self.queries.handlers():
            self.handle(query, handler)

    def on_begin(self) -> None:
        if self.config.autostart:
            self.run.begin()

    def on_stop(self) -> None:
        """Cancel the trials on ground primitives that have not begun."""
        self.queries.close()

    def rehearse(self) -> None:
        worlds.rehearse()

    @property
    def world(self) -> PhysicsWorld:
        """The world of the present run."""
        return self.run.world

    def release(self, tick: int) -> list[DueSample]:
        if tick > 0 and tick % STATUS_TICKS == 0:
            self.on_status()
        world = self.run.built.world
        return sample_messages(world.samples) + sight_messages(world.sight, world.stamp_ns)

    def reveal(self, tick: int) -> list[DueSample]:
        truth = self.run.built.world.truth()
        return [DueSample(topics.SIM_TRUTH, lambda: truth_message(truth), truth.stamp_ns, tick)]

    def actuate(self, tick: int, command: JointCommand | None) -> None:
        self.run.step(tick, command)

    def check(self, command: JointCommand) -> None:
        self.run.check(command)

    def latched(self) -> list[tuple[Topic[Any], Message]]:
        heights, landmarks = self.run.built.heights, self.run.built.landmarks
        known: list[tuple[Topic[Any], Message | None]] = [
            (topics.TERRAIN_MAP, heights),
            (topics.TERRAIN_LANDMARKS, landmarks),
        ]
        return [(topic, message) for topic, message in known if message is not None]

    def on_message(self, topic: Topic[Any], message: Message) -> None:
        """Hold the joints after an emergency stop until the next reset, and publish the status at once."""
        if isinstance(message, EmergencyStop):
            self.run.stop(message.reason)
            self.on_status()

    def on_status(self) -> None:
        self.publish(topics.SIM_STATUS, self.run.status())


SERVICE = Simulator
