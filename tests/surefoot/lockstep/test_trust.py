"""Strangers, and whoever copies the public name of a process: refused, counted, logged by key and process."""

import random
from typing import Any

import pytest

from surefoot.bus.codec import MAX_JSON_BYTES
from surefoot.bus.frame import Frame, FramePart, pack
from surefoot.bus.interface import Delivery, Life, Raw, Stamp
from surefoot.bus.memory import MemoryBus
from surefoot.errors import CallError, Refusal
from surefoot.lockstep import driver as driver_module
from surefoot.lockstep.config import ServiceConfig
from surefoot.lockstep.driver import DriverNode
from surefoot.lockstep.join import DRIVER, SENDER_BYTES, Join
from surefoot.lockstep.node import Node
from surefoot.lockstep.service import Service
from surefoot.schemas import topics
from surefoot.schemas.base import Message
from surefoot.schemas.footholds import AssessReply, AssessRequest
from surefoot.schemas.hw import Imu, JointCommand, Tick
from surefoot.schemas.system import Done, LogRecord
from surefoot.schemas.terrain import HeightMapMessage
from surefoot.schemas.topics import Topic
from tests.surefoot.expect import expect_error
from tests.surefoot.lockstep.driver_bench import Bench as DriverBench
from tests.surefoot.lockstep.driver_bench import GuardedDriver, reference
from tests.surefoot.lockstep.node_bench import Bench, Subject
from tests.surefoot.net import Net, spinning, wait_until
from tests.surefoot.toys import ToyObserver, estimate


def height_map(version: int, epoch: int = 1) -> HeightMapMessage:
    found = HeightMapMessage(rows=1, cols=1, cell=0.1, origin=(0.0, 0.0), version=version, data=b"\0" * 4)
    return found.stamped(0, 0, epoch, 0, "simulator")


def texts(bench: Bench) -> list[str]:
    return [record.text for record in bench.sent(LogRecord)]


class Mapped(Subject):
    """A subject that needs the map as well."""

    inputs = (*Subject.inputs, topics.TERRAIN_MAP)


class MapObserver(ToyObserver):
    """An observer of the map, as the recorder is one."""

    observes = (topics.TERRAIN_MAP,)

    def __init__(self) -> None:
        super().__init__()
        self.versions: list[int] = []

    def on_message(self, topic: Topic[Any], message: Message) -> None:
        assert isinstance(message, HeightMapMessage)
        self.versions.append(message.version)


@pytest.fixture
def bench() -> Bench:
    made = Bench(Mapped())
    made.prime_as("real")
    return made


def offer(bench: Bench, topic: Topic[Any], message: Message, sender: str) -> None:
    bench.node.handle(Delivery(topic, message, None, None, sender))
    bench.node.pump()


# -- latched topics ----------------------------------------------------------------------------------------------------


def test_a_strangers_map_of_the_present_epoch_is_refused_counted_and_named(bench: Bench) -> None:
    offer(bench, topics.TERRAIN_MAP, height_map(7), "stranger")
    offer(bench, topics.TERRAIN_MAP, height_map(4), "real")
    offer(bench, topics.TERRAIN_MAP, height_map(8), "stranger")
    bench.imu(0)
    bench.signed_tick("real", 0)
    assert bench.subject.seen[0][topics.TERRAIN_MAP.key].version == 4
    assert bench.node.refused == {"unbound": 2}
    (text,) = texts(bench)
    assert topics.TERRAIN_MAP.key in text
    assert "'stranger'" in text
    assert "'real'" in text


def test_each_key_that_a_stranger_publishes_is_logged_once(bench: Bench) -> None:
    for _ in range(3):
        offer(bench, topics.TERRAIN_MAP, height_map(7), "stranger")
        offer(bench, topics.HW_IMU, Imu(acc=(0.0, 0.0, 9.0), gyro=(0.0, 0.0, 0.0)), "stranger")
    assert [text.split(": ")[1].split(" ")[0] for text in texts(bench)] == [topics.TERRAIN_MAP.key, topics.HW_IMU.key]


def test_over_the_network_maps_come_from_the_bound_driver_only_to_observers_and_late_joiners(net: Net) -> None:
    """The forger knows the keys of participants; a service that observes and one that starts late get the map."""

    early, late = MapObserver(), MapObserver()
    driving, first = DriverNode(GuardedDriver(), net.open()), Node(early, net.open())
    for node in (driving, first):
        node.start()
    driving.begin(("recorder",), "paced", 1.0, 1, "degrade", 0)
    forger = net.open().publisher(topics.TERRAIN_MAP, "forger")
    with spinning(driving, first):
        wait_until(lambda: driving.leader.tick > 2)
        for version in range(50):
            forger.put(height_map(100 + version, driving.leader.epoch))
        wait_until(lambda: first.refused["unbound"] > 0 and bool(early.versions))
        late.name = "viewer"  # type: ignore[misc]
        second = Node(late, net.open())
        second.start()
        with spinning(second):
            wait_until(lambda: bool(late.versions))
        assert set(early.versions) == set(late.versions) == {4}


# -- queries -----------------------------------------------------------------------------------------------------------


class Asked(Service[ServiceConfig]):
    """A server of assessments."""

    name = "footholds"
    serves = (topics.FOOTHOLDS_ASSESS,)

    def __init__(self) -> None:
        super().__init__(ServiceConfig())
        self.questions = 0

    def on_start(self) -> None:
        self.handle(topics.FOOTHOLDS_ASSESS, self._answer)

    def _answer(self, request: AssessRequest) -> AssessReply:
        self.questions += 1
        return AssessReply.model_construct()


ROSTER = ("estimator", "footholds")


def joined() -> tuple[Bench, Node]:
    """A caller and its server on one bus, primed."""
    bench = Bench()
    asked = Node(Asked(), bench.bus)
    asked.start()
    bench.bus.pump_with(topics.FOOTHOLDS_ASSESS, asked.pump)
    bench.imu_publisher.prime()
    bench.tick(-1, roster=ROSTER)
    return bench, asked


REQUEST = AssessRequest.model_construct()


def test_a_strangers_queryable_gets_no_question_of_a_service() -> None:
    """Neither on the common key, nor with a token of the owner's name beside the bound one."""
    bench, asked = joined()
    stolen: list[Any] = []
    bench.bus.serve(topics.FOOTHOLDS_ASSESS, stolen.append, stolen.append, "stranger")
    bench.bus.announce("footholds", "stranger")
    bench.node.pump()
    for _ in range(5):
        bench.node.call(topics.FOOTHOLDS_ASSESS, REQUEST, None)
    assert isinstance(asked.service, Asked)
    assert (asked.service.questions, stolen) == (5, [])
    assert bench.node.refused["second"] == 1
    assert any("'stranger'" in text and "footholds" in text and asked.instance in text for text in texts(bench))


def test_a_server_that_is_started_again_is_asked_and_one_that_is_gone_is_absent() -> None:
    bench, _ = joined()
    bench.node.call(topics.FOOTHOLDS_ASSESS, REQUEST, None)
    bench.bus.depart("footholds")
    again = Node(Asked(), bench.bus)
    again.start()
    bench.bus.pump_with(topics.FOOTHOLDS_ASSESS, again.pump)
    bench.node.pump()
    bench.node.call(topics.FOOTHOLDS_ASSESS, REQUEST, None)
    assert isinstance(again.service, Asked)
    assert again.service.questions == 1
    assert bench.node.bindings.bound["footholds"] == again.instance


def test_without_a_process_that_proves_its_link_nobody_is_asked() -> None:
    bench = Bench()
    stolen: list[Any] = []
    bench.bus.serve(topics.FOOTHOLDS_ASSESS, stolen.append)
    with expect_error(CallError, "absent"):
        bench.node.call(topics.FOOTHOLDS_ASSESS, REQUEST, None)
    assert stolen == []


def test_over_the_network_a_silent_queryable_on_the_keys_of_a_query_holds_no_service(net: Net) -> None:
    """On the common key, on that of participants, and under a token of its own."""
    serving, asking = Node(Asked(), net.open()), Node(Subject(), net.open())
    kept: list[Any] = []
    with net.plain() as stranger:
        queryables = [
            stranger.declare_queryable(f"{net.namespace}/{key}", kept.append, complete=True)
            for key in ("footholds/assess", "@footholds/assess", "@footholds/assess/x", "@footholds/*")
        ]
        token = stranger.liveliness().declare_token(f"{net.namespace}/alive/footholds/x")
        for node in (serving, asking):
            node.start()
        with spinning(serving):
            wait_until(lambda: not asking.pump() and bool(asking.links.server(topics.FOOTHOLDS_ASSESS)))
            kept.clear()
            with pytest.raises(CallError, match="Assess"):  # it answers that an empty request is none
                asking.call(topics.FOOTHOLDS_ASSESS, REQUEST, None)
        assert kept == []
        del queryables, token


# -- whoever copies the name of a process ------------------------------------------------------------------------------


def test_contradictions_of_one_process_are_counted_and_named(bench: Bench) -> None:
    """Of the next tick's sensors, of the manifest and of what was used already: the same again is no contradiction."""
    offer(bench, topics.TERRAIN_MAP, height_map(4), "real")
    imu = Imu(acc=(0.5, 0.0, 9.81), gyro=(0.0, 0.0, 0.0))
    forged = Imu(acc=(9.0, 0.0, 9.81), gyro=(0.0, 0.0, 0.0))
    for message in (imu, imu, forged):
        offer(bench, topics.HW_IMU, message.stamped(0, 0, 1, 0, "simulator"), "real")
    bench.signed_tick("real", 0)
    bench.signed_tick("real", 0)
    for message in (imu, forged):
        offer(bench, topics.HW_IMU, message.stamped(0, 0, 1, 0, "simulator"), "real")
    assert bench.subject.ticks == [0]
    assert bench.node.refused == {"conflict": 2}
    (text,) = texts(bench)
    assert "hw/imu of epoch 1, tick 0, by process 'real'" in text


def test_a_second_command_of_a_tick_is_a_contradiction(no_waiting: None) -> None:
    driven = DriverBench(at=10)
    walker = next(node for node in driven.system.nodes if node.name == "walker")
    driven.until(lambda: driven.node.commands.known(driven.leader.tick - 1))
    tick = driven.leader.tick - 1
    command = JointCommand(position=(30.0,)).stamped(tick * topics.TICK_NS, tick, 1, tick, "walker")
    driven.node.handle(Delivery(topics.CMD_JOINTS, command, None, None, walker.instance))
    assert driven.node.refused["conflict"] == 1
    assert driven.finish(40) == reference(40)


def test_an_answer_to_a_tick_that_has_not_come_lets_no_service_be_left_behind(no_waiting: None) -> None:
    driven = DriverBench(at=10)
    estimator = next(node for node in driven.system.nodes if node.name == "estimator")
    far = Done(tick=10**6, epoch=1, source="estimator", instance=estimator.instance)
    driven.node.handle(Delivery(topics.TICK_DONE, far, None))
    assert driven.leader.members["estimator"].done <= driven.leader.tick
    assert driven.node.refused["too_far_ahead"] == 1


def test_frames_and_messages_beyond_their_size_are_refused() -> None:
    for payload, count in ((b"x" * (MAX_JSON_BYTES + 1), 1), (b"x" * MAX_JSON_BYTES, 9)):
        parts = count * [FramePart(topics.HW_IMU.key, payload, Stamp(0, 1, 0, 0))]
        with expect_error(Refusal, "too_large"):
            Frame(DRIVER, {topics.HW_IMU.key: topics.HW_IMU}, *pack(parts, "real")).deliveries()


def test_batches_of_one_sender_hold_no_more_than_its_share() -> None:
    """Twenty batches of 7 MB for ticks to come, as the recorder and the supervisor take them."""
    join = Join("recorder", (topics.HW_IMU, topics.STATE_VELOCITY), batched=True)
    join.epoch, join.on_roster, join.last = 1, True, 0
    held = 0
    for tick in range(1, 60):
        header = Stamp(tick, 1, tick * topics.TICK_NS, tick)
        for topic in (topics.HW_IMU, topics.STATE_VELOCITY):
            raw = Raw(b"x" * MAX_JSON_BYTES, None, "")
            reason = join.offer(topic, header, Delivery(topic, None, raw), "real", MAX_JSON_BYTES)  # type: ignore[arg-type]
            held += MAX_JSON_BYTES * (reason is None)
            assert reason in (None, "too_much")
    assert held == 2 * SENDER_BYTES


def storm(driven: DriverBench, seed: int) -> None:
    """Forgeries in the names of all processes of a run, drawn from a seed."""
    draw = random.Random(seed)
    names = {node.name: node.instance for node in driven.system.nodes}
    driver = names["simulator"]
    for _ in range(60):
        tick = draw.choice([-1, 0, driven.leader.tick, driven.leader.tick + draw.randrange(100), 10**9])
        epoch = draw.choice([0, 1, 2, 3, 10**9])
        header = (tick * topics.TICK_NS, tick, epoch, max(tick, 0), "x")
        node = draw.choice(driven.system.nodes)
        manifest = Tick(
            tick=tick, epoch=epoch, stamp_ns=max(0, tick) * topics.TICK_NS, roster=tuple(sorted(names)),
            roster_version=1, due=("hw/imu",), mode="lockstep",
        )  # fmt: skip
        done = Done(tick=tick, epoch=epoch, source="walker", instance=names["walker"], ready=tick < 0)
        topic, message, sender = draw.choice(
            [
                (topics.HW_TICK, manifest, driver),
                (topics.HW_IMU, Imu(acc=(draw.random(), 0.0, 9.81), gyro=(0.0, 0.0, 0.0)).stamped(*header), driver),
                (topics.STATE_VELOCITY, estimate(draw.random()).stamped(*header), names["estimator"]),
                (topics.TERRAIN_MAP, height_map(draw.randrange(9), epoch), driver),
                (topics.CMD_JOINTS, JointCommand(position=(draw.random(),)).stamped(*header), names["walker"]),
                (topics.TICK_DONE, done, ""),
            ]
        )
        if (node is driven.node) == (topic in (topics.CMD_JOINTS, topics.TICK_DONE)):
            node.handle(Delivery(topic, message, None, None, sender))
        driven.node.handle(Life("walker", "x", draw.random() < 0.5))


@pytest.mark.parametrize("seed", range(40))
def test_a_reset_heals_whatever_came_before(no_waiting: None, monkeypatch: pytest.MonkeyPatch, seed: int) -> None:
    monkeypatch.setattr(driver_module, "SILENCE_S", 1e-9)  # what is lacking is sent again at once
    monkeypatch.setattr(driver_module, "RESENDS", 10**6)
    driven = DriverBench(at=10)
    storm(driven, seed)
    driven.driver.x = 0.0
    driven.driver.history.clear()
    driven.node.begin(("estimator", "walker", "recorder"), "lockstep", 0.0, 1, "hold", 0)
    assert driven.finish(40) == reference(40)


# -- logs of services in one process -----------------------------------------------------------------------------------


class Listener(ToyObserver):
    """An observer of logs."""

    observes = (topics.LOG,)

    def __init__(self) -> None:
        super().__init__()
        self.lines: list[str] = []

    def on_message(self, topic: Topic[Any], message: Message) -> None:
        assert topic is topics.LOG
        assert isinstance(message, LogRecord)
        self.lines.append(f"{message.source}: {message.text}")


def test_a_log_is_observed_and_not_refused_as_an_input_of_another_epoch() -> None:
    bus = MemoryBus()
    node = Node(Listener(), bus)
    node.start()
    node.epoch = node.join.epoch = 3
    bus.publisher(topics.LOG.of("navigator")).put(LogRecord(source="navigator", level="info", text="planned"))
    node.pump()
    assert isinstance(node.service, Listener)
    assert (node.service.lines, dict(node.refused)) == (["navigator: planned"], {})
