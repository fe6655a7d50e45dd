"""The simulator as a service, on the in-memory bus: messages, queries, refusals."""

import functools
import itertools
from collections.abc import Iterator
from types import SimpleNamespace
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
from surefoot.schemas import sim, topics
from surefoot.schemas.base import Request
from surefoot.schemas.hw import DescriptionRequest, EmergencyStop, JointCommand
from surefoot.schemas.status import StatusRequest
from surefoot.schemas.terrain import MapRequest
from surefoot.services.simulator import run
from surefoot.services.simulator.ground.terrain import KINDS as TERRAINS
from surefoot.services.simulator.physics.faults import KINDS as FAULTS
from surefoot.services.simulator.service import Simulator, SimulatorConfig
from tests.services.refusals import refused

RAGNO = load_robot("ragno")


class Holder(Service[ServiceConfig]):
    """A walker that stands, or that commands what a test sets."""

    name = "walker"
    inputs = (topics.HW_IMU, topics.HW_JOINTS, topics.HW_CONTACTS)
    outputs = (topics.CMD_JOINTS,)
    position = tuple(RAGNO.neutral.tolist())
    torque_limit: tuple[float, ...] | None = None

    def on_tick(self, inputs: TickInputs) -> None:
        self.publish(topics.CMD_JOINTS, JointCommand(position=self.position, torque_limit=self.torque_limit))


class Witness(Service[ServiceConfig]):
    """Keeps everything the simulator publishes in lockstep."""

    name = "recorder"
    inputs = (topics.HW_IMU, topics.HW_JOINTS, topics.HW_CONTACTS, topics.SIM_TRUTH)
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

    def ask(self, query: topics.Query[Any, Any], request: Request) -> Any:
        return self.system.bus.call(query, request)

    def reset(self, ticks: int = 20, **request: Any) -> sim.ResetReply:
        expect = ("walker", "recorder")
        return self.ask(topics.SIM_RESET, sim.ResetRequest(expect=expect, max_ticks=ticks, **request))

    def finish(self) -> list[dict[str, Any]]:
        leader = self.simulator.node.leader
        self.system.run_until(lambda: leader.state in ("ended", "paused") and leader.all_done())
        return self.witness.seen

    def run(self, ticks: int = 20, **request: Any) -> list[dict[str, Any]]:
        """Reset, and return what the witness has seen at the end or in the pause."""
        self.reset(ticks, **request)
        return self.finish()


def alone(robot: str, witness: Witness, **request: Any) -> tuple[Simulator, LocalSystem]:
    """Run a simulator with one witness to the end."""
    simulator = Simulator(SimulatorConfig(robot=robot, autostart=False))
    system = LocalSystem([simulator, witness])
    try:
        system.bus.call(topics.SIM_RESET, sim.ResetRequest(expect=("recorder",), **request))
        leader = simulator.node.leader
        system.run_until(lambda: leader.state == "ended" and leader.all_done())
    finally:
        system.close()
    return simulator, system


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
    return [messages[topics.SIM_TRUTH.key] for messages in seen]


def test_every_tick_has_its_samples_and_stamps(bench: Bench) -> None:
    epoch = bench.reset().epoch
    seen = bench.finish()
    assert len(seen) == 20
    for tick, messages in enumerate(seen):
        assert messages[topics.SIM_TRUTH.key].tick == messages[topics.HW_IMU.key].tick == tick
        assert messages[topics.HW_IMU.key].stamp_ns == tick * topics.TICK_NS
        assert messages[topics.HW_IMU.key].epoch == epoch
        assert (topics.HW_JOINTS.key in messages) == (tick in (0, 4, 7, 10, 14, 17))
    assert (seen[4][topics.HW_JOINTS.key].stamp_ns, seen[4][topics.HW_CONTACTS.key].seq) == (33_000_000, 1)
    assert not truths(seen)[-1].fallen


class Reader(Witness):
    """Reads the map of the landmarks as well."""

    inputs = (*Witness.inputs, topics.TERRAIN_LANDMARKS)


class Blind(Witness):
    """Reads a camera and a ranger as well."""

    inputs = (*Witness.inputs, topics.HW_LANDMARKS, topics.HW_RANGE)


def test_a_camera_and_a_ranger_that_a_robot_does_not_have_are_not_silent() -> None:
    blind = Blind(ServiceConfig(robot="ragno"))
    _, system = alone("ragno", blind, max_ticks=50)
    assert len(blind.seen) == 50
    assert system.nodes[-1].ages.longest == {}


@pytest.mark.parametrize("robot", ["nao", "ragno"])
def test_the_map_of_the_landmarks_is_latched_and_no_service_waits_for_an_absent_one(robot: str) -> None:
    reader = Reader(ServiceConfig(robot=robot))
    world = sim.World(terrain="corridor", goal=(5.0, 0.0), start=(1.0, 0.0, 0.5))
    simulator, _ = alone(robot, reader, max_ticks=5, world=world)
    assert len(reader.seen) == 5
    if robot == "ragno":
        assert topics.TERRAIN_LANDMARKS.key not in reader.seen[-1]
        with pytest.raises(Refusal, match="no landmarks"):
            simulator.queries.landmarks(MapRequest())
        return
    assert simulator.queries.landmarks(MapRequest()).data == reader.seen[-1][topics.TERRAIN_LANDMARKS.key].data
    found = reader.seen[-1][topics.TERRAIN_LANDMARKS.key]
    field = simulator.world.sight.sensor.field
    rows = np.frombuffer(found.data, dtype="<f4").reshape(found.count, 2 + found.descriptor_length)
    assert rows[:, :2] == pytest.approx(field.position, abs=1e-6)
    assert rows[:, 2:] == pytest.approx(field.descriptor, abs=1e-6)
    assert (found.frame, found.version, found.epoch) == ("map", 1, simulator.node.leader.epoch)


def test_same_seed_same_run_another_seed_another(bench: Bench) -> None:
    def imu(seed: int) -> list[tuple[float, ...]]:
        return [messages[topics.HW_IMU.key].acc for messages in bench.run(seed=seed)]

    assert imu(3) == imu(3) != imu(4)


def test_world_is_built_as_asked(bench: Bench) -> None:
    bench.reset(world=sim.World(terrain="demo", terrain_seed=2, map_profile="exact"))
    found = bench.ask(topics.TERRAIN_MAP_GET, MapRequest())
    heights = HeightMap.from_wire(found.model_dump(), found.data)
    assert found.kind == "demo"
    assert heights.sha256 == bench.simulator.world.terrain.map.sha256
    reply = bench.ask(topics.HW_DESCRIPTION, DescriptionRequest())
    assert reply.hash == RAGNO.hash
    features = bench.ask(topics.SIM_FEATURES, sim.FeaturesRequest())
    assert set(features.terrains) == set(TERRAINS)
    assert {"sensor_off", "imu_bias"} <= set(features.faults) <= set(FAULTS)


def test_every_announced_fault_can_be_asked_for(bench: Bench) -> None:
    bench.reset(ticks=4)
    announced = bench.ask(topics.SIM_FEATURES, sim.FeaturesRequest()).faults
    for kind in FAULTS:
        size = {"value": 2.0 if kind == "sensor_slow" else 0.5} if sim.FAULT_FIELDS[kind] else {}
        request = sim.FaultRequest.model_validate({"kind": kind, "duration": 0.02, **size})
        if kind in announced:
            assert bench.ask(topics.SIM_FAULT, request).accepted
        else:
            with pytest.raises(CallError, match=f"{kind} goes with"):
                bench.ask(topics.SIM_FAULT, request)
    bench.finish()


def test_push_and_set_act_in_their_tick(bench: Bench) -> None:
    bench.reset()
    bench.ask(topics.SIM_PUSH, sim.PushRequest(force=(0.0, 6.0, 0.0), duration=0.05, at_tick=10))
    bench.ask(topics.SIM_SET, sim.SetRequest(quantity="mass", value=1.5, at_tick=10))
    speed = [abs(truth.velocity[1]) for truth in truths(bench.finish())]
    assert max(speed[:11]) < 1e-4 < speed[11]


def test_the_robot_is_put_elsewhere_in_its_tick(bench: Bench) -> None:
    bench.reset()
    assert bench.ask(topics.SIM_PLACE, sim.PlaceRequest(forward=0.1, turn=0.5, at_tick=10)).tick == 10
    bench.ask(topics.SIM_PLACE, sim.PlaceRequest(forward=40.0, at_tick=12))  # cannot be done then: it stays
    x = [truth.position[0] for truth in truths(bench.finish())]
    assert max(abs(a - x[0]) for a in x[:11]) < 1e-3
    assert x[11] - x[0] == pytest.approx(0.1, abs=1e-3)
    assert x[-1] == pytest.approx(x[11], abs=1e-3)


def test_fault_begins_in_its_tick(bench: Bench) -> None:
    bench.reset()
    bench.ask(topics.SIM_FAULT, sim.FaultRequest(kind="imu_drop", duration=0.03, at_tick=8))
    seen = bench.finish()
    assert [tick for tick, messages in enumerate(seen) if topics.HW_IMU.key not in messages] == [9, 10, 11]


def test_pause_step_and_end(bench: Bench) -> None:
    assert len(bench.run(ticks=100, paused=True)) == 1
    bench.ask(topics.SIM_STEP, sim.StepRequest(ticks=5))
    assert len(bench.finish()) == 6
    bench.ask(topics.SIM_PAUSE, sim.PauseRequest(at_tick=9, end=True))
    bench.ask(topics.SIM_STEP, sim.StepRequest())
    assert len(bench.finish()) == 10


def test_the_same_order_of_a_participant_is_carried_out_in_the_next_run_too(bench: Bench) -> None:
    for _ in range(2):
        bench.run(ticks=20, paused=True)
        end = sim.PauseRequest(at_tick=9, end=True)
        for _ in range(2):  # the answer to the first is lost on the way
            bench.system.bus.call(topics.SIM_PAUSE, end, instance=bench.simulator.node.instance)
        bench.ask(topics.SIM_STEP, sim.StepRequest())
        assert len(bench.finish()) == 10


def test_restore_repeats_the_run_under_a_new_epoch(bench: Bench) -> None:
    bench.run(ticks=100, paused=True, world=sim.World(terrain="demo"))
    bench.ask(topics.SIM_STEP, sim.StepRequest(ticks=17))
    bench.finish()
    saved = bench.ask(topics.SIM_CHECKPOINT, sim.CheckpointRequest(name="half"))
    bench.ask(topics.SIM_PAUSE, sim.PauseRequest(at_tick=40, end=True))
    bench.ask(topics.SIM_STEP, sim.StepRequest())
    first = list(bench.finish())[18:]
    reply = bench.ask(topics.SIM_RESTORE, sim.RestoreRequest(name="half"))
    assert (reply.sha256, reply.epoch) == (saved.sha256, saved.epoch + 1)
    bench.finish()  # paused at once, as the first run was
    bench.ask(topics.SIM_PAUSE, sim.PauseRequest(at_tick=23, end=True))
    bench.ask(topics.SIM_STEP, sim.StepRequest())
    again = bench.finish()
    assert again[0][topics.HW_IMU.key].stamp_ns == 0
    for before, after in zip(first, again[1:], strict=True):
        assert before[topics.HW_IMU.key].acc == after[topics.HW_IMU.key].acc
        assert before[topics.SIM_TRUTH.key].position == after[topics.SIM_TRUTH.key].position


@pytest.mark.parametrize(("change", "reason"), [(9.0, "out_of_range"), (None, "wrong_length")])
def test_bad_commands_are_refused_counted_and_the_robot_stands(bench: Bench, change: float | None, reason: str) -> None:
    bench.walker.position = Holder.position[:3] if change is None else (change, *Holder.position[1:])
    before = bench.simulator.node.refused[reason]
    seen = bench.run()
    assert bench.ask(topics.SIM_STATUS_GET, StatusRequest()).held == "no command was accepted for 100 ms"
    assert bench.simulator.node.refused[reason] > before
    assert not truths(seen)[-1].fallen


@pytest.mark.parametrize("limit", [(0.1,), (-0.1,) * RAGNO.nj])
def test_an_impossible_torque_limit_is_refused_and_the_robot_stands(bench: Bench, limit: tuple[float, ...]) -> None:
    bench.walker.torque_limit = limit
    seen = bench.run()
    assert bench.simulator.node.refused["torque_limit"] > 0
    assert not truths(seen)[-1].fallen


def test_a_commanded_torque_limit_reaches_the_servos(bench: Bench) -> None:
    bench.walker.torque_limit = (0.0,) * RAGNO.nj
    lowest = min(truth.position[2] for truth in truths(bench.run()))
    bench.walker.torque_limit = None
    assert min(truth.position[2] for truth in truths(bench.run())) > lowest + 0.02


def test_emergency_stop_holds_until_the_next_reset(bench: Bench) -> None:
    bench.reset()
    bench.system.bus.publisher(topics.CMD_ESTOP).put(EmergencyStop(reason="a hand in the way"))
    bench.walker.position = (Holder.position[0] + 0.2, *Holder.position[1:])
    last = truths(bench.finish())[-1]
    assert last.joints == pytest.approx(Holder.position, abs=0.05)
    assert bench.simulator.node.refused["stopped"] > 0
    assert bench.ask(topics.SIM_STATUS_GET, StatusRequest()).held == "emergency stop: a hand in the way"
    refused = bench.simulator.node.refused["stopped"]
    last = truths(bench.run())[-1]
    assert bench.simulator.node.refused["stopped"] == refused
    assert last.joints[0] > Holder.position[0] + 0.1


def test_a_command_accepted_before_an_emergency_stop_moves_nothing_after_it(
    bench: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    bench.reset()
    applied: list[Any] = []
    monkeypatch.setattr(bench.simulator.run.world, "step_tick", lambda position, *_: applied.append(position))
    accepted = JointCommand(position=Holder.position)
    bench.simulator.actuate(0, accepted)
    bench.simulator.run.stop("a hand in the way")
    bench.simulator.actuate(1, accepted)
    assert applied[0] == pytest.approx(Holder.position)
    assert applied[1:] == [None]  # None: the joints are held


def test_every_emergency_stop_is_confirmed_at_once_even_in_a_pause(bench: Bench) -> None:
    heard: list[Any] = []
    bench.system.bus.subscribe(topics.SIM_STATUS, heard.append)
    bench.reset(paused=True)
    bench.system.run_until(lambda: bench.simulator.node.leader.state == "paused")
    stop = bench.system.bus.publisher(topics.CMD_ESTOP)
    for reason in ("a hand in the way", "still there"):
        stop.put(EmergencyStop(reason=reason))
        bench.simulator.node.pump()
    told = [delivery.message() for delivery in heard if not delivery.prime]
    assert [status.stopped for status in told] == ["a hand in the way"] * 2
    assert {status.source for status in told} == {"simulator"}


def test_a_reset_that_keeps_changes_only_what_it_gives(bench: Bench) -> None:
    world = sim.World(terrain="slope", friction=0.7)
    bench.run(ticks=5, mode="paced", rtf=3.0, seed=4, world=world)
    kept = sim.ResetRequest.model_validate({"keep": True, "world": {"friction": 0.5}, "seed": 5})
    sent = sim.ResetRequest.model_validate_json(kept.model_dump_json())  # as it travels
    bench.ask(topics.SIM_RESET, sent)
    now = bench.simulator.run.request
    assert (now.mode, now.rtf, now.seed, now.max_ticks, now.expect) == ("paced", 3.0, 5, 5, ("walker", "recorder"))
    assert (now.world.terrain, now.world.friction) == ("slope", 0.5)
    bench.finish()


def test_paced_time_that_cannot_keep_its_factor_is_late_with_the_factor_achieved(
    bench: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Every look at the clock takes 5 ms: no tick of 10 us is kept."""
    clock = functools.partial(next, itertools.count(step=0.005))
    monkeypatch.setattr(bench.simulator.node.pace, "_clock", clock)
    monkeypatch.setattr(run, "time", SimpleNamespace(perf_counter=clock))
    bench.reset(ticks=300, mode="paced", rtf=1000.0)
    heard: list[Any] = []
    bench.system.bus.subscribe(topics.SIM_STATUS, heard.append)
    bench.finish()
    told = [delivery.message() for delivery in heard if not delivery.prime]
    late = [status for status in told if status.late]
    assert late
    assert {(status.mode, status.pace) for status in late} == {("paced", 1000.0)}
    assert all(0.0 < status.rtf < 1000.0 for status in late)


@pytest.mark.parametrize(
    ("query", "request_", "field"),
    [
        (topics.SIM_RESET, sim.ResetRequest(world=sim.World(terrain="moon")), "world.terrain"),
        (topics.SIM_RESET, sim.ResetRequest(world=sim.World(terrain="nowhere.npz")), "world.terrain"),
        (topics.SIM_RESET, sim.ResetRequest(world=sim.World(imu_profile="crystal")), "world.imu_profile"),
        (topics.SIM_RESET, sim.ResetRequest(world=sim.World(camera="crystal")), "world.camera"),
        (topics.SIM_RESET, sim.ResetRequest(world=sim.World(camera="nao_bottom")), "world.camera"),
        (
            topics.SIM_RESET,
            sim.ResetRequest(world=sim.World(terrain="corridor", start=(0.0, 0.95, 0.0))),
            "world.start",
        ),
        (topics.SIM_RESET, sim.ResetRequest(world=sim.World(start=(1e9, 0.0, 0.0))), "world.start"),
        (topics.SIM_PUSH, sim.PushRequest(force=(1.0, 0.0, 0.0), duration=0.1, body="tail"), "body"),
        (topics.SIM_FAULT, sim.FaultRequest(kind="servo_dead", target="tail"), "target"),
        (topics.SIM_FAULT, sim.FaultRequest(kind="packet_loss", value=2.0), "value"),
        (topics.SIM_PUSH, sim.PushRequest(force=(1.0, 0.0, 0.0), duration=0.1, at_tick=0), "at_tick"),
        (topics.SIM_PUSH, sim.PushRequest(force=(1e9, 0.0, 0.0), duration=0.1), "force"),
        (topics.SIM_PLACE, sim.PlaceRequest(forward=50.0), "forward"),
        (topics.SIM_PLACE, sim.PlaceRequest(turn=1.0, at_tick=0), "at_tick"),
        (topics.SIM_RESTORE, sim.RestoreRequest(name="never"), "name"),
    ],
)
def test_refusals_name_the_field(bench: Bench, query: topics.Query[Any, Any], request_: Request, field: str) -> None:
    bench.run(ticks=3)
    with refused(CallError, field=field) as error:
        bench.ask(query, request_)
    assert error.value.code != "internal"
