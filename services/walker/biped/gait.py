"""The biped walker: one call per control tick, from estimates and joints to servo set-points.

WAIT (no joints) -> RISE -> STAND <-> START -> STEP ...; FOLD -> FALLEN if it falls. The plan is open loop in odom:
footsteps, a ZMP reference with double support, preview control, CoM iteration over all links, closed-form legs,
compensation of the servos' sag and lag. Feedback: the trunk's rate at the standing ankles, and its unplanned tilt,
which sets the swinging foot down and shortens the next step.
"""

import math
from dataclasses import replace

import numpy as np

from surefoot.arrays import Array
from surefoot.geometry.heightmap import HeightMap
from surefoot.robot import kinematics
from surefoot.robot.description import Robot
from surefoot.schemas.topics import TICK_S

from ..commands import refusal_of
from ..interface import CommandReply, MotionCommand, WalkerInputs, WalkerOutputs
from ..memory import WalkMemory
from . import feedback
from . import route as routes
from .ik import leg_geometry
from .params import GAITS, BipedParams, abilities
from .plan import LEFT, RIGHT, between, placed, reference, support_point, swing
from .preview import HORIZON, preview_gains, preview_step
from .report import ends_in_s, outputs
from .route import route_of, upcoming
from .servos import SetPoints
from .state import AcceptedCommand, BipedState, Mode

LATE_TICKS = 25
"""Number of ticks before the last landing within which a new command waits until the robot stands: one in the last 0.1
s that was laid into the plan at once toppled Nao."""
STALE = "the estimate is stale or absent: the walk waits for it"


class BipedWalker:
    """Gait of a robot with two legs of six joints.

    Args:
        robot: description; its legs in the order left, right.
        params: settings; None = the robot's own.
    """

    def __init__(self, robot: Robot, params: BipedParams | None = None) -> None:
        self.robot = robot
        self.params = p = params or BipedParams.for_robot(robot)
        self.geometry = g = leg_geometry(robot)
        self.width = float(abs(g.hip[0, 1]))
        self._own = p
        self._take_params(p)
        self.state = BipedState(robot.nj)
        feet = np.array([[0.0, self.width, 0.0, 0.0], [0.0, -self.width, 0.0, 0.0]])
        self.servos = SetPoints(robot, g, p, feet, self._middle(feet))
        self.gains = preview_gains(self.servos.com_height, TICK_S)

    def _params_of(self, gait: str) -> BipedParams:
        own = self._own
        quick = {"step_s": own.quick_s, "step_m": own.quick_m}
        return own if gait == GAITS[0] else own.model_copy(update=quick)

    def _take_params(self, params: BipedParams) -> None:
        self.params = params
        self._ticks = round(params.step_s / TICK_S)
        self._double = max(1, round(params.double * self._ticks))

    # --- commands --------------------------------------------------------------------------------------------------

    def never(self, command: MotionCommand) -> CommandReply | None:
        """Return the refusal of a command that can never be obeyed, or None; the present gait is the default."""
        s = self.state
        stepping = s.gait if s.mode in (Mode.START, Mode.STEP) else None
        return refusal_of(command, abilities(self._gait_of(command, stepping)[1]), calibrated=True)

    def set_map(self, heights: HeightMap | None) -> None:
        """Ignore the terrain map: this gait takes the floor to be level."""

    @property
    def walk_id(self) -> int:
        """Number of the last command that was accepted, 0 before the first."""
        return self.state.walk_id

    def _gait_of(self, command: MotionCommand, stepping: str | None) -> tuple[str, BipedParams]:
        gait = command.gait or stepping or GAITS[0]
        return gait, self._params_of(gait) if gait in GAITS else self.params

    def command(self, command: MotionCommand) -> CommandReply:
        """Accept or refuse a command; an accepted one replaces the present one at the next step.

        A command that comes less than 0.25 s before the last landing of a walk, while the weight already moves to rest
        between the feet, begins when the robot stands.
        """
        s = self.state
        stepping = s.gait if s.mode in (Mode.START, Mode.STEP) else None
        gait, params = self._gait_of(command, stepping)
        fallen = s.mode in (Mode.FOLD, Mode.FALLEN)
        refusal = refusal_of(command, abilities(params), calibrated=s.calibrated, fallen=fallen, stepping_gait=stepping)
        if refusal is not None:
            return refusal
        s.walk_id += 1
        s.reason = ""
        walking = command.action in ("walk", "turn")
        late = AcceptedCommand(command, gait, route_of(command, params, s.walk_id) if walking else None)
        if s.mode is Mode.STEP and self._ticks_left() < LATE_TICKS and not self._upcoming(1):
            s.late = late
        else:
            self._take_up(late)
        return CommandReply(True, s.walk_id)

    def _take_up(self, late: AcceptedCommand) -> None:
        """Make a new command the present one from the next step on; renew the ZMP reference if steps are under way."""
        s = self.state
        s.gait, s.late, walking = late.gait, None, late.route is not None
        self._take_params(self._params_of(late.gait))
        s.route = s.undone = late.route
        s.paused = None
        s.duration, s.began = late.command.duration if walking else None, None
        s.learning = late.command.learn
        s.stopping = not walking and s.mode in (Mode.START, Mode.STEP)
        if s.mode is Mode.STEP:
            self._lay_reference()
        elif s.mode is Mode.START:
            if walking:
                self._lay_reference()
            else:
                self._stand()

    def kept(self) -> WalkMemory:
        """Return the command, route and offset to resume after a restart; an unfinished step counts as not begun."""
        s = self.state
        if s.late is not None:
            walking = s.late.route is not None
            return WalkMemory(s.walk_id, replace(s.late.command, gait=s.late.gait) if walking else None, None, None)
        route = s.paused or (s.undone if s.mode is Mode.STEP else s.route)
        left = None if route is None or route.finished else route.left(self.params.step_s, s.gait, s.duration)
        return WalkMemory(s.walk_id, left and replace(left, learn=s.learning), None, s.began)

    def resume(self, kept: WalkMemory) -> None:
        """Resume the stored walk after a restart, before the first tick: stand, close the feet, walk the rest."""
        s = self.state
        s.walk_id, s.began, s.recovering = kept.walk_id, kept.began, True
        if kept.command is not None:
            s.gait, s.duration = kept.command.gait or GAITS[0], kept.command.duration
            s.learning = kept.command.learn
            self._take_params(self._params_of(s.gait))
            s.route = route_of(kept.command, self.params, s.walk_id)

    # --- the tick --------------------------------------------------------------------------------------------------

    def step(self, inputs: WalkerInputs) -> WalkerOutputs:
        """Advance the gait by one control tick of 10 ms; return its set-points and state."""
        s = self.state
        self._take(inputs)
        if s.mode is Mode.WAIT and s.measured is not None:
            self._begin()
        if s.mode in (Mode.FOLD, Mode.FALLEN):
            feedback.fold(s, self.params, self.robot, self.geometry)
        elif s.mode is not Mode.WAIT:
            self._advance()
            self.servos.follow(s, self.params, self._soles(), self._double)
        phase = min(1.0, s.clock / self._ticks) if s.mode is Mode.STEP else 0.0
        ends = ends_in_s(s, self.params, self._ticks_left())
        return outputs(s, self._soles(), phase, s.clock <= self._double, self.servos.height, ends)

    def _take(self, inputs: WalkerInputs) -> None:
        s, p = self.state, self.params
        s.stamp = inputs.stamp
        if inputs.joints is not None:
            s.measured = inputs.joints
        if inputs.contacts is not None:
            s.contacts = inputs.contacts
        if inputs.initialised and not s.calibrated:
            s.calibrated = True
            if math.hypot(inputs.roll, inputs.pitch) <= p.falling_rad:  # else it lies
                s.rest[:] = inputs.roll, inputs.pitch
        s.seen[:] = inputs.x, inputs.y, inputs.yaw
        s.held = s.calibrated and (inputs.stamp - inputs.estimate_stamp > p.stale_s or not inputs.initialised)
        if not s.calibrated or s.held:
            s.rate[:] = 0.0
            return
        if feedback.watch(s, p, inputs):
            s.mode, s.clock, s.route, s.late, s.paused = Mode.FOLD, 0, None, None, None
            s.rise_from = s.command

    def _begin(self) -> None:
        """Set the planned feet, body and CoM by the measured joints, and rise from there to the stance."""
        s, q = self.state, self.state.measured
        assert q is not None
        rot, _ = kinematics.forward(self.robot.model, q)
        feet = kinematics.foot_positions(self.robot.model, q)
        for leg in (LEFT, RIGHT):
            ahead = rot[self.robot.model.foot_link[leg]][:, 0]
            s.feet[leg] = [feet[leg, 0], feet[leg, 1], math.atan2(ahead[1], ahead[0])]
        s.body = between(s.feet)
        if routes.together(s.feet, s.body, self.width, self.params) or np.ptp(feet[:, 2]) > 0.02:
            s.feet = np.array([placed(s.body, i, self.width) for i in (LEFT, RIGHT)])
        s.rise_from, s.q = q.copy(), self.servos.stance.copy()
        s.trunk = np.array([*s.body[:2], s.body[2], self.servos.height])
        s.x[0] = self._middle(s.feet)
        s.ref = s.x[:1].copy()
        self._stand()
        s.mode = Mode.RISE

    def _stand(self) -> None:
        """End stepping: stand with no step planned; the ZMP reference runs to its end between the feet."""
        s = self.state
        if s.mode is Mode.START:
            s.ref, s.row = s.ref[s.row : s.row + 1].copy(), 0
        s.mode, s.clock, s.step = Mode.STAND, 0, None
        s.stopping, s.scale, s.seen_then = False, 1.0, None
        s.planned_way[:], s.measured_way[:] = 0.0, 0.0

    def _advance(self) -> None:
        s, p = self.state, self.params
        s.clock += 1
        if s.mode is Mode.RISE:
            if s.clock >= p.rise_s / TICK_S:
                if s.recovering:
                    s.rest, s.recovering = s.rest + s.tilt, False  # what it took for level was in mid-step
                self._stand()
        elif s.mode is Mode.STAND:
            if s.paused is not None and not s.held:
                s.route, s.paused, s.reason = s.paused, None, ""
            if s.calibrated and not s.held and (s.route is not None or self._apart()):
                s.mode, s.clock = Mode.START, 0
                s.next_swing = LEFT if s.route is None else routes.first_swing(s.route, s.feet)
                s.zmp_from = s.ref[min(s.row, len(s.ref) - 1)].copy()
                self._lay_reference()
                s.row = -1
        elif s.mode is Mode.START:
            if s.held:
                self._pause()
                self._stand()
            elif s.clock >= p.start_s / TICK_S:
                self._next_step()
        elif s.mode is Mode.STEP:
            self._swing()
        s.row += 1
        preview_step(self.gains, s.x, s.error, s.ref, s.row)

    def _swing(self) -> None:
        s = self.state
        if s.clock > self._double:
            s.progress += 1.0 / (self._ticks - self._double)
        if s.progress > 1.0 - 1e-9:
            self._land()
            self._next_step()
            if s.late is not None:
                self._take_up(s.late)

    def _ticks_left(self) -> int:
        """Return the number of ticks until the present step's touch-down, or until the first step begins."""
        s = self.state
        if s.mode is Mode.START:
            return max(0, math.ceil(self.params.start_s / TICK_S - 1e-9) - s.clock)
        swinging = (1.0 - s.progress) * (self._ticks - self._double)
        return max(0, self._double - s.clock) + math.ceil(swinging - 1e-9)

    def _apart(self) -> bool:
        return not routes.together(self.state.feet, self.state.body, self.width, self.params)

    # --- steps -----------------------------------------------------------------------------------------------------

    def _upcoming(self, ticks: int) -> list[routes.Footstep]:
        s = self.state
        feet, body, swing_next = s.feet, s.body, s.next_swing
        if s.mode is Mode.STEP and s.step is not None:
            feet = feet.copy()
            feet[s.step.swing], body, swing_next = s.step.target, s.step.body, 1 - s.step.swing
        now = routes.Standing(feet, body, swing_next)
        return upcoming(s.route, now, self.params, self.width, s.scale, s.gain, ticks)

    def _pause(self) -> None:
        """Store the remaining walk while the estimate is stale: the feet are closed until a newer estimate comes."""
        s = self.state
        if s.route is not None and not s.route.finished:
            s.paused, s.reason = s.route, STALE
        s.route = None

    def _next_step(self) -> None:
        s, p = self.state, self.params
        s.scale = min(1.0, max(0.0, (p.slow_full_rad - s.peak) / (p.slow_full_rad - p.slow_from_rad)))
        s.peak = 0.0
        if s.held:
            self._pause()
        s.began = s.stamp if s.began is None else s.began
        if s.duration is not None and s.stamp - s.began >= s.duration:
            s.route = None
        s.mode, s.step = Mode.STAND, None  # so that the steps are planned from the feet as they stand
        steps = self._upcoming(1)
        if not steps:
            s.route = None
            self._stand()
            return
        step, s.undone = steps[0], s.route
        if s.route is not None and not s.route.finished:
            s.route = s.route.next(s.scale)[2]
        s.mode, s.clock, s.step = Mode.STEP, 0, step
        s.begin = s.feet[step.swing].copy()
        s.progress = 0.0
        s.zmp_from = s.ref[min(s.row, len(s.ref) - 1)].copy()
        self._lay_reference()
        s.row = -1

    def _land(self) -> None:
        s = self.state
        assert s.step is not None
        feedback.learn(s, self.params, s.step.body)
        s.feet[s.step.swing] = s.step.target
        s.body = s.step.body
        s.next_swing = 1 - s.step.swing
        s.steps += 1

    def _lay_reference(self) -> None:
        """Write the ZMP (zero-moment point) reference from the beginning of the present step over all known steps."""
        s, p = self.state, self.params
        points, ticks, double = [s.zmp_from], [], []
        feet = s.feet.copy()
        if s.mode is Mode.START:
            points.append(s.zmp_from)
            ticks.append(round(p.start_s / TICK_S))
            double.append(1)
        elif s.step is not None:
            points.append(self._support(feet, 1 - s.step.swing))
            ticks.append(s.clock + self._ticks_left())
            double.append(self._double)
            feet[s.step.swing] = s.step.target
        for step in self._upcoming(HORIZON + self._ticks):
            points.append(self._support(feet, 1 - step.swing))
            ticks.append(self._ticks)
            double.append(self._double)
            feet[step.swing] = step.target
        points.append(self._middle(feet))
        ticks.append(2 * self._double)
        double.append(2 * self._double)
        s.ref = reference(np.array(points), np.array(ticks, dtype=np.float64), np.array(double, dtype=np.float64))

    def _support(self, feet: Array, side: int) -> Array:
        return support_point(feet[side, :3], side, self.params.zmp_x_m, self.params.zmp_y_m)

    def _middle(self, feet: Array) -> Array:
        return 0.5 * (self._support(feet, LEFT) + self._support(feet, RIGHT))

    def _soles(self) -> Array:
        """Return the present poses of both soles, (2, 4): x, y (m), yaw (rad), height (m), odom."""
        s = self.state
        soles = np.zeros((2, 4))
        soles[:, :3] = s.feet
        if s.mode is Mode.STEP and s.step is not None:
            soles[s.step.swing] = swing(s.begin, s.step.target, s.progress, self.params.lift_m)
        return soles
