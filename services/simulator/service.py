"""The simulator as a service: stands in for all hardware, owns simulated time, answers ``sim/*``."""

import time
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor

import mujoco
import numpy as np
from pydantic import Field

from surefoot.errors import Refusal
from surefoot.geometry.heightmap import HeightMapError
from surefoot.lockstep.config import ServiceConfig
from surefoot.lockstep.driver import Driver, DueSample
from surefoot.robot.reader import load_robot
from surefoot.schemas import sim
from surefoot.schemas.base import Message
from surefoot.schemas.hw import DescriptionReply, DescriptionRequest, EmergencyStop, JointCommand
from surefoot.schemas.terrain import LandmarkMap, MapRequest
from surefoot.schemas.topics import (
    CMD_ESTOP,
    HW_CONTACTS,
    HW_DESCRIPTION,
    HW_IMU,
    HW_JOINTS,
    HW_LANDMARKS,
    HW_RANGE,
    SIM_CHECKPOINT,
    SIM_EXPERIMENT,
    SIM_FAULT,
    SIM_FEATURES,
    SIM_JOIN,
    SIM_PAUSE,
    SIM_PLACE,
    SIM_PUSH,
    SIM_RESET,
    SIM_RESTORE,
    SIM_SET,
    SIM_SPEED,
    SIM_STATUS,
    SIM_STATUS_GET,
    SIM_STEP,
    SIM_TRUTH,
    TERRAIN_LANDMARKS,
    TERRAIN_LANDMARKS_GET,
    TERRAIN_MAP,
    TERRAIN_MAP_GET,
    Topic,
)

from . import world as worlds
from .experiment import outcome_of
from .ground.terrain import KINDS, MAP_PROFILES, TerrainError, observed_map
from .messages import (
    lacking,
    landmark_message,
    map_message,
    sample_messages,
    sight_messages,
    truth_message,
)
from .physics.command import CommandGuard
from .physics.faults import KINDS as FAULTS
from .physics.faults import Fault, FaultError
from .physics.model import Physics
from .physics.perturb import find_ground, perturbation
from .physics.samples import Checkpoint
from .sensors.sight import Floor
from .world import PhysicsWorld, WorldConfig, WorldError

STATUS_TICKS = 100
RATE_S = 0.5  # s wall, the least stretch over which the real-time factor is measured


class SimulatorConfig(ServiceConfig):
    """The world until the first ``sim/reset``, and how it runs."""

    expect: tuple[str, ...] = Field(default=(), description="services that must be ready before the first run begins")
    terrain: str = Field(default="flat", description="terrain of the first run")
    seed: int = Field(default=0, ge=0, lt=2**31, description="seed of the first run")
    autostart: bool = Field(default=True, description="begin a paced run at once instead of waiting for sim/reset")
    rtf: float = Field(default=1.0, ge=0, le=1000, description="real-time factor of that run, 0 = as fast as it goes")


class Simulator(Driver[SimulatorConfig]):
    """MuJoCo world behind the hardware contract."""

    name = "simulator"
    Config = SimulatorConfig
    outputs = (
        HW_IMU, HW_JOINTS, HW_CONTACTS, HW_LANDMARKS, HW_RANGE, SIM_TRUTH, TERRAIN_MAP, TERRAIN_LANDMARKS, SIM_STATUS,
    )  # fmt: skip
    observes = (CMD_ESTOP,)
    serves = (
        SIM_JOIN, HW_DESCRIPTION, TERRAIN_MAP_GET, SIM_RESET, SIM_STEP, SIM_PAUSE, SIM_SPEED, SIM_PUSH, SIM_PLACE,
        SIM_SET, SIM_FAULT, SIM_CHECKPOINT, SIM_RESTORE, SIM_STATUS_GET, SIM_FEATURES, SIM_EXPERIMENT,
        TERRAIN_LANDMARKS_GET,
    )  # fmt: skip

    def on_start(self) -> None:
        self.robot = load_robot(self.config.robot)
        self.guard = CommandGuard(self.robot.joint_lower, self.robot.joint_upper)
        self._later: list[tuple[int, Callable[[], None]]] = []
        self._saved: dict[str, tuple[Checkpoint, sim.ResetRequest]] = {}
        self._wall, self._rtf, self._late = (time.perf_counter(), 0), 0.0, False
        self._stopped = self._failed = ""
        self._aside = ThreadPoolExecutor(1, "experiment")
        for query, handler in (
            (SIM_RESET, self.reset), (SIM_STEP, self.step), (SIM_SPEED, self.speed), (SIM_PAUSE, self.pause),
            (SIM_PUSH, self.push), (SIM_PLACE, self.place), (SIM_SET, self.set), (SIM_FAULT, self.fault),
            (SIM_CHECKPOINT, self.checkpoint), (SIM_RESTORE, self.restore), (SIM_STATUS_GET, self.status),
            (SIM_FEATURES, self.features), (HW_DESCRIPTION, self.description), (SIM_EXPERIMENT, self.experiment),
            (TERRAIN_MAP_GET, lambda request: self._map), (TERRAIN_LANDMARKS_GET, self.landmarks),
        ):  # fmt: skip
            self.handle(query, handler)  # pyright: ignore[reportArgumentType] - each pair is of one row
        c = self.config
        self._request = sim.ResetRequest(
            seed=c.seed, world=sim.World(terrain=c.terrain), expect=c.expect, mode="paced", rtf=c.rtf
        )
        self._build(self._request)
        self._begin_on_first_work = c.autostart

    def on_stop(self) -> None:
        """Drop the trials that have not begun."""
        self._aside.shutdown(wait=False, cancel_futures=True)

    def rehearse(self) -> None:
        worlds.rehearse()

    def experiment(self, request: sim.ExperimentRequest) -> Future[sim.ExperimentReply]:
        """Trials on a thread and in worlds of their own."""

        def answer() -> sim.ExperimentReply:
            found = tuple(outcome_of(self.robot, trial) for trial in request.trials)
            return sim.ExperimentReply(robot=self.robot.name, robot_hash=self.robot.hash, outcomes=found)

        return self._aside.submit(answer)

    def on_begin(self) -> None:
        if self._begin_on_first_work:
            self._begin()

    # -- hardware ----------------------------------------------------------------------------------------------

    def on_status(self) -> None:
        self.publish(SIM_STATUS, self._status())

    def release(self, tick: int) -> list[DueSample]:
        if tick > 0 and tick % STATUS_TICKS == 0:
            self.publish(SIM_STATUS, self._status())
        return sample_messages(self.world.samples) + sight_messages(self.world.sight, self.world.stamp_ns)

    def reveal(self, tick: int) -> list[DueSample]:
        truth = self.world.truth()
        return [DueSample(SIM_TRUTH, lambda: truth_message(truth), truth.stamp_ns, tick)]

    def actuate(self, tick: int, command: JointCommand | None) -> None:
        if self._later:
            for item in [item for item in self._later if item[0] <= tick]:
                self._later.remove(item)
                item[1]()
        self._step(command)
        if self._failed or not self.world.diverged:
            return
        self._failed = (
            f"the physics diverged at {self.world.stamp_ns * 1e-9:.2f} s ({self.world.diverged}): the run ends"
        )
        self.log("error", self._failed)
        self.node.leader.end_tick = tick + 1
        self.publish(SIM_STATUS, self._status())

    def _step(self, command: JointCommand | None) -> None:
        if command is not None and command.position is not None and not self._stopped:
            limit = command.torque_limit
            self.world.step_tick(np.array(command.position), None if limit is None else np.array(limit))
            return
        self.world.step_tick(None)

    def latched(self) -> list[tuple[Topic, Message]]:  # pyright: ignore[reportMissingTypeArgument] - rows of any model
        landmarks = [] if self._landmarks is None else [(TERRAIN_LANDMARKS, self._landmarks)]
        return [(TERRAIN_MAP, self._map), *landmarks]

    def on_message(self, topic: Topic, message: Message) -> None:  # pyright: ignore[reportMissingTypeArgument]
        """Emergency stop: hold the joints where they are until the next reset; whoever asked is told at once."""
        if not isinstance(message, EmergencyStop):
            return
        if not self._stopped:
            self._stopped = message.reason or "no reason given"
            self.world.command = self.world.truth().joints
            self.log("warning", f"emergency stop at {self.world.stamp_ns * 1e-9:.2f} s: {self._stopped}")
        self.publish(SIM_STATUS, self._status())

    def check(self, command: JointCommand) -> None:
        if self._stopped:
            raise Refusal("stopped", f"joint command refused after the emergency stop: {self._stopped}", "position")
        if command.position is None:
            return
        limit = command.torque_limit
        if limit is not None and (len(limit) != self.robot.nj or min(limit) < 0.0):
            text = f"torque_limit must be {self.robot.nj} numbers >= 0 Nm, got {limit}"
            raise Refusal("torque_limit", f"joint command of tick {command.tick} refused: {text}", "torque_limit")
        reason = self.guard.offer(command.position, command.stamp_ns)
        if reason is not None:
            lower, upper = self.robot.joint_lower, self.robot.joint_upper
            worst = ""
            if reason == "out_of_range":
                q = np.array(command.position)
                i = int(np.argmax(np.maximum(q - upper, lower - q)))
                worst = f": {self.robot.joint_names[i]} = {q[i]:.4f} rad, allowed {lower[i]:.4f} to {upper[i]:.4f}"
            raise Refusal(reason, f"joint command of tick {command.tick} refused ({reason}){worst}", "position")

    # -- worlds ------------------------------------------------------------------------------------------------

    def _build(self, request: sim.ResetRequest) -> None:
        w = request.world
        try:
            seed = request.seed if w.terrain_seed is None else w.terrain_seed
            terrain = find_ground(w.terrain, seed, w.amplitude)
            physics = Physics() if w.friction is None else Physics(friction=w.friction)
            differs = perturbation(w.perturbation, request.seed, self.robot.nj, self.robot.kind)
            config = WorldConfig(
                physics=physics,
                perturbation=differs,
                imu_profile=w.imu_profile,
                torque_per_ampere=w.torque_per_ampere,
                floor=Floor(w.landmarks, w.goal, w.copied_landmarks, w.copies),
                camera=w.camera,
                start=(0.0, 0.0, 0.0) if w.start is None else w.start,
                drift=w.drift,
            )
            self.world = PhysicsWorld(self.robot, terrain, request.seed, config)
            heights = observed_map(terrain, w.map_profile, request.seed)
        except (TerrainError, WorldError, HeightMapError) as error:
            field = "start" if error.field == "pose" else error.field
            raise Refusal("invalid", str(error), f"world.{field}") from None
        field = None if self.world.sight is None else self.world.sight.landmarks
        self._landmarks = None if field is None else landmark_message(field, request.seed)
        self.lacking = lacking(self.world.sight)
        self._map = map_message(heights.with_z(heights.z, version=1), terrain, w.map_profile)
        self._request = request

    def _begin(self) -> int:
        r = self._request
        self._begin_on_first_work = False
        self.guard.clear()
        self._stopped = self._failed = ""
        self._later.clear()
        epoch = self.node.begin(r.expect, r.mode, r.rtf, r.actuation_delay_ticks, r.policy, r.seed)
        self.node.leader.end_tick = None if r.max_ticks is None else r.max_ticks - 1
        self.node.leader.pause_tick = 0 if r.paused else None
        self._wall, self._rtf, self._late = (time.perf_counter(), 0), 0.0, False
        return epoch

    def reset(self, request: sim.ResetRequest) -> sim.ResetReply:
        """Builds the world and raises the epoch."""
        request = request.over(self._request)
        self._build(request)
        epoch = self._begin()
        return sim.ResetReply(epoch=epoch, run_id=f"{self.world.terrain.name}-seed{request.seed}-epoch{epoch}")

    def checkpoint(self, request: sim.CheckpointRequest) -> sim.CheckpointReply:
        """Stores the world under a name."""
        saved = self.world.checkpoint()
        self._saved[request.name] = (saved, self._request)
        leader = self.node.leader
        return sim.CheckpointReply(name=request.name, tick=leader.tick, epoch=leader.epoch, sha256=saved.sha256)

    def restore(self, request: sim.RestoreRequest) -> sim.CheckpointReply:
        """Takes the world back; a new epoch begins there."""
        if request.name not in self._saved:
            known = ", ".join(sorted(self._saved)) or "none"
            raise Refusal("unknown_checkpoint", f"no checkpoint {request.name!r}; there are: {known}", "name")
        saved, built_from = self._saved[request.name]
        if built_from is not self._request:
            self._build(built_from)
        self.world.restore(saved, restart=True)
        epoch = self._begin()
        return sim.CheckpointReply(name=request.name, tick=-1, epoch=epoch, sha256=saved.sha256)

    # -- time --------------------------------------------------------------------------------------------------

    def step(self, request: sim.StepRequest) -> sim.SimReply:
        """Goes on after a pause."""
        self.node.resume(request.ticks)
        return self._accepted(None)

    def speed(self, request: sim.SpeedRequest) -> sim.SimReply:
        """Changes the pace."""
        leader = self.node.leader
        if leader.mode != "paced":
            raise Refusal("refused", "this run is in lockstep: it waits for its services, not for the clock", "rtf")
        self.node.pace.begin(request.rtf, leader.tick + 1)
        self._request = self._request.model_copy(update={"rtf": request.rtf})
        return self._accepted(None)

    def pause(self, request: sim.PauseRequest) -> sim.SimReply:
        """Stops simulated time after a tick."""
        return self._accepted(self.node.pause(request.at_tick, request.end))

    # -- disturbances ------------------------------------------------------------------------------------------

    def push(self, request: sim.PushRequest) -> sim.SimReply:
        """Pulls at a link."""
        names = ("trunk", *(link.name for link in self.robot.links))
        if request.body not in names:
            raise Refusal("invalid", f"no link {request.body!r}; known are {', '.join(names)}", "body")
        return self._at(request.at_tick, lambda: self.world.push(request.force, request.duration, request.body))

    def place(self, request: sim.PlaceRequest) -> sim.SimReply:
        """Puts the standing robot elsewhere; one at a later tick that cannot be done then is logged."""
        where = (request.forward, request.left, request.turn)
        if request.at_tick is None:
            try:
                self.world.displace(*where, only_ask=True)
            except WorldError as error:
                raise Refusal("refused", str(error), error.field) from None

        def put() -> None:
            try:
                self.world.displace(*where)
            except WorldError as error:
                self.log("warning", f"the robot stays where it is: {error}")

        return self._at(request.at_tick, put)

    def set(self, request: sim.SetRequest) -> sim.SimReply:
        """Changes the world."""
        return self._at(request.at_tick, lambda: self.world.set(request.quantity, request.value))

    def fault(self, request: sim.FaultRequest) -> sim.SimReply:
        """Breaks something for a while."""
        tick = self._tick(request.at_tick)
        # The world counts ticks from its own reset: after a restore it is ahead of the lockstep tick.
        ahead = self.world.tick - max(0, self.node.leader.tick)
        start = tick + ahead + 1
        try:
            self.world.add_fault(Fault(request.kind, start, request.duration, request.target, request.value))
        except FaultError as error:
            raise Refusal("invalid", str(error), error.field) from None
        return self._accepted(tick)

    def _tick(self, at_tick: int | None) -> int:
        coming = self.node.leader.tick + 1
        if at_tick is None:
            return coming
        if at_tick < coming:
            raise Refusal("late", f"at_tick {at_tick} has passed; the next tick is {coming}", "at_tick")
        return at_tick

    def _at(self, at_tick: int | None, action: Callable[[], None]) -> sim.SimReply:
        tick = self._tick(at_tick)
        self._later.append((tick, action))
        return self._accepted(tick)

    def _accepted(self, tick: int | None) -> sim.SimReply:
        return sim.SimReply(accepted=True, tick=self.node.leader.tick if tick is None else tick)

    # -- what it is --------------------------------------------------------------------------------------------

    def description(self, request: DescriptionRequest) -> DescriptionReply:
        """Which robot this hardware is."""
        r = self.robot
        return DescriptionReply(robot=r.name, hash=r.hash, joints=r.joint_names, feet=r.leg_names)

    def landmarks(self, request: MapRequest) -> LandmarkMap:
        """The latched landmarks."""
        if self._landmarks is None:
            raise Refusal("refused", "the terrain has no landmarks, or the robot no camera")
        return self._landmarks

    def status(self, request: sim.StatusRequest) -> sim.SimStatus:
        """How time runs, now."""
        return self._status()

    def features(self, request: sim.FeaturesRequest) -> sim.FeaturesReply:
        """What can be asked."""
        return sim.FeaturesReply(
            robot=self.robot.name, terrains=KINDS, faults=FAULTS, map_profiles=MAP_PROFILES,
            queries=tuple(query.key for query in self.serves), version=mujoco.__version__,
        )  # fmt: skip

    def _status(self) -> sim.SimStatus:
        leader = self.node.leader
        now, tick = time.perf_counter(), leader.tick
        wall, before = now - self._wall[0], tick - self._wall[1]
        if wall > RATE_S:
            self._wall, self._late = (now, tick), self.node.pace.late()
            self._rtf = before * worlds.TICK_NS * 1e-9 / wall if before > 0 else 0.0
        held = f"emergency stop: {self._stopped}" if self._stopped else ""
        if self.node.held and not held:
            held = "no command was accepted for 100 ms"
        return sim.SimStatus(
            state=leader.state, rtf=self._rtf, ticks=tick + 1, comparable=leader.comparable, missing=leader.missing(),
            detail=leader.reason, stopped=self._stopped, failed=self._failed or self.node.gave_up,
            tick=max(-1, tick), epoch=leader.epoch, mode=leader.mode, pace=self.node.pace.factor, late=self._late,
            held=held,
        )  # fmt: skip


SERVICE = Simulator
