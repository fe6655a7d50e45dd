"""Services with the topics of the real ones and no work of their own, run in blocks of ticks.

Run by `benchmarks.core` as a script, also with the modules of another checkout, so it imports nothing of benchmarks.
"""

import sys
import time
from collections.abc import Callable, Iterable
from typing import Any

from surefoot.bus.codec import encode, encoding_of
from surefoot.bus.frame import Frame, FramePart, pack
from surefoot.bus.interface import Delivery, Stamp
from surefoot.bus.memory import MemoryBus
from surefoot.lockstep import local
from surefoot.lockstep.config import ServiceConfig
from surefoot.lockstep.driver import Driver, DriverNode, DueSample
from surefoot.lockstep.join import Delayed, TickInputs
from surefoot.lockstep.launch import spare_collector
from surefoot.lockstep.service import Service
from surefoot.schemas.base import Message
from surefoot.schemas.hw import FootContacts, Imu, JointCommand, JointState
from surefoot.schemas.stability import StabilityStatus
from surefoot.schemas.state import GaitState, Odometry, VelocityEstimate
from surefoot.schemas.topics import (
    CMD_JOINTS,
    HW_CONTACTS,
    HW_IMU,
    HW_JOINTS,
    SIM_JOIN,
    STATE_GAIT,
    STATE_ODOMETRY,
    STATE_STABILITY,
    STATE_VELOCITY,
    TICK_NS,
    Topic,
)

EXPECT = ("estimator", "walker", "stability", "recorder")
TICKS = 100
"""Number of control ticks of one timed block."""
KINEMATICS_TICKS = 3
FEET, JOINTS = 6, 18
ZERO, POSE = (0.0, 0.0, 0.0), tuple(0.1 * i + 1 / 3 for i in range(JOINTS))

MADE: dict[Topic[Any], Message] = {
    HW_IMU: Imu(acc=(0.1, 0.2, 9.81), gyro=ZERO),
    HW_JOINTS: JointState(position=POSE, velocity=POSE, current=POSE),
    HW_CONTACTS: FootContacts(touch=((True,),) * FEET, normal_force_n=(1 / 3,) * FEET),
    STATE_VELOCITY: VelocityEstimate(
        mode="ekf", velocity=ZERO, velocity_imu=ZERO, velocity_heading=ZERO, angular_velocity=ZERO,
        g_up=(0.0, 0.0, 9.81), roll=0.0, pitch=0.0, gyro_bias=ZERO, covariance=(0.01,) * 36, initialised=True,
        standing=False, inputs_ok=True, filter_ok=True, sensors_ok=True, slipping=(False,) * FEET,
    ),
    STATE_ODOMETRY: Odometry(
        position=ZERO, quat_wxyz=(1.0, 0.0, 0.0, 0.0), yaw=0.0, velocity=ZERO, covariance=(0.01,) * 16, initialised=True
    ),
    STATE_GAIT: GaitState(
        walk_id=1, state="walking", phase=0.5, stance=(True,) * FEET, footholds=(ZERO,) * FEET, remaining=1.0
    ),
    STATE_STABILITY: StabilityStatus(
        status="ok", stance=(True,) * FEET, region=((0.1, 0.1),) * 16, com_planned=(0.0, 0.0), com_measured=(0.0, 0.0),
        margin_planned=0.05, margin_measured=0.05, mu=0.5,
    ),
    CMD_JOINTS: JointCommand(position=POSE),
}  # fmt: skip


class BareDriver(Driver[ServiceConfig]):
    """Driver that releases samples at the rates of the robot's sensors."""

    name = "simulator"
    outputs = (HW_IMU, HW_JOINTS, HW_CONTACTS)
    serves = (SIM_JOIN,)

    def release(self, tick: int) -> list[DueSample]:
        rows = self.outputs if tick % KINEMATICS_TICKS == 0 else (HW_IMU,)
        return [DueSample(row, MADE[row].model_copy(), tick * TICK_NS, tick) for row in rows]

    def actuate(self, tick: int, command: JointCommand | None) -> None:
        return


class Bare(Service[ServiceConfig]):
    """Service that publishes messages made beforehand on each topic that is due."""

    def on_tick(self, inputs: TickInputs) -> None:
        for topic in self.outputs:
            if topic.due(inputs.number):
                self.publish(topic, MADE[topic].model_copy())


class BareEstimator(Bare):
    """Bare service with the topics of the estimator."""

    name = "estimator"
    inputs = (HW_IMU, HW_JOINTS, HW_CONTACTS)
    outputs = (STATE_VELOCITY, STATE_ODOMETRY)


class BareWalker(Bare):
    """Bare service with the topics of the walker."""

    name = "walker"
    inputs = (STATE_VELOCITY, STATE_ODOMETRY, HW_JOINTS, HW_CONTACTS, Delayed(STATE_STABILITY))
    outputs = (CMD_JOINTS, STATE_GAIT)


class BareStability(Bare):
    """Bare service with the topics of the stability service."""

    name = "stability"
    inputs = (HW_JOINTS, HW_CONTACTS, STATE_VELOCITY, Delayed(STATE_GAIT))
    outputs = (STATE_STABILITY,)


class BareRecorder(Bare):
    """Recorder that reads its topics and does nothing with them."""

    name = "recorder"
    inputs = tuple(MADE)
    raw = batched = True

    def on_tick(self, inputs: TickInputs) -> None:
        for delivery in inputs.messages.values():
            delivery.header()
            delivery.raw()


class Framed:
    """Publisher whose messages go into its owner's frame."""

    watched = False

    def __init__(self, bus: "FrameBus", topic: Topic[Any]) -> None:
        self.topic, self._bus = topic, bus

    def put(self, message: Message) -> FramePart:
        stamp = Stamp(message.tick, message.epoch, message.stamp_ns, message.seq)
        part = FramePart(self.topic.key, encode(message)[0], stamp)
        self._bus.parts.append(part)
        return part

    def resend(self, token: FramePart) -> None:
        self._bus.parts.append(token)

    def prime(self) -> None:
        self._bus.parts.append(FramePart(self.topic.key, b"", Stamp(-1, 0, 0, 0)))


class FrameBus(MemoryBus):
    """In-memory bus with frames for topics that are framed; one for each node, all with common readers."""

    def __init__(self, shared: MemoryBus, readers: list[tuple[str, dict[str, Topic[Any]], Any, bool]]) -> None:
        self.__dict__.update(vars(shared))
        self._readers = readers
        self._frame_owner, self._instance = "", ""
        self._batch: list[FramePart] = []
        self.parts: list[FramePart] = []

    def publisher(self, topic: Topic[Any], instance: str = "") -> Any:
        if not topic.framed:
            return super().publisher(topic, *filter(None, (instance,)))  # earlier checkouts know no instance
        self._frame_owner, self._instance = topic.owner, instance
        return Framed(self, topic)

    def subscribe(self, topic: Topic[Any], sink: Callable[[Delivery], Any], *, bounded: bool = False) -> None:
        super().subscribe(topic, lambda item: sink(Delivery(topic, None, item.raw()._replace(encoding=""))))

    def take(self, topics: Iterable[Topic[Any]], sink: Callable[[Any], Any], *, batched: bool = False) -> None:
        owners: dict[str, dict[str, Topic[Any]]] = {}
        for topic in topics:
            if topic.framed:
                owners.setdefault(topic.owner, {})[topic.key] = topic
            else:
                self.subscribe(topic, sink)
        self._readers += [(owner, wanted, sink, batched) for owner, wanted in owners.items()]

    def flush(self, *, batch: bool = True) -> None:
        self._send(self.parts, batched=False)
        self._batch += self.parts
        self.parts = []
        if batch:
            self._send(self._batch, batched=True)
            self._batch = []

    def _send(self, parts: list[FramePart], *, batched: bool) -> None:
        if not parts:
            return
        payload, index = pack(parts, self._instance) if self._instance else pack(parts)
        for owner, wanted, sink, takes_batches in self._readers:
            if owner == self._frame_owner and takes_batches == batched:
                sink(Frame(owner, wanted, payload, index))


def system_of(way: str) -> local.LocalSystem:
    """Return the bare services on one bus; `way`: kind of bus, `memory` or `frames`."""
    driver = BareDriver(ServiceConfig())
    services = [driver, *(kind(ServiceConfig()) for kind in (BareEstimator, BareWalker, BareStability, BareRecorder))]
    for topic in MADE:
        encoding_of(topic.model)
    if way == "memory":
        return local.LocalSystem(services)
    system, bus = local.LocalSystem([]), MemoryBus()
    readers: list[tuple[str, dict[str, Topic[Any]], Any, bool]] = []
    system.nodes = [local.node_of(service, FrameBus(bus, readers)) for service in services]
    for node in system.nodes:
        node.start()
        for query in node.service.serves:
            bus.pump_with(query, node.pump_once)
    return system


def run_blocks(way: str) -> None:
    """Run a block of ticks for each line of standard input; print its processor time, s.

    way: memory, or frames.
    """
    system = system_of(way)
    driver = system.nodes[0]
    assert isinstance(driver, DriverNode)
    driver.begin(EXPECT, "lockstep", 0.0, 1, "hold", 0)
    leader, end = driver.leader, 0
    spare_collector()  # as every service does
    for _ in sys.stdin:
        end += TICKS
        began = time.process_time()
        system.run_until(lambda end=end: leader.tick >= end)
        print(time.process_time() - began, flush=True)
    if leader.state != "running" or any(sum(node.refused.values()) for node in system.nodes):
        raise RuntimeError(f"the run is {leader.state}; refused: {[dict(node.refused) for node in system.nodes]}")


if __name__ == "__main__":
    run_blocks(sys.argv[1])
