"""The simulator as a service, on the in-memory bus: messages, queries, refusals."""

from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

from surefoot.errors import CallError, Refusal
from surefoot.geometry.heightmap import HeightMap
from surefoot.lockstep.config import ServiceConfig
from surefoot.lockstep.join import TickInputs
from surefoot.lockstep.local import LocalSystem
from surefoot.lockstep.service import Service
from surefoot.robot.reader import load_robot
from surefoot.schemas import sim
from surefoot.schemas.base import Request
from surefoot.schemas.hw import DescriptionRequest, EmergencyStop, JointCommand
from surefoot.schemas.terrain import MapRequest
from surefoot.schemas.topics import (
    CMD_ESTOP,
    CMD_JOINTS,
    HW_CONTACTS,
    HW_DESCRIPTION,
    HW_IMU,
    HW_JOINTS,
    HW_LANDMARKS,
    HW_RANGE,
    SIM_CHECKPOINT,
    SIM_FAULT,
    SIM_FEATURES,
    SIM_PAUSE,
    SIM_PLACE,
    SIM_PUSH,
    SIM_RESET,
    SIM_RESTORE,
    SIM_SET,
    SIM_STATUS,
    SIM_STATUS_GET,
    SIM_STEP,
    SIM_TRUTH,
    TERRAIN_LANDMARKS,
    TERRAIN_MAP_GET,
    TICK_NS,
    Query,
)
from surefoot.services.simulator.ground.terrain import KINDS as TERRAINS
from surefoot.services.simulator.physics.faults import KINDS as FAULTS
from surefoot.services.simulator.service import Simulator, SimulatorConfig

RAGNO = load_robot("ragno")


class Holder(Service[ServiceConfig]):
    """A walker that stands, or that commands what a test tells it."""

    name = "walker"
    inputs = (HW_IMU, HW_JOINTS, HW_CONTACTS)
    outputs = (CMD_JOINTS,)
    position = tuple(RAGNO.neutral.tolist())
    torque_limit: tuple[float, ...] | None = None

    def on_tick(self, inputs: TickInputs) -> None:
        self.publish(CMD_JOINTS, JointCommand(position=self.position, torque_limit=self.torque_limit))


class Witness(Service[ServiceConfig]):
    """Keeps everything the simulator publishes in lockstep."""

    name = "recorder"
    inputs = (HW_IMU, HW_JOINTS, HW_CONTACTS, SIM_TRUTH)
    batched = True
    outputs = ()

    def on_start(self) -> None:
        self.seen: list[dict[str, Any]] = []

    def on_reset(self) -> None:
        self.seen.clear()

    def on_tick(self, inputs: TickInputs) -> None:
        self.seen.append(dict(inputs.messages))


class Bench:
    """Simulator, holder and witness, and the way to ask."""

    def __init__(self) -> None:
        self.simulator = Simulator(SimulatorConfig(autostart=False))
        self.walker, self.witness = Holder(ServiceConfig()), Witness(ServiceConfig())
        self.system = LocalSystem([self.simulator, self.walker, self.witness])

    def ask(self, query: Query[Any, Any], request: Request) -> Any:
        return self.system.bus.call(query, request)

    def reset(self, ticks: int = 20, **request: Any) -> sim.ResetReply:
        expect = ("walker", "recorder")
        return self.ask(SIM_RESET, sim.ResetRequest(expect=expect, max_ticks=ticks, **request))

    def finish(self) -> list[dict[str, Any]]:
        leader = self.simulator.node.leader
        self.system.run_until(lambda: leader.state in ("ended", "paused") and leader.all_done())
        return self.witness.seen


@pytest.fixture(scope="module")
def module_bench() -> Iterator[Bench]:
    made = Bench()
    yield made
    made.system.close()


@pytest.fixture
def bench(module_bench: Bench) -> Bench:
    module_bench.walker.position = Holder.position
    return module_bench


def truths(seen: list[dict[str, Any]]) -> list[sim.Truth]:
    return [messages[SIM_TRUTH.key] for messages in seen]


def test_every_tick_has_its_samples_and_stamps(bench: Bench) -> None:
    epoch = bench.reset().epoch
    seen = bench.finish()
    assert len(seen) == 20
    for tick, messages in enumerate(seen):
        assert messages[SIM_TRUTH.key].tick == messages[HW_IMU.key].tick == tick
        assert messages[HW_IMU.key].stamp_ns == tick * TICK_NS
        assert messages[HW_IMU.key].epoch == epoch
        assert (HW_JOINTS.key in messages) == (tick in (0, 4, 7, 10, 14, 17))
    assert seen[4][HW_JOINTS.key].stamp_ns == 33_000_000
    assert seen[4][HW_CONTACTS.key].seq == 1
    assert not truths(seen)[-1].fallen


class Reader(Witness):
    """Reads the map of the landmarks as well."""

    inputs = (*Witness.inputs, TERRAIN_LANDMARKS)


class Blind(Witness):
    """Reads a camera and a ranger as well."""

    inputs = (*Witness.inputs, HW_LANDMARKS, HW_RANGE)


def test_a_camera_and_a_ranger_that_a_robot_does_not_have_are_not_silent() -> None:
    simulator = Simulator(SimulatorConfig(robot="ragno", autostart=False))
    blind = Blind(ServiceConfig(robot="ragno"))
    system = LocalSystem([simulator, blind])
    try:
        system.bus.call(SIM_RESET, sim.ResetRequest(expect=("recorder",), max_ticks=50))
        leader = simulator.node.leader
        system.run_until(lambda: leader.state == "ended" and leader.all_done())
        assert len(blind.seen) == 50
        assert system.nodes[-1].ages.longest == {}
    finally:
        system.close()


@pytest.mark.parametrize("robot", ["nao", "ragno"])
def test_the_map_of_the_landmarks_is_latched_and_nobody_waits_for_one_that_is_not_there(robot: str) -> None:
    simulator = Simulator(SimulatorConfig(robot=robot, autostart=False))
    reader = Reader(ServiceConfig(robot=robot))
    system = LocalSystem([simulator, reader])
    try:
        world = sim.World(terrain="corridor", goal=(5.0, 0.0), start=(1.0, 0.0, 0.5))
        system.bus.call(SIM_RESET, sim.ResetRequest(expect=("recorder",), max_ticks=5, world=world))
        leader = simulator.node.leader
        system.run_until(lambda: leader.state == "ended" and leader.all_done())
    finally:
        system.close()
    assert len(reader.seen) == 5
    if robot == "ragno":
        assert TERRAIN_LANDMARKS.key not in reader.seen[-1]
        with pytest.raises(Refusal, match="no landmarks"):
            simulator.queries.landmarks(MapRequest())
        return
    assert simulator.queries.landmarks(MapRequest()).data == reader.seen[-1][TERRAIN_LANDMARKS.key].data
    found = reader.seen[-1][TERRAIN_LANDMARKS.key]
    assert simulator.world.sight is not None
    field = simulator.world.sight.sensor.field
    rows = np.frombuffer(found.data, dtype="<f4").reshape(found.count, 2 + found.descriptor_length)
    assert rows[:, :2] == pytest.approx(field.position, abs=1e-6)
    assert rows[:, 2:] == pytest.approx(field.descriptor, abs=1e-6)
    assert (found.frame, found.version, found.epoch) == ("map", 1, leader.epoch)


def test_same_seed_same_run_another_seed_another(bench: Bench) -> None:
    def imu(seed: int) -> list[tuple[float, ...]]:
        bench.reset(seed=seed)
        return [messages[HW_IMU.key].acc for messages in bench.finish()]

    assert imu(3) == imu(3) != imu(4)


def test_world_is_built_as_asked(bench: Bench) -> None:
    bench.reset(world=sim.World(terrain="demo", terrain_seed=2, map_profile="exact"))
    found = bench.ask(TERRAIN_MAP_GET, MapRequest())
    heights = HeightMap.from_wire(found.model_dump(), found.data)
    assert found.kind == "demo"
    assert heights.sha256 == bench.simulator.world.terrain.map.sha256
    reply = bench.ask(HW_DESCRIPTION, DescriptionRequest())
    assert reply.hash == RAGNO.hash
    features = bench.ask(SIM_FEATURES, sim.FeaturesRequest())
    assert set(features.terrains) == set(TERRAINS)
    assert set(features.faults) == set(FAULTS)


def test_every_announced_fault_can_be_asked_for(bench: Bench) -> None:
    bench.reset(ticks=4)
    for kind in FAULTS:
        size = {"value": 0.5} if sim.FAULT_FIELDS[kind] else {}
        request = sim.FaultRequest.model_validate({"kind": kind, "duration": 0.02, **size})
        assert bench.ask(SIM_FAULT, request).accepted
    bench.finish()


def test_push_and_set_act_in_their_tick(bench: Bench) -> None:
    bench.reset()
    bench.ask(SIM_PUSH, sim.PushRequest(force=(0.0, 6.0, 0.0), duration=0.05, at_tick=10))
    bench.ask(SIM_SET, sim.SetRequest(quantity="mass", value=1.5, at_tick=10))
    speed = [abs(truth.velocity[1]) for truth in truths(bench.finish())]
    assert max(speed[:11]) < 1e-4 < speed[11]


def test_the_robot_is_put_elsewhere_in_its_tick(bench: Bench) -> None:
    bench.reset()
    assert bench.ask(SIM_PLACE, sim.PlaceRequest(forward=0.1, turn=0.5, at_tick=10)).tick == 10
    bench.ask(SIM_PLACE, sim.PlaceRequest(forward=40.0, at_tick=12))  # cannot be done then: it stays
    x = [truth.position[0] for truth in truths(bench.finish())]
    assert max(abs(a - x[0]) for a in x[:11]) < 1e-3
    assert x[11] - x[0] == pytest.approx(0.1, abs=1e-3)
    assert x[-1] == pytest.approx(x[11], abs=1e-3)


def test_fault_begins_in_its_tick(bench: Bench) -> None:
    bench.reset()
    bench.ask(SIM_FAULT, sim.FaultRequest(kind="imu_drop", duration=0.03, at_tick=8))
    seen = bench.finish()
    assert [tick for tick, messages in enumerate(seen) if HW_IMU.key not in messages] == [9, 10, 11]


def test_pause_step_and_end(bench: Bench) -> None:
    bench.reset(ticks=100, paused=True)
    assert len(bench.finish()) == 1
    bench.ask(SIM_STEP, sim.StepRequest(ticks=5))
    assert len(bench.finish()) == 6
    bench.ask(SIM_PAUSE, sim.PauseRequest(at_tick=9, end=True))
    bench.ask(SIM_STEP, sim.StepRequest())
    assert len(bench.finish()) == 10


def test_restore_repeats_the_run_under_a_new_epoch(bench: Bench) -> None:
    bench.reset(ticks=100, paused=True, world=sim.World(terrain="demo"))
    bench.finish()
    bench.ask(SIM_STEP, sim.StepRequest(ticks=17))
    bench.finish()
    saved = bench.ask(SIM_CHECKPOINT, sim.CheckpointRequest(name="half"))
    bench.ask(SIM_PAUSE, sim.PauseRequest(at_tick=40, end=True))
    bench.ask(SIM_STEP, sim.StepRequest())
    first = list(bench.finish())[18:]
    reply = bench.ask(SIM_RESTORE, sim.RestoreRequest(name="half"))
    assert reply.sha256 == saved.sha256
    assert reply.epoch == saved.epoch + 1
    bench.finish()  # paused at once, as the first run was
    bench.ask(SIM_PAUSE, sim.PauseRequest(at_tick=23, end=True))
    bench.ask(SIM_STEP, sim.StepRequest())
    again = bench.finish()
    assert again[0][HW_IMU.key].stamp_ns == 0
    for before, after in zip(first, again[1:], strict=True):
        assert before[HW_IMU.key].acc == after[HW_IMU.key].acc
        assert before[SIM_TRUTH.key].position == after[SIM_TRUTH.key].position


@pytest.mark.parametrize(
    ("change", "reason"),
    [(9.0, "out_of_range"), (None, "wrong_length")],
)
def test_bad_commands_are_refused_counted_and_the_robot_stands(bench: Bench, change: float | None, reason: str) -> None:
    bench.walker.position = Holder.position[:3] if change is None else (change, *Holder.position[1:])
    before = bench.simulator.node.refused[reason]
    bench.reset()
    seen = bench.finish()
    assert bench.ask(SIM_STATUS_GET, sim.StatusRequest()).held == "no command was accepted for 100 ms"
    assert bench.simulator.node.refused[reason] > before
    assert not truths(seen)[-1].fallen


@pytest.mark.parametrize("limit", [(0.1,), (-0.1,) * RAGNO.nj])
def test_an_impossible_torque_limit_is_refused_and_the_robot_stands(bench: Bench, limit: tuple[float, ...]) -> None:
    bench.walker.torque_limit = limit
    bench.reset()
    seen = bench.finish()
    assert bench.simulator.node.refused["torque_limit"] > 0
    assert not truths(seen)[-1].fallen


def test_a_commanded_torque_limit_reaches_the_servos(bench: Bench) -> None:
    bench.walker.torque_limit = (0.0,) * RAGNO.nj
    bench.reset()
    lowest = min(truth.position[2] for truth in truths(bench.finish()))
    bench.walker.torque_limit = None
    bench.reset()
    assert min(truth.position[2] for truth in truths(bench.finish())) > lowest + 0.02


def test_emergency_stop_holds_until_the_next_reset(bench: Bench) -> None:
    bench.reset()
    bench.system.bus.publisher(CMD_ESTOP).put(EmergencyStop(reason="a hand in the way"))
    bench.walker.position = (Holder.position[0] + 0.2, *Holder.position[1:])
    last = truths(bench.finish())[-1]
    assert last.joints == pytest.approx(Holder.position, abs=0.05)
    assert bench.simulator.node.refused["stopped"] > 0
    assert bench.ask(SIM_STATUS_GET, sim.StatusRequest()).held == "emergency stop: a hand in the way"
    refused = bench.simulator.node.refused["stopped"]
    bench.reset()
    last = truths(bench.finish())[-1]
    assert bench.simulator.node.refused["stopped"] == refused
    assert last.joints[0] > Holder.position[0] + 0.1


def test_every_emergency_stop_is_confirmed_at_once_even_in_a_pause(bench: Bench) -> None:
    heard: list[Any] = []
    bench.system.bus.subscribe(SIM_STATUS, heard.append)
    bench.reset(paused=True)
    bench.system.run_until(lambda: bench.simulator.node.leader.state == "paused")
    stop = bench.system.bus.publisher(CMD_ESTOP)
    for reason in ("a hand in the way", "still there"):
        stop.put(EmergencyStop(reason=reason))
        bench.simulator.node.pump()
    told = [delivery.message() for delivery in heard if not delivery.prime]
    assert [status.stopped for status in told] == ["a hand in the way"] * 2
    assert {status.source for status in told} == {"simulator"}


def test_a_reset_that_keeps_changes_only_what_it_gives(bench: Bench) -> None:
    world = sim.World(terrain="slope", friction=0.7)
    bench.reset(ticks=5, mode="paced", rtf=3.0, seed=4, world=world)
    bench.finish()
    kept = sim.ResetRequest.model_validate({"keep": True, "world": {"friction": 0.5}, "seed": 5})
    sent = sim.ResetRequest.model_validate_json(kept.model_dump_json())  # as it travels
    bench.ask(SIM_RESET, sent)
    now = bench.simulator.run.request
    assert (now.mode, now.rtf, now.seed, now.max_ticks, now.expect) == ("paced", 3.0, 5, 5, ("walker", "recorder"))
    assert (now.world.terrain, now.world.friction) == ("slope", 0.5)
    bench.finish()


def test_paced_time_that_cannot_keep_its_factor_is_late_with_the_factor_achieved(bench: Bench) -> None:
    """Nobody can run at 1000 times real time; a paused simulation is not late."""
    bench.reset(ticks=2000, mode="paced", rtf=1000.0)
    heard: list[Any] = []
    bench.system.bus.subscribe(SIM_STATUS, heard.append)
    bench.finish()
    told = [delivery.message() for delivery in heard if not delivery.prime]
    late = [status for status in told if status.late]
    assert late
    assert {(status.mode, status.pace) for status in late} == {("paced", 1000.0)}
    assert all(0.0 < status.rtf < 1000.0 for status in late)


@pytest.mark.parametrize(
    ("query", "request_", "field"),
    [
        (SIM_RESET, sim.ResetRequest(world=sim.World(terrain="moon")), "world.terrain"),
        (SIM_RESET, sim.ResetRequest(world=sim.World(terrain="nowhere.npz")), "world.terrain"),
        (SIM_RESET, sim.ResetRequest(world=sim.World(imu_profile="crystal")), "world.imu_profile"),
        (SIM_RESET, sim.ResetRequest(world=sim.World(camera="crystal")), "world.camera"),
        (SIM_RESET, sim.ResetRequest(world=sim.World(camera="nao_bottom")), "world.camera"),
        (SIM_RESET, sim.ResetRequest(world=sim.World(terrain="corridor", start=(0.0, 0.95, 0.0))), "world.start"),
        (SIM_RESET, sim.ResetRequest(world=sim.World(start=(1e9, 0.0, 0.0))), "world.start"),
        (SIM_PUSH, sim.PushRequest(force=(1.0, 0.0, 0.0), duration=0.1, body="tail"), "body"),
        (SIM_FAULT, sim.FaultRequest(kind="servo_dead", target="tail"), "target"),
        (SIM_FAULT, sim.FaultRequest(kind="packet_loss", value=2.0), "value"),
        (SIM_PUSH, sim.PushRequest(force=(1.0, 0.0, 0.0), duration=0.1, at_tick=0), "at_tick"),
        (SIM_PLACE, sim.PlaceRequest(forward=50.0), "forward"),
        (SIM_PLACE, sim.PlaceRequest(turn=1.0, at_tick=0), "at_tick"),
        (SIM_RESTORE, sim.RestoreRequest(name="never"), "name"),
    ],
)
def test_refusals_name_the_field(bench: Bench, query: Query[Any, Any], request_: Request, field: str) -> None:
    bench.reset(ticks=3)
    bench.finish()
    with pytest.raises(CallError) as error:
        bench.ask(query, request_)
    assert error.value.field == field
    assert error.value.code != "internal"
