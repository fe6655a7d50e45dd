"""A driver and its members on one bus, which can be killed and started again; for tests of the runtime."""

from collections.abc import Callable
from typing import Any

from surefoot.bus.interface import Delivery
from surefoot.errors import Refusal
from surefoot.lockstep.config import ServiceConfig
from surefoot.lockstep.driver import DriverNode
from surefoot.lockstep.join import TickInputs
from surefoot.lockstep.leader import Leader
from surefoot.lockstep.local import LocalSystem
from surefoot.lockstep.node import Node
from surefoot.schemas.base import Message
from surefoot.schemas.hw import JointCommand, Tick
from surefoot.schemas.terrain import HeightMapMessage
from surefoot.schemas.topics import CMD_JOINTS, HW_IMU, HW_TICK, TERRAIN_MAP, TICK_NS, Topic
from tests.surefoot.toys import ToyDriver, ToyEstimator, ToyObserver, ToyWalker

EXPECT = ("estimator", "walker", "recorder")
LIMIT = 50.0  # the toy's range of a joint


class GuardedDriver(ToyDriver):
    """A driver with one joint, a range, and a map."""

    outputs = (HW_IMU, TERRAIN_MAP)

    def check(self, command: JointCommand) -> None:
        if command.position is not None and (len(command.position) != 1 or abs(command.position[0]) > LIMIT):
            raise Refusal("out_of_range", f"got {command.position}", "position")

    def latched(self) -> list[tuple[Topic[Any], Message]]:
        return [(TERRAIN_MAP, HeightMapMessage(rows=1, cols=1, cell=0.1, origin=(0.0, 0.0), version=4, data=b"\0" * 4))]


class MapReader(ToyEstimator):
    """An estimator that also needs the map."""

    inputs = (HW_IMU, TERRAIN_MAP)

    def __init__(self) -> None:
        super().__init__(ServiceConfig())
        self.versions: list[int] = []

    def on_tick(self, inputs: TickInputs) -> None:
        found = inputs.get(TERRAIN_MAP)
        assert found is not None
        self.versions.append(found.version)
        super().on_tick(inputs)


class Bench:
    """The toys on one bus, pumped in turn, in a run that is at this tick; members can be killed and started again."""

    def __init__(self, policy: str = "hold", mode: str = "lockstep", delay: int = 1, at: int = -1) -> None:
        self.driver = GuardedDriver()
        self.estimator = MapReader()
        self.walker, self.observer = ToyWalker(ServiceConfig()), ToyObserver()
        self.system = LocalSystem([self.driver, self.estimator, self.walker, self.observer])
        self.bus = self.system.bus
        self.ticks: list[Tick] = []
        self.bus.subscribe(HW_TICK, self._keep)
        self.node: DriverNode = self.driver.node
        self.node.begin(EXPECT, mode, 0.0, delay, policy, 0)
        if at >= 0:
            self.until_tick(at)

    def _keep(self, delivery: Delivery) -> None:
        message = delivery.message()
        assert isinstance(message, Tick)
        if message.tick >= 0:
            self.ticks.append(message)

    @property
    def leader(self) -> Leader:
        return self.node.leader

    def until(self, condition: Callable[[], bool]) -> None:
        def finished() -> bool:
            assert self.leader.tick < 500, "the run does not end"
            return condition()

        self.system.run_until(finished, max_idle_rounds=2000)

    def until_tick(self, tick: int) -> None:
        self.until(lambda: self.leader.tick >= tick)

    def finish(self, tick: int) -> list[float]:
        self.leader.end_tick = tick
        self.until(lambda: self.leader.state == "ended" and self.leader.all_done())
        return self.driver.history

    def kill(self, name: str) -> Node:
        node = next(node for node in self.system.nodes if node.name == name)
        self.system.nodes.remove(node)
        for sinks in self.bus._sinks.values():
            sinks[:] = [sink for sink in sinks if getattr(sink, "__self__", None) is not node.inbox]
        self.bus.depart(name)
        return node

    def revive(self, service: Any) -> Node:
        node = Node(service, self.bus)
        self.system.nodes.append(node)
        node.start()
        return node

    def command(self, tick: int, position: tuple[float, ...] | None, epoch: int = 1) -> None:
        message = JointCommand(position=position).stamped(tick * TICK_NS, tick, epoch, tick, "walker")
        self.node.handle(Delivery(CMD_JOINTS, message, None))


def reference(ticks: int, delay: int = 1) -> list[float]:
    return Bench(delay=delay).finish(ticks)
