"""Present run of the simulator: its world, actions planned for later ticks, reason of a stop, real-time factor."""

import time
from collections.abc import Callable
from typing import Any

import numpy as np

from surefoot.errors import Refusal
from surefoot.lockstep.driver import Driver
from surefoot.robot.description import Robot
from surefoot.schemas import sim
from surefoot.schemas.hw import JointCommand
from surefoot.schemas.status import SimStatus
from surefoot.schemas.topics import SIM_STATUS, TICK_S

from .building import build_world
from .physics.command import CommandGuard
from .world import PhysicsWorld

RATE_S = 0.5  # s wall, the least stretch over which the real-time factor is measured


class SimulatedRun:
    """Present run of the simulator: world, planned actions and state of time; a reset begins a new run (epoch).

    Args:
        driver: service that publishes, logs and owns the lockstep node.
        robot: the description; read only.
        request: request whose world is used until the first reset.
    """

    def __init__(self, driver: Driver[Any], robot: Robot, request: sim.ResetRequest) -> None:
        self.driver, self.robot = driver, robot
        self.guard = CommandGuard(robot.joint_lower, robot.joint_upper)
        self.planned: list[tuple[int, Callable[[], None]]] = []
        """Planned actions, each with the tick at whose end it is to run."""
        self._clear()
        self.build(request)

    def _clear(self) -> None:
        self.planned.clear()
        self.stopped = ""
        """Reason of the emergency stop in force; empty = no stop is in force."""
        self.failed = ""
        """Reason why the physics cannot continue; empty = it continues."""
        self._wall, self._rtf, self._late = (time.perf_counter(), 0), 0.0, False

    @property
    def world(self) -> PhysicsWorld:
        """The world of this run."""
        return self.built.world

    @property
    def seconds(self) -> float:
        """Simulated time since the beginning of the run, s."""
        return self.world.stamp_ns * 1e-9

    def build(self, request: sim.ResetRequest) -> None:
        """Replace the world by that of a request (raises Refusal: it cannot be built)."""
        self.built = build_world(self.robot, request)
        self.request = request
        self.driver.lacking = self.built.lacking

    def begin(self) -> int:
        """Begin a run from tick 0 in the present world; return its number, the epoch."""
        r, node = self.request, self.driver.node
        self._clear()
        epoch = node.begin(r.expect, r.mode, r.rtf, r.actuation_delay_ticks, r.policy, r.seed)
        node.leader.end_tick = None if r.max_ticks is None else r.max_ticks - 1
        node.leader.pause_tick = 0 if r.paused else None
        return epoch

    # -- time --------------------------------------------------------------------------------------------------

    def step(self, tick: int, command: JointCommand | None) -> None:
        """Do the actions planned for a tick, then advance the world by it; command None = the joints are held."""
        if self.planned:
            for item in [item for item in self.planned if item[0] <= tick]:
                self.planned.remove(item)
                item[1]()
        if command is not None and command.position is not None and not self.stopped:
            limit = command.torque_limit
            self.world.step_tick(np.array(command.position), None if limit is None else np.array(limit))
        else:
            self.world.step_tick(None)
        if self.failed or not self.world.diverged:
            return
        self.failed = f"the physics diverged at {self.seconds:.2f} s ({self.world.diverged}): the run ends"
        self.driver.log("error", self.failed)
        self.driver.node.leader.end_tick = tick + 1
        self.driver.publish(SIM_STATUS, self.status())

    def tick_of(self, at_tick: int | None) -> int:
        """Return the tick for `at_tick` of a request, None = the next one (raises Refusal: it has passed)."""
        coming = self.driver.node.leader.tick + 1
        if at_tick is None:
            return coming
        if at_tick < coming:
            raise Refusal("late", f"at_tick {at_tick} has passed; the next tick is {coming}", "at_tick")
        return at_tick

    def plan(self, at_tick: int | None, action: Callable[[], None]) -> int:
        """Plan an action for the end of a tick, None = the next one; return the tick (raises Refusal: too late)."""
        tick = self.tick_of(at_tick)
        self.planned.append((tick, action))
        return tick

    def status(self) -> SimStatus:
        """Return the state of time and of the run, with the real-time factor over at least 0.5 s."""
        node, leader, pace = self.driver.node, self.driver.node.leader, self.driver.node.pace
        now, tick = time.perf_counter(), leader.tick
        wall, before = now - self._wall[0], tick - self._wall[1]
        if wall > RATE_S:
            self._wall, self._late = (now, tick), pace.late()
            self._rtf = before * TICK_S / wall if before > 0 else 0.0
        held = f"emergency stop: {self.stopped}" if self.stopped else ""
        if node.held and not held:
            held = "no command was accepted for 100 ms"
        return SimStatus(
            state=leader.state, rtf=self._rtf, ticks=tick + 1, comparable=leader.comparable, missing=leader.missing(),
            detail=leader.reason, stopped=self.stopped, failed=self.failed or node.gave_up,
            tick=max(-1, tick), epoch=leader.epoch, mode=leader.mode, pace=pace.factor, late=self._late,
            held=held,
        )  # fmt: skip

    # -- commands ----------------------------------------------------------------------------------------------

    def stop(self, reason: str) -> None:
        """Hold the joints where they are until the next reset; the first reason counts."""
        if not self.stopped:
            self.stopped = reason or "no reason given"
            self.world.command = self.world.truth().joints
            self.driver.log("warning", f"emergency stop at {self.seconds:.2f} s: {self.stopped}")

    def check(self, command: JointCommand) -> None:
        """Raise Refusal for a command that the servos must not follow."""
        if self.stopped:
            raise Refusal("stopped", f"joint command refused after the emergency stop: {self.stopped}", "position")
        if command.position is None:
            return
        limit = command.torque_limit
        if limit is not None and (len(limit) != self.robot.nj or min(limit) < 0.0):
            text = f"torque_limit must be {self.robot.nj} numbers >= 0 Nm, got {limit}"
            raise Refusal("torque_limit", f"joint command of tick {command.tick} refused: {text}", "torque_limit")
        reason = self.guard.refusal(command.position)
        if reason is not None:
            lower, upper = self.robot.joint_lower, self.robot.joint_upper
            worst = ""
            if reason == "out_of_range":
                q = np.array(command.position)
                i = int(np.argmax(np.maximum(q - upper, lower - q)))
                worst = f": {self.robot.joint_names[i]} = {q[i]:.4f} rad, allowed {lower[i]:.4f} to {upper[i]:.4f}"
            raise Refusal(reason, f"joint command of tick {command.tick} refused ({reason}){worst}", "position")
