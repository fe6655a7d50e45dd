"""The navigator service: accepts goals, tracks the pose in the map, orders one action after another from the walker."""

from surefoot.lockstep.join import TickInputs
from surefoot.lockstep.service import Service
from surefoot.robot.reader import load_robot
from surefoot.schemas.hw import LandmarkDetections, Range
from surefoot.schemas.state import Odometry
from surefoot.schemas.topics import (
    HW_LANDMARKS,
    HW_RANGE,
    NAVIGATOR_FEEDBACK,
    NAVIGATOR_ORDER,
    STATE_GAIT,
    STATE_LANDMARKS,
    STATE_ODOMETRY,
    STATE_POSE,
    TERRAIN_LANDMARKS,
    TERRAIN_MAP,
)

from .aside import leading
from .belief.matching import DetectionError
from .catalogue import Catalogue, longest_blind_ns
from .config import NavigatorConfig
from .goals import GaitView
from .localiser import Localiser
from .maps import Maps
from .memory import GoalMemory
from .messages import feedback_message, fresh_of, order_message
from .pilot import Pilot
from .ranging import take_range
from .rehearsal import LARGE_SIDE, rehearse, rehearse_planning
from .requests import ANSWERS, Requests
from .results import Results
from .zoning import restrict


class Navigator(Service[NavigatorConfig]):
    """Service that localises the robot, chooses its next motion and leads it to goals."""

    name = "navigator"
    Config = NavigatorConfig
    inputs = (STATE_GAIT, STATE_ODOMETRY, HW_LANDMARKS, STATE_LANDMARKS, HW_RANGE, TERRAIN_MAP, TERRAIN_LANDMARKS)
    outputs = (NAVIGATOR_ORDER, STATE_POSE, NAVIGATOR_FEEDBACK)
    serves = tuple(query for query, _ in ANSWERS)

    def on_start(self) -> None:
        self.robot, self.catalogue = load_robot(self.config.robot), Catalogue(self.config)
        self.maps = Maps(self.config, self.catalogue.model.conduct)
        self.limits = {HW_LANDMARKS.key: longest_blind_ns(self.catalogue.model) if self.config.use_landmarks else 0}
        self.memory = GoalMemory(self.config.memory)
        self.on_reset()
        for query, answer in ANSWERS:
            self.handle(query, lambda request, answer=answer: answer(self.requests, request))

    def rehearse(self) -> None:
        rehearse(self.config)

    def rehearse_rare(self) -> None:
        rehearse_planning(LARGE_SIDE)

    def on_reset(self) -> None:
        self.localiser = Localiser(self.config, self.catalogue.model, self.log)
        self.maps.reset()
        self.results = Results(self.localiser)
        self.pilot = Pilot(
            self.catalogue.acts, commands=self.localiser.control == "commands", conduct=self.catalogue.model.conduct,
            ways=self.maps, record=self.results.record, aside=leading(self.localiser, self.maps),
        )  # fmt: skip
        self.requests = Requests(self.catalogue, self.maps, self.localiser, self.pilot, self.log, self._keep)
        self._epoch, self._blocked, self._close, self._noted = 0, False, False, ("idle", 0, 0, None)

    def on_tick(self, inputs: TickInputs) -> None:
        requests, localiser, pilot = self.requests, self.localiser, self.pilot
        first, requests.tick, self._epoch = requests.tick < 0, inputs.number, inputs.tick.epoch
        requests.now = self.results.now = now = inputs.tick.stamp_ns * 1e-9
        gait, odometry = inputs.get(STATE_GAIT), inputs.get(STATE_ODOMETRY)
        requests.gait = requests.gait if gait is None else GaitView.of(gait)
        for problem in self.maps.take(inputs.get(TERRAIN_MAP), inputs.get(TERRAIN_LANDMARKS)):
            self.log("error", problem)
        localiser.tracker.world = self.maps.landmarks
        if first and inputs.number > 0:
            self._recall(odometry)
        elif first:
            self.memory.forget()
        if odometry is not None and odometry.initialised:
            localiser.odometry(odometry, now)
        pilot.follow(now, requests.gait, localiser.tracker)
        self._take_sight(fresh_of(inputs.get(STATE_LANDMARKS)) or inputs.get(HW_LANDMARKS), inputs.get(HW_RANGE))
        localiser.search(standing=requests.gait.state == "standing")
        requests.carry_out()
        if gait is not None:
            at, lost, suspected = localiser.tracker, localiser.lost.lost, now < localiser.lost.suspected_until
            blocked = restrict(pilot, requests.gait, at, self.maps) or self._blocked
            pilot.tick(now, requests.gait, at, blocked=blocked, close=self._close, lost=lost, suspected=suspected)
        self.publish(NAVIGATOR_ORDER, order_message(pilot))
        if STATE_POSE.due(inputs.number):
            self.publish(STATE_POSE, localiser.message(now, ready=requests.gait.state != "waiting"))
            self.publish(NAVIGATOR_FEEDBACK, feedback_message(pilot, localiser.tracker.pose, now, self.results.last))
        self._keep()

    def _take_sight(self, seen: LandmarkDetections | None, echo: Range | None) -> None:
        if echo is not None:
            self._blocked, self._close = take_range(echo, self.localiser, self.maps, self.requests.now)
        if seen is None or not self.config.use_landmarks:
            return
        try:
            self.pilot.docking.see(seen, self.pilot.goal, self.localiser.tracker, self.requests.now)
            self.localiser.look(seen, self.requests.gait, self.requests.now, self.pilot.orders.match)
        except DetectionError as error:
            if self.localiser.refused[error.code] == 1:
                self.log("warning", f"landmarks refused: {error.message}")

    def _recall(self, odometry: Odometry | None) -> None:
        """Resume from the stored state of a navigator that was killed in this epoch."""
        kept = self.memory.recall(self._epoch, self.requests.tick)
        self._log_problem()
        if kept is None:
            self.pilot.orders.number = self.requests.gait.order
        else:
            self.requests.resume(kept, odometry)

    def _keep(self) -> None:
        """Store the state for a restart when orders or goals changed, and every second."""
        tick = self.requests.tick
        if self.memory.path is None or tick < 0:  # nothing is worth keeping before the first tick
            return
        goal = self.pilot.goal
        mark = (self.pilot.state, self.pilot.orders.number, len(self.requests.planned), goal and goal.paused_at)
        if mark != self._noted or tick % 100 == 0:
            self._noted = mark
            self.memory.keep(self._epoch, tick, self.requests.kept())
            self._log_problem()

    def _log_problem(self) -> None:
        if self.memory.problem:
            self.log("warning", self.memory.problem)
            self.memory.problem = ""


SERVICE = Navigator
