"""The navigator service: takes goals, tracks the pose in the map, orders one action after another from the walker."""

import itertools
from typing import Any

import numpy as np

from surefoot.errors import Refusal
from surefoot.lockstep.join import TickInputs
from surefoot.lockstep.service import Service
from surefoot.robot.reader import load_robot
from surefoot.schemas import navigation as nav
from surefoot.schemas.hw import LandmarkDetections, Range
from surefoot.schemas.topics import (
    HW_LANDMARKS,
    HW_RANGE,
    NAVIGATOR_CANCEL,
    NAVIGATOR_FEEDBACK,
    NAVIGATOR_GOTO,
    NAVIGATOR_MAP,
    NAVIGATOR_ORDER,
    NAVIGATOR_POLICY,
    NAVIGATOR_SET_POSE,
    NAVIGATOR_WAYPOINTS,
    STATE_GAIT,
    STATE_ODOMETRY,
    STATE_POSE,
    TERRAIN_LANDMARKS,
    TERRAIN_MAP,
)

from . import messages
from .belief.matching import DetectionError
from .config import NavigatorConfig
from .goals import GaitView, Goal
from .localiser import Localiser
from .memory import Kept, Memory
from .pilot import Pilot
from .planning.rehearsing import rehearse_planning
from .policies import Policies, longest_blind_ns
from .policy.policies import Decider
from .rehearsal import rehearse
from .world import World

BLOCKED_M = 0.38
"""An echo nearer than this forbids walking ahead (the collision rule of Osswald et al.: only rotations then)."""


class Navigator(Service[NavigatorConfig]):
    """Localisation, policy and goals."""

    name = "navigator"
    Config = NavigatorConfig
    inputs = (STATE_GAIT, STATE_ODOMETRY, HW_LANDMARKS, HW_RANGE, TERRAIN_MAP, TERRAIN_LANDMARKS)
    outputs = (NAVIGATOR_ORDER, STATE_POSE, NAVIGATOR_FEEDBACK)
    serves = (
        NAVIGATOR_GOTO, NAVIGATOR_WAYPOINTS, NAVIGATOR_CANCEL, NAVIGATOR_SET_POSE, NAVIGATOR_MAP, NAVIGATOR_POLICY,
    )  # fmt: skip

    def on_start(self) -> None:
        self.robot = load_robot(self.config.robot)
        self.policies = Policies(self.config)
        self.limits = {HW_LANDMARKS.key: longest_blind_ns(self.policies.model) if self.config.use_landmarks else 0}
        self.world = World(self.config)
        self.memory: Memory = Memory(self.config.memory)
        self.on_reset()
        self.handle(NAVIGATOR_GOTO, self.goto)
        self.handle(NAVIGATOR_WAYPOINTS, self.waypoints)
        self.handle(NAVIGATOR_CANCEL, self.cancel)
        self.handle(NAVIGATOR_SET_POSE, self.set_pose)
        self.handle(NAVIGATOR_MAP, self.map)
        self.handle(NAVIGATOR_POLICY, self.policy)

    def rehearse(self) -> None:
        rehearse(self.config)

    def rehearse_rare(self) -> None:
        rehearse_planning(large=True)

    def on_reset(self) -> None:
        self.localiser = Localiser(self.config, self.policies.model)
        self.pilot = Pilot(self.policies.acts, commands=self.localiser.control == "commands")
        self.world.reset()
        self._later: list[tuple[int, Any]] = []
        self._planned: list[tuple[int, Goal]] = []
        self._tick, self._now, self._epoch = -1, 0.0, 0
        self._gait = GaitView("waiting")
        self._blocked = False
        self._names = itertools.count(1)
        self._noted = ("idle", 0, 0)

    # -- requests ----------------------------------------------------------------------------------------------

    def goto(self, request: nav.GotoRequest) -> nav.GoalReply:
        """Accept or refuse a goal; it is taken up in the next tick, or at `at_tick`."""
        place = (*request.position, 0.0 if request.yaw is None else request.yaw)
        if request.frame == "odom":
            place = messages.placed(self.localiser.map_from_odom, place)
        elif request.frame != "map":
            raise Refusal("unknown_frame", f"frame must be map or odom, got {request.frame!r}", "frame")
        return self._accept(request, (place[:2],), None if request.yaw is None else place[2])

    def waypoints(self, request: nav.WaypointsRequest) -> nav.GoalReply:
        """Accept or refuse a list of places."""
        return self._accept(request, request.positions, None)

    def _accept(
        self, request: nav.GotoRequest | nav.WaypointsRequest, places: tuple[nav.Vec2, ...], yaw: float | None
    ) -> nav.GoalReply:
        self._refuse_late(request.at_tick)
        if request.at_tick is None:
            self._refuse_unable()
        policy = self.policies.find(request.policy)
        here = self.localiser.tracker.pose[:2]
        field = "position" if isinstance(request, nav.GotoRequest) else "positions"
        route = self.world.route(here, places, field)
        asked = request.policy or self.policies.default
        goal = Goal(
            request.goal_id or f"goal-{next(self._names)}", route, policy.name, self._now, yaw, start=here, asked=asked
        )
        self._plan(self._tick + 1 if request.at_tick is None else request.at_tick, goal)
        self._keep()
        return nav.GoalReply(accepted=True, goal_id=goal.id, route=route, length=goal.left(*here))

    def _plan(self, tick: int, goal: Goal) -> None:
        self._planned.append((tick, goal))
        self._schedule(tick, lambda: self._begin(goal))

    def _begin(self, goal: Goal) -> None:
        self._planned = [item for item in self._planned if item[1] is not goal]
        goal.began, goal.start = self._now, self.localiser.tracker.pose[:2]
        self.pilot.begin(goal, self._decider(goal))
        self.log("info", f"goal {goal.id}: {len(goal.route)} waypoints, policy {goal.policy}")

    def _decider(self, goal: Goal) -> Decider:
        try:
            return self.policies.decider(goal.asked)
        except Refusal as refusal:  # of a goal that was kept: the file of its policy has gone since
            goal.asked, goal.policy = None, self.policies.find(None).name
            self.log("warning", f"goal {goal.id} goes on by the default policy {goal.policy}: {refusal.message}")
            return self.policies.decider(None)

    def cancel(self, request: nav.CancelRequest) -> nav.NavigatorReply:
        """End the present goal on both feet."""
        self._refuse_late(request.at_tick)
        goal = self.pilot.goal
        if request.at_tick is None and (goal is None or self.pilot.state != "navigating"):
            return nav.NavigatorReply(accepted=False, reason="no goal is under way")
        if request.goal_id is not None and goal is not None and request.goal_id != goal.id:
            return nav.NavigatorReply(accepted=False, reason=f"the goal is {goal.id!r}, not {request.goal_id!r}")
        self._schedule(request.at_tick, self.pilot.cancel)
        return nav.NavigatorReply(accepted=True)

    def set_pose(self, request: nav.SetPoseRequest) -> nav.NavigatorReply:
        """Begin anew at a stated pose."""
        self._refuse_late(request.at_tick)
        cov = None
        if request.covariance is not None:
            cov = np.array(request.covariance).reshape(3, 3)
            if not is_covariance(cov):
                text = f"covariance must be symmetric with no negative variance, got {request.covariance}"
                raise Refusal("invalid", text, "covariance")
        self.world.refuse_blocked(request.pose[:2], "pose")
        self._schedule(request.at_tick, lambda: self.localiser.place(request.pose, cov))
        return nav.NavigatorReply(accepted=True)

    def map(self, request: nav.NavigatorMapRequest) -> nav.OccupancyGrid:
        """Return the occupancy grid that routes are planned on."""
        return self.world.message()

    def policy(self, request: nav.PolicyRequest) -> nav.PolicyReply:
        """Return the default policy and those that ship; choose another."""
        if request.use is not None:
            self.policies.choose(request.use)
        return self.policies.message()

    def _refuse_late(self, at_tick: int | None) -> None:
        if at_tick is not None and at_tick <= self._tick:
            text = f"at_tick {at_tick} has passed; the next tick is {self._tick + 1}"
            raise Refusal("late", text, "at_tick")

    def _refuse_unable(self) -> None:
        state = self._gait.state
        if state == "waiting":
            raise Refusal("not_initialised", "the estimator has not finished its standstill calibration")
        if state == "refused":
            raise Refusal("fallen", self._gait.reason or "the robot has fallen")

    def _schedule(self, at_tick: int | None, action: Any) -> None:
        self._later.append((self._tick + 1 if at_tick is None else at_tick, action))

    # -- ticks -------------------------------------------------------------------------------------------------

    def on_tick(self, inputs: TickInputs) -> None:
        first, self._tick, self._epoch = self._tick < 0, inputs.number, inputs.tick.epoch
        self._now = inputs.tick.stamp_ns * 1e-9
        gait, odometry = inputs.get(STATE_GAIT), inputs.get(STATE_ODOMETRY)
        if gait is not None:
            self._gait = GaitView(
                gait.state, gait.walk_id, gait.order, gait.order_refused, gait.ends_in_s, gait.reason
            )  # fmt: skip
        self._take_world(inputs)
        if first and inputs.number > 0:
            self._recall(odometry)
        elif first:
            self.memory.forget()
        if odometry is not None and odometry.initialised:
            self.localiser.odometry(odometry.position[0], odometry.position[1], odometry.yaw, self._now)
        self.pilot.follow(self._now, self._gait, self.localiser.tracker)
        self._take_sight(inputs.get(HW_LANDMARKS), inputs.get(HW_RANGE))
        for item in [item for item in self._later if item[0] <= inputs.number]:
            self._later.remove(item)
            item[1]()
        if gait is not None:
            tracker, lost = self.localiser.tracker, self.localiser.lost.lost
            self.pilot.tick(self._now, self._gait, tracker, blocked=self._blocked, lost=lost)
        self.publish(NAVIGATOR_ORDER, messages.order_message(self.pilot))
        if STATE_POSE.due(inputs.number):
            self.publish(STATE_POSE, self.localiser.message(ready=self._gait.state != "waiting"))
            self.publish(
                NAVIGATOR_FEEDBACK,
                messages.feedback_message(self.pilot, self.localiser.tracker.pose, self._now),
            )
        self._keep()

    def _take_world(self, inputs: TickInputs) -> None:
        for problem in self.world.take(inputs.get(TERRAIN_MAP), inputs.get(TERRAIN_LANDMARKS)):
            self.log("error", problem)
        self.localiser.tracker.world = self.world.landmarks

    def _take_sight(self, seen: LandmarkDetections | None, reach: Range | None) -> None:
        if reach is not None:
            near = reach.distance is not None and reach.distance <= max(BLOCKED_M, reach.shortest)
            self._blocked = near or any(reach.bump)
        if seen is None or not self.config.use_landmarks:
            return
        try:
            self.localiser.look(seen, self._gait, self._now)
        except DetectionError as error:
            if self.localiser.refused[error.code] == 1:
                self.log("warning", f"hw/landmarks refused: {error.message}")

    def _recall(self, odometry: Any) -> None:
        kept = self.memory.recall(self._epoch, self._tick)
        self._log_problem()
        if kept is None:
            self.pilot.number = self._gait.order
            return
        pose = None if odometry is None else (odometry.position[0], odometry.position[1], odometry.yaw)
        self.localiser.resume(kept.pose, np.array(kept.covariance).reshape(3, 3), kept.odom, pose)
        self.pilot.number = max(kept.number, self._gait.order)
        if kept.goal is not None:
            self.pilot.resume(kept.goal, self._decider(kept.goal), kept.state, kept.end)
            self.pilot.ended = kept.ended
        for tick, goal in kept.planned:
            self._plan(tick, goal)
        what = "goes on with its goal" if self.pilot.state in ("navigating", "stopping") else "no goal under way"
        self.log("info", f"started again in tick {self._tick}: {what}")

    def _keep(self) -> None:
        if self.memory.path is None or self._tick < 0:  # before the first tick nothing is worth keeping
            return
        mark = (self.pilot.state, self.pilot.number, len(self._planned))
        if mark == self._noted and self._tick % 100 != 0:
            return
        self._noted = mark
        t = self.localiser.tracker
        self.memory.keep(
            self._epoch, self._tick,
            Kept(
                self.pilot.number, t.pose, tuple(t.cov[:3, :3].ravel().tolist()), self.localiser.odom,
                self.pilot.goal, self.pilot.state, self.pilot.end, self.pilot.ended, tuple(self._planned),
            ),
        )  # fmt: skip
        self._log_problem()

    def _log_problem(self) -> None:
        if self.memory.problem:
            self.log("warning", self.memory.problem)
            self.memory.problem = ""


def is_covariance(cov: np.ndarray[Any, Any]) -> bool:
    """Return whether a (3, 3) matrix can be a covariance: symmetric, its leading minors not negative."""
    if not np.allclose(cov, cov.T, atol=1e-12):
        return False
    a, b, c, d, e, f = cov[0, 0], cov[0, 1], cov[0, 2], cov[1, 1], cov[1, 2], cov[2, 2]
    det = a * (d * f - e * e) - b * (b * f - e * c) + c * (b * e - d * c)
    pairs = (a * d - b * b, a * f - c * c, d * f - e * e)
    return bool(min(a, d, f) >= 0.0 and min(pairs) >= -1e-15 and det >= -1e-15)


SERVICE = Navigator
