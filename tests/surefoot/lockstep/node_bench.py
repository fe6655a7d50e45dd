"""A node alone on a bus, with a driver made by hand; for tests of the runtime."""

from collections.abc import Callable
from typing import Any

from surefoot.bus.interface import Delivery, Life, Raw
from surefoot.bus.memory import MemoryBus
from surefoot.lockstep.config import ServiceConfig
from surefoot.lockstep.join import DRIVER, Delayed, TickInputs
from surefoot.lockstep.node import Node
from surefoot.lockstep.service import Service
from surefoot.schemas import topics
from surefoot.schemas.base import Message
from surefoot.schemas.footholds import SelectReply
from surefoot.schemas.hw import Imu, Tick
from surefoot.schemas.stability import RegionReply
from surefoot.schemas.topics import Topic
from tests.surefoot.toys import estimate

MEGABYTE = 1 << 20
IMU = Imu(acc=(0.5, 0.0, 9.81), gyro=(0.0, 0.0, 0.0))
LEG = {"leg": "lf", "nominal": (0.1, 0.1, 0.0), "stroke": (-0.05, 0.0, 0.0)}
SELECT = {"base": {"position": (0.0, 0.0, 0.1), "quat_wxyz": (1.0, 0.0, 0.0, 0.0)}, "legs": [LEG]}


class Subject(Service[ServiceConfig]):
    """An estimator that also answers queries."""

    name = "estimator"
    inputs = (topics.HW_IMU, Delayed(topics.STATE_GAIT))
    outputs = (topics.STATE_VELOCITY,)
    serves = (topics.STABILITY_REGION, topics.FOOTHOLDS_SELECT)
    calls = (topics.FOOTHOLDS_ASSESS,)

    def __init__(self) -> None:
        super().__init__(ServiceConfig())
        self.ticks: list[int] = []
        self.seen: list[dict[str, Any]] = []
        self.resets = 0
        self.stopped = False
        self.answer: Callable[[Any], Any] = lambda request: RegionReply(
            status="infeasible", inner=(), outer=(), support=()
        )

    def on_start(self) -> None:
        self.handle(topics.STABILITY_REGION, lambda request: self.answer(request))
        self.handle(
            topics.FOOTHOLDS_SELECT, lambda request: SelectReply(legs=(), map_version=len(self.ticks), model="m")
        )

    def on_reset(self) -> None:
        self.resets += 1

    def on_tick(self, inputs: TickInputs) -> None:
        self.ticks.append(inputs.number)
        self.seen.append(dict(inputs.messages))
        imu = inputs.get(topics.HW_IMU)
        self.publish(topics.STATE_VELOCITY, estimate(0.0 if imu is None else imu.acc[0]))

    def on_stop(self) -> None:
        self.stopped = True


class Bench:
    """A node alone on a bus, with a driver made by hand."""

    def __init__(self, service: Service[Any] | None = None) -> None:
        self.bus = MemoryBus()
        self.service = service or Subject()
        self.node = Node(self.service, self.bus)
        self.node.start()
        self.out: list[Message] = []
        for topic in (topics.STATE_VELOCITY, topics.TICK_DONE, topics.LOG):
            self.bus.subscribe(topic, self._keep)
        for query in (*self.service.serves, topics.HEALTH_GET.of(self.service.name)):
            self.bus.pump_with(query, self.node.pump)
        self.tick_publisher = self.bus.publisher(topics.HW_TICK)
        self.imu_publisher = self.bus.publisher(topics.HW_IMU)

    @property
    def subject(self) -> Subject:
        assert isinstance(self.service, Subject)
        return self.service

    def _keep(self, delivery: Delivery) -> None:
        if not delivery.prime:
            self.out.append(delivery.message())

    def sent(self, kind: type[Message]) -> list[Any]:
        return [message for message in self.out if isinstance(message, kind)]

    def tick(self, tick: int, *, epoch: int = 1, roster: tuple[str, ...] = ("estimator",), **fields: Any) -> None:
        given = {"due": ("hw/imu",), "mode": "lockstep", "roster_version": 1, **fields}
        self.tick_publisher.put(
            Tick(tick=tick, epoch=epoch, stamp_ns=tick * topics.TICK_NS, seq=max(tick, 0), roster=roster, **given)
        )
        self.node.pump()

    def imu(self, tick: int, *, epoch: int = 1, x: float = 0.5) -> None:
        message = Imu(acc=(x, 0.0, 9.81), gyro=(0.0, 0.0, 0.0))
        self.imu_publisher.put(message.stamped(tick * topics.TICK_NS, tick, epoch, tick, "driver"))
        self.node.pump()

    def prime_as(self, instance: str, *, epoch: int = 1) -> None:
        """A driver's process becomes visible and proves its links."""
        self.node.handle(Life(DRIVER, instance, True))
        self.signed_tick(instance, -1, epoch=epoch)

    def signed_tick(
        self, instance: str, tick: int, *, epoch: int = 1, version: int = 1, roster: tuple[str, ...] = ("estimator",),
        since: tuple[int, ...] = (),
    ) -> None:  # fmt: skip
        """A manifest that names its publisher."""
        message = Tick(
            tick=tick, epoch=epoch, stamp_ns=max(0, tick) * topics.TICK_NS, seq=max(tick, 0), roster=roster,
            roster_version=version, since=since, due=("hw/imu",), mode="lockstep",
        )  # fmt: skip
        self.node.handle(Delivery(topics.HW_TICK, message, None, None, instance))
        self.node.pump()

    def both(self, tick: int, **fields: Any) -> None:
        self.imu(tick, epoch=fields.get("epoch", 1))
        self.tick(tick, **fields)

    def raw(self, topic: Topic[Any], payload: bytes, encoding: str = "", attachment: bytes | None = None) -> None:
        """Messages from the network, whoever sent them."""
        self.node.handle(Delivery(topic, None, Raw(payload, attachment, encoding)))
        self.node.pump()
