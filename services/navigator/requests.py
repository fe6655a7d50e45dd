"""Requests of clients to the navigator: checked on arrival, carried out in a tick."""

import itertools
import math
from collections.abc import Callable
from typing import Any

import numpy as np

from surefoot.errors import Refusal
from surefoot.schemas import navigation as nav
from surefoot.schemas import topics
from surefoot.schemas.rows import Query
from surefoot.schemas.state import Odometry

from .belief.relocalise import placed
from .catalogue import Catalogue
from .goals import GaitView, NavigationGoal
from .localiser import Localiser
from .maps import Maps
from .marker import Dock
from .memory import Kept, is_covariance
from .pilot import Pilot
from .policy.decider import Decider

Log = Callable[[str, str], None]
STANDOFF = 0.10
"""Distance behind its last place at which a robot that docks on a marker measures it first, m."""


class Requests:
    """Handlers of the requests to the navigator between two resets of the simulation.

    Args:
        catalogue: policies by name.
        maps: obstacles that routes go around.
        localiser: belief of the pose.
        pilot: conducts the goals.
        log: writes a line of a level and a text.
        keep: writes the memory, called for every goal that is accepted.
    """

    def __init__(
        self, catalogue: Catalogue, maps: Maps, localiser: Localiser, pilot: Pilot, log: Log, keep: Callable[[], None]
    ) -> None:
        self.catalogue, self.maps, self.localiser, self.pilot = catalogue, maps, localiser, pilot
        self.log, self._keep = log, keep
        self.tick, self.now = -1, 0.0
        """`tick`: number of the last tick, -1 before the first; `now`: simulated time of that tick, s."""
        self.gait = GaitView("waiting")
        self.planned: list[tuple[int, NavigationGoal]] = []
        """Goals that wait for their start, each with the number of the tick at which it begins."""
        self._later: list[tuple[int, Callable[[], object]]] = []
        self._names = itertools.count(1)

    def goto(self, request: nav.GotoRequest) -> nav.GoalReply:
        """Accept or refuse a goal, one place in frame map or odom; it begins in the next tick, or at `at_tick`.

        Raises:
            Refusal: an unknown frame, a tick that has passed, a fallen or uncalibrated robot, an unknown policy, or a
                place that cannot be reached.
        """
        place = (*request.position, 0.0 if request.yaw is None else request.yaw)
        if request.frame == "odom":
            place = placed(self.localiser.map_from_odom, place)
        elif request.frame != "map":
            raise Refusal("unknown_frame", f"frame must be map or odom, got {request.frame!r}", "frame")
        return self._accept(request, (place[:2],), "position", (None if request.yaw is None else place[2],))

    def waypoints(self, request: nav.WaypointsRequest) -> nav.GoalReply:
        """Accept or refuse a goal with a list of places, to be reached one after the other, in one or more rounds.

        Raises:
            Refusal: another number of headings than of places, rounds over places that are one within the tolerance, a
                tick that has passed, a fallen or uncalibrated robot, an unknown policy, or a place that cannot be
                reached.
        """
        places, yaws = request.positions, request.yaws
        if len(yaws) not in (0, len(places)):
            text = f"yaws are one for each of the {len(places)} positions, or none, got {len(yaws)}"
            raise Refusal("invalid", text, "yaws")
        least = 2.0 * self.catalogue.model.conduct.waypoint_tolerance
        if request.loops != 1 and all(math.dist(places[0], place) <= least for place in places):
            raise Refusal("invalid", f"rounds go over places that are more than {least:g} m apart", "loops")
        return self._accept(request, places, "positions", yaws)

    def dock(self, request: nav.DockRequest) -> nav.GoalReply:
        """Accept or refuse a goal that docks on a marker: it leads to before the marker, then is led by its sight.

        Raises:
            Refusal: no camera, no such landmark, a marker without a position, an offset that the camera does not see, a
                tick that has passed, a fallen or uncalibrated robot, an unknown policy, or a place that cannot be
                reached.
        """
        world, model = self.maps.landmarks, self.catalogue.model
        if not self.catalogue.config.use_landmarks:
            raise Refusal("unsupported", "a robot that uses no landmarks docks on none")
        place, row = request.position, request.landmark
        if row is not None and (world is None or row >= len(world)):
            raise Refusal(
                "invalid", f"the map has {0 if world is None else len(world)} landmarks, got {row}", "landmark"
            )
        if place is None and world is not None and row is not None:
            place = (float(world.positions[row, 0]), float(world.positions[row, 1]))
        if place is None:
            raise Refusal("invalid", "the marker of the goal needs a position, landmarks have their own", "position")
        away, bearing = math.hypot(*request.offset), math.degrees(abs(math.atan2(*reversed(request.offset))))
        sight = model.sight
        if not (sight.range_min <= away <= sight.range_max and bearing <= sight.half_angle_deg):
            seen = f"{sight.range_min:g} to {sight.range_max:g} m away, {sight.half_angle_deg:g} deg aside"
            raise Refusal("invalid", f"the camera sees {seen}, got {request.offset}", "offset")
        here, conduct = self.localiser.tracker.pose, model.conduct
        toward = math.atan2(place[1] - here[1], place[0] - here[0]) if request.yaw is None else request.yaw
        before = placed((place[0], place[1], toward), (-request.offset[0] - STANDOFF, -request.offset[1], 0.0))
        dock = Dock(
            place, request.offset, row, request.yaw, request.xy_goal_tolerance or conduct.dock_xy,
            request.yaw_goal_tolerance or conduct.dock_yaw,
        )  # fmt: skip
        return self._accept(request, (before[:2],), "position", (toward,), dock)

    def _accept(
        self, request: nav.GotoRequest | nav.WaypointsRequest | nav.DockRequest, places: tuple[nav.Vec2, ...],
        field: str, yaws: tuple[float | None, ...], dock: Dock | None = None,
    ) -> nav.GoalReply:  # fmt: skip
        self._refuse_late(request.at_tick)
        if request.at_tick is None:
            self._refuse_unable()
        policy, conduct = self.catalogue.find(request.policy), self.catalogue.model.conduct
        here = self.localiser.tracker.pose[:2]
        ways = self.maps.ways(here, places, field)
        name, asked = request.goal_id or f"goal-{next(self._names)}", request.policy or self.catalogue.default
        goal = NavigationGoal(name, (), policy.name, self.now, start=here, asked=asked, places=places, dock=dock)
        if any(yaw is not None for yaw in yaws):
            goal.yaw, goal.yaws = yaws[-1], yaws if len(yaws) > 1 else ()
        goal.lead(ways, self.now)
        goal.xy_tolerance = (dock is None and request.xy_goal_tolerance) or conduct.xy_goal_tolerance
        goal.timeout = request.timeout or conduct.timeout
        goal.yaw_tolerance = (dock is None and request.yaw_goal_tolerance) or conduct.yaw_goal_tolerance
        goal.loops = getattr(request, "loops", 1)
        self.plan(self.tick + 1 if request.at_tick is None else request.at_tick, goal)
        self._keep()
        return nav.GoalReply(accepted=True, goal_id=goal.id, route=goal.route, length=goal.left(*here))

    def plan(self, tick: int, goal: NavigationGoal) -> None:
        """Schedule a goal to begin in the control tick `tick`."""
        self.planned.append((tick, goal))
        self._schedule(tick, lambda: self._begin(goal))

    def _begin(self, goal: NavigationGoal) -> None:
        self.planned = [item for item in self.planned if item[1] is not goal]
        goal.began, goal.start = self.now, self.localiser.tracker.pose[:2]
        self.pilot.begin(goal, self.decider(goal))
        self.log("info", f"goal {goal.id}: {len(goal.route)} waypoints, policy {goal.policy}")
        why = self.pilot.replan(goal, self.now, goal.start)
        if why:
            self.pilot.fail("unreachable", why)

    def decider(self, goal: NavigationGoal) -> Decider:
        """Return the chooser of a goal's actions, by its own policy, or by the default one if that is unusable."""
        try:
            return self.catalogue.decider(goal.asked)
        except Refusal as refusal:
            goal.asked, goal.policy = None, self.catalogue.find(None).name
            self.log("warning", f"goal {goal.id} goes on by the default policy {goal.policy}: {refusal.message}")
            return self.catalogue.decider(None)

    def cancel(self, request: nav.CancelRequest) -> nav.NavigatorReply:
        """End the present goal, at the tick that the request states, or now; the robot comes to stand on all feet."""
        return self._change(request, self.pilot.cancel, "no goal is under way", paused=None)

    def pause_goal(self, request: nav.PauseGoalRequest) -> nav.NavigatorReply:
        """Pause the present goal, at the tick that the request states, or now; the robot comes to stand."""
        return self._change(request, self.pilot.pause, "no goal is under way that is not paused", paused=False)

    def resume_goal(self, request: nav.ResumeGoalRequest) -> nav.NavigatorReply:
        """Resume the goal that is paused, at the tick that the request states, or now."""
        return self._change(request, self.pilot.go_on, "no goal is paused", paused=True)

    def _change(
        self, request: nav.CancelRequest, change: Callable[[], object], why: str, *, paused: bool | None
    ) -> nav.NavigatorReply:
        """Accept or refuse a change of the present goal, which takes place in a tick.

        Args:
            request: its tick, and the name of the goal if it means one only.
            change: carries it out.
            why: reason of the refusal where no goal is there to be changed now.
            paused: True, False = only a paused goal can be changed so, or only one that is not; None = either.

        Raises:
            Refusal: a tick that has passed.
        """
        self._refuse_late(request.at_tick)
        goal, able = self.pilot.goal, self.pilot.state == "navigating"
        able = able and goal is not None and paused in (None, goal.paused_at is not None)
        if request.at_tick is None and not able:
            return nav.NavigatorReply(accepted=False, reason=why)
        if request.goal_id is not None and goal is not None and request.goal_id != goal.id:
            return nav.NavigatorReply(accepted=False, reason=f"the goal is {goal.id!r}, not {request.goal_id!r}")
        self._schedule(request.at_tick, change)
        return nav.NavigatorReply(accepted=True)

    def set_pose(self, request: nav.SetPoseRequest) -> nav.NavigatorReply:
        """Set the believed pose of the robot to the one that a request states; the present goal continues.

        Raises:
            Refusal: a tick that has passed, a matrix that is no covariance, or a place in an obstacle or outside of the
                map.
        """
        self._refuse_late(request.at_tick)
        cov = None
        if request.covariance is not None:
            cov = np.array(request.covariance).reshape(3, 3)
            if not is_covariance(cov):
                text = f"covariance must be symmetric with no negative variance, got {request.covariance}"
                raise Refusal("invalid", text, "covariance")
        self.maps.refuse_blocked(request.pose[:2], "pose")
        self._schedule(request.at_tick, lambda: self.localiser.place(request.pose, cov))
        return nav.NavigatorReply(accepted=True)

    def policy(self, request: nav.PolicyRequest) -> nav.PolicyReply:
        """Return the default policy and the names of the others; make another the default if the request names one.

        Raises:
            Refusal: the policy cannot be used.
        """
        if request.use is not None:
            self.catalogue.choose(request.use)
        return self.catalogue.message()

    def kept(self) -> Kept:
        """Return the state that a restarted navigator needs to resume."""
        t, pilot = self.localiser.tracker, self.pilot
        return Kept.model_construct(
            number=pilot.orders.number, pose=t.pose, covariance=tuple(t.cov[:3, :3].ravel().tolist()),
            odom=self.localiser.odom, goal=pilot.goal, state=pilot.state, end=pilot.end, ended=pilot.ended,
            planned=tuple(self.planned),
        )  # fmt: skip

    def resume(self, kept: Kept, odometry: Odometry | None) -> None:
        """Resume from the state that an earlier navigator stored; `odometry`: the newest, None = none received."""
        pilot, pose = self.pilot, None
        if odometry is not None:
            pose = (odometry.position[0], odometry.position[1], odometry.yaw)
        self.localiser.resume(kept.pose, np.array(kept.covariance).reshape(3, 3), kept.odom, pose)
        pilot.orders.number = max(kept.number, self.gait.order)
        if kept.goal is not None:
            pilot.resume(kept.goal, self.decider(kept.goal), kept.state, kept.end)
            pilot.ended = kept.ended
        for tick, goal in kept.planned:
            self.plan(tick, goal)
        what = "goes on with its goal" if pilot.under_way else "no goal under way"
        self.log("info", f"started again in tick {self.tick}: {what}")

    def carry_out(self) -> None:
        """Execute the requests that are due in this tick."""
        for item in [item for item in self._later if item[0] <= self.tick]:
            self._later.remove(item)
            item[1]()

    def _schedule(self, at_tick: int | None, action: Callable[[], object]) -> None:
        self._later.append((self.tick + 1 if at_tick is None else at_tick, action))

    def _refuse_late(self, at_tick: int | None) -> None:
        if at_tick is not None and at_tick <= self.tick:
            text = f"at_tick {at_tick} has passed; the next tick is {self.tick + 1}"
            raise Refusal("late", text, "at_tick")

    def _refuse_unable(self) -> None:
        if self.gait.state == "waiting":
            raise Refusal("not_initialised", "the estimator has not finished its standstill calibration")
        if self.gait.state == "refused":
            raise Refusal("fallen", self.gait.reason or "the robot has fallen")


ANSWERS: tuple[tuple[Query[Any, Any], Callable[[Requests, Any], Any]], ...] = (
    (topics.NAVIGATOR_GOTO, Requests.goto),
    (topics.NAVIGATOR_WAYPOINTS, Requests.waypoints),
    (topics.NAVIGATOR_DOCK, Requests.dock),
    (topics.NAVIGATOR_CANCEL, Requests.cancel),
    (topics.NAVIGATOR_PAUSE, Requests.pause_goal),
    (topics.NAVIGATOR_RESUME, Requests.resume_goal),
    (topics.NAVIGATOR_SET_POSE, Requests.set_pose),
    (topics.NAVIGATOR_POLICY, Requests.policy),
    (topics.NAVIGATOR_MAP, lambda requests, _: requests.maps.message()),
)
"""Queries that the navigator answers, each with the handler of its request."""
