"""Handlers of the simulator's queries: time, worlds, disturbances, description of robot and simulator."""

from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Any

import mujoco

from surefoot.errors import Refusal
from surefoot.schemas import sim, topics
from surefoot.schemas.hw import DescriptionReply, DescriptionRequest
from surefoot.schemas.status import SimStatus, StatusRequest
from surefoot.schemas.terrain import HeightMapMessage, LandmarkMap, MapRequest
from surefoot.schemas.topics import Query

from .experiment import outcome_of
from .ground.terrain import KINDS, MAP_PROFILES
from .physics.disturb import too_strong
from .physics.faults import Fault, FaultError
from .physics.samples import Checkpoint
from .run import SimulatedRun
from .world import WorldError


class SimulatorQueries:
    """Handlers of the queries that the simulator serves: each returns the reply to one request."""

    def __init__(self, run: SimulatedRun) -> None:
        self.run = run
        self._saved: dict[str, tuple[Checkpoint, sim.ResetRequest]] = {}
        self._trials = ThreadPoolExecutor(1, "experiment")

    def handlers(self) -> tuple[tuple[Query[Any, Any], Callable[[Any], Any]], ...]:
        """Return each query with its handler."""
        return (
            (topics.SIM_RESET, self.reset), (topics.SIM_STEP, self.step), (topics.SIM_SPEED, self.speed),
            (topics.SIM_PAUSE, self.pause), (topics.SIM_PUSH, self.push), (topics.SIM_PLACE, self.place),
            (topics.SIM_SET, self.set), (topics.SIM_FAULT, self.fault), (topics.SIM_CHECKPOINT, self.checkpoint),
            (topics.SIM_RESTORE, self.restore), (topics.SIM_STATUS_GET, self.status),
            (topics.SIM_FEATURES, self.features), (topics.HW_DESCRIPTION, self.description),
            (topics.SIM_EXPERIMENT, self.experiment), (topics.TERRAIN_MAP_GET, self.heights),
            (topics.TERRAIN_LANDMARKS_GET, self.landmarks),
        )  # fmt: skip

    def close(self) -> None:
        """Cancel the trials on ground primitives that have not begun."""
        self._trials.shutdown(wait=False, cancel_futures=True)

    # -- worlds ------------------------------------------------------------------------------------------------

    def reset(self, request: sim.ResetRequest) -> sim.ResetReply:
        """Build the world of a request and begin a run in it; return the reply to `sim/reset`."""
        request = request.over(self.run.request)
        self.run.build(request)
        epoch = self.run.begin()
        name = self.run.world.terrain.name
        return sim.ResetReply(epoch=epoch, run_id=f"{name}-seed{request.seed}-epoch{epoch}")

    def checkpoint(self, request: sim.CheckpointRequest) -> sim.CheckpointReply:
        """Store the state of the simulated world under a name; return its hash, tick and epoch (run)."""
        saved = self.run.world.checkpoint()
        self._saved[request.name] = (saved, self.run.request)
        leader = self.run.driver.node.leader
        return sim.CheckpointReply(name=request.name, tick=leader.tick, epoch=leader.epoch, sha256=saved.sha256)

    def restore(self, request: sim.RestoreRequest) -> sim.CheckpointReply:
        """Restore the state of the world that was stored under a name, and begin a run (a new epoch) there."""
        if request.name not in self._saved:
            known = ", ".join(sorted(self._saved)) or "none"
            raise Refusal("unknown_checkpoint", f"no checkpoint {request.name!r}; there are: {known}", "name")
        saved, built_from = self._saved[request.name]
        if built_from is not self.run.request:
            self.run.build(built_from)
        self.run.world.restore(saved, restart=True)
        return sim.CheckpointReply(name=request.name, tick=-1, epoch=self.run.begin(), sha256=saved.sha256)

    def experiment(self, request: sim.ExperimentRequest) -> Future[sim.ExperimentReply]:
        """Run trials on ground primitives on a thread, each in a world of its own; return the future of the reply."""
        robot = self.run.robot

        def answer() -> sim.ExperimentReply:
            found = tuple(outcome_of(robot, trial) for trial in request.trials)
            return sim.ExperimentReply(robot=robot.name, robot_hash=robot.hash, outcomes=found)

        return self._trials.submit(answer)

    # -- time --------------------------------------------------------------------------------------------------

    def step(self, request: sim.StepRequest) -> sim.SimReply:
        """Resume simulated time after a pause, for a number of ticks or without end."""
        self.run.driver.node.resume(request.ticks)
        return self._accepted(self.run.driver.node.leader.tick)

    def speed(self, request: sim.SpeedRequest) -> sim.SimReply:
        """Change the real-time factor of a run in paced mode (raises Refusal: it is in lockstep)."""
        node = self.run.driver.node
        if node.leader.mode != "paced":
            raise Refusal("refused", "this run is in lockstep: it waits for its services, not for the clock", "rtf")
        node.pace.begin(request.rtf, node.leader.tick + 1)
        self.run.request = self.run.request.model_copy(update={"rtf": request.rtf})
        return self._accepted(node.leader.tick)

    def pause(self, request: sim.PauseRequest) -> sim.SimReply:
        """Stop simulated time after a tick; return the reply with that tick."""
        return self._accepted(self.run.driver.node.pause(request.at_tick, request.end))

    # -- disturbances ------------------------------------------------------------------------------------------

    def push(self, request: sim.PushRequest) -> sim.SimReply:
        """Plan a push, a force on a link for a time, and return the reply to `sim/push`."""
        names = ("trunk", *(link.name for link in self.run.robot.links))
        if request.body not in names:
            raise Refusal("invalid", f"no link {request.body!r}; known are {', '.join(names)}", "body")
        if wrong := too_strong(self.run.robot, request.force):
            raise Refusal("invalid", f"force: {wrong}", "force")
        return self._at(request.at_tick, lambda: self.run.world.push(request.force, request.duration, request.body))

    def place(self, request: sim.PlaceRequest) -> sim.SimReply:
        """Plan to move the standing robot to another place; a failure in a later tick is logged."""
        where = (request.forward, request.left, request.turn)
        if request.at_tick is None:
            try:
                self.run.world.displace(*where, only_ask=True)
            except WorldError as error:
                raise Refusal("refused", str(error), error.field) from None

        def put() -> None:
            try:
                self.run.world.displace(*where)
            except WorldError as error:
                self.run.driver.log("warning", f"the robot stays where it is: {error}")

        return self._at(request.at_tick, put)

    def set(self, request: sim.SetRequest) -> sim.SimReply:
        """Plan a change of friction, mass or servo gains at a tick; return the reply."""
        return self._at(request.at_tick, lambda: self.run.world.set(request.quantity, request.value))

    def fault(self, request: sim.FaultRequest) -> sim.SimReply:
        """Plan a fault of sensors, servos or packets from a tick on, which ends after its duration."""
        tick = self.run.tick_of(request.at_tick)
        # The world counts ticks from its own reset: after a restore it is ahead of the lockstep tick.
        ahead = self.run.world.tick - max(0, self.run.driver.node.leader.tick)
        start = tick + ahead + 1
        try:
            self.run.world.add_fault(Fault(request.kind, start, request.duration, request.target, request.value))
        except FaultError as error:
            raise Refusal("invalid", str(error), error.field) from None
        return self._accepted(tick)

    def _at(self, at_tick: int | None, action: Callable[[], None]) -> sim.SimReply:
        return self._accepted(self.run.plan(at_tick, action))

    def _accepted(self, tick: int) -> sim.SimReply:
        return sim.SimReply(accepted=True, tick=tick)

    # -- what it is --------------------------------------------------------------------------------------------

    def description(self, request: DescriptionRequest) -> DescriptionReply:
        """Return name and hash of the robot, its joints and feet in order."""
        r = self.run.robot
        return DescriptionReply(robot=r.name, hash=r.hash, joints=r.joint_names, feet=r.leg_names)

    def heights(self, request: MapRequest) -> HeightMapMessage:
        """Return the height map of the ground that the robot gets (raises Refusal: it gets none in this world)."""
        if self.run.built.heights is None:
            raise Refusal("refused", "the robot gets no map in this world: map_profile is none")
        return self.run.built.heights

    def landmarks(self, request: MapRequest) -> LandmarkMap:
        """Return the landmarks of the floor (raises Refusal: there are none, or the robot has no camera)."""
        if self.run.built.landmarks is None:
            raise Refusal("refused", "the terrain has no landmarks, or the robot no camera")
        return self.run.built.landmarks

    def status(self, request: StatusRequest) -> SimStatus:
        """Return the state of simulated time and of the run: tick, mode, real-time factor, reasons of a stop."""
        return self.run.status()

    def features(self, request: sim.FeaturesRequest) -> sim.FeaturesReply:
        """Return the terrains, faults, map profiles and queries of this simulator."""
        return sim.FeaturesReply(
            robot=self.run.robot.name,
            terrains=KINDS,
            faults=self.run.world.disturb.faults.possible,
            map_profiles=(*MAP_PROFILES, "none"),
            queries=tuple(query.key for query in self.run.driver.serves),
            version=mujoco.__version__,
        )
