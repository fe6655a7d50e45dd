"""The walker of robots with four or six legs: one call per control tick, from sensors to servo set-points.

Stages: WAIT (no joints) -> SETTLE (all feet down) -> STAND <-> STEP. The plan lives in the map; at the end of every
step it is moved to the dead-reckoned pose, the estimated tilt and the map's heights, which moves no joint.
"""

import dataclasses
import math

import numpy as np

from surefoot.geometry import rotations
from surefoot.geometry.heightmap import HeightMap
from surefoot.robot import kinematics
from surefoot.robot.description import Robot
from surefoot.schemas.topics import TICK_S

from ..commands import refusal_of
from ..interface import (
    Advance,
    BodyPose,
    Check,
    CommandReply,
    MotionCommand,
    Select,
    WalkerInputs,
    WalkerOutputs,
    WalkState,
    refused,
)
from ..memory import WalkMemory
from . import anchor, balance, planning, posture, stepping
from .ground import Ground
from .params import WalkerParams, abilities
from .patterns import gaits_of
from .route import LeggedRoute, advance, finished, moved, remaining
from .standins import HullCheck, nominal_footholds
from .state import Stage, WalkerState

AS_PLANNED = np.zeros(0)  # no measured joint angles


class LeggedWalker:
    """Gait of a robot with four or six closed-form legs.

    Args:
        robot: description; a hexapod's legs in the order LF LM LH RF RM RH.
        params: settings; None = the robot's own.
        select: chooses the footholds of all legs of a step.
        check: returns whether a planned step is stable; None = by the hull of the standing feet.
    """

    def __init__(
        self,
        robot: Robot,
        params: WalkerParams | None = None,
        select: Select = nominal_footholds,
        check: Check | None = None,
    ) -> None:
        self.robot = robot
        self.params = params or WalkerParams.for_robot(robot)
        self.select = select
        self.check = check or HullCheck(robot)
        neutral = kinematics.foot_positions(robot.model, robot.neutral)
        self.frame = planning.PlanningContext(robot, self.params, None, np.ascontiguousarray(neutral[:, :2]))
        self._compliance = self.params.sag / np.array([joint.servo.kp for joint in robot.joints])
        self.state = WalkerState(robot.nlegs, robot.nj)
        self.gaits = gaits_of(robot)
        balance.usual(self.state, self.gaits[self.params.gait or next(iter(self.gaits))])

    # --- inputs that come now and then -----------------------------------------------------------------------------

    def set_map(self, heights: HeightMap | None) -> None:
        """Use a new terrain map, or none (then the ground is where the feet are)."""
        ground = None if heights is None else Ground.build(heights, self.robot.foot_radius)
        self.frame = planning.PlanningContext(self.robot, self.params, ground, self.frame.neutral)

    def command(self, command: MotionCommand) -> CommandReply:
        """Accept or refuse a command; an accepted one replaces the present one at the next step."""
        refusal = refusal_of(command, abilities(self.params, self.gaits), calibrated=self.state.calibrated)
        if refusal is not None:
            return refusal
        s = self.state
        if command.shift is not None:
            refusal = balance.stand_at(s, self.frame, self._pose(), command.shift)
            if refusal is not None:
                return refused("bad_value", "shift", refusal)
        s.walk_id += 1
        if command.gait is not None:
            balance.usual(s, self.gaits[command.gait])
        s.refused, s.reason, s.attempts, s.scale, s.shifts = False, "", 0, 1.0, 0
        s.steps_in_walk = s.steps_in_walk if s.route is not None else 0
        walking = command.action in ("walk", "turn")
        s.route = LeggedRoute(command, None, s.walk_id) if walking else None
        s.closing = not walking and (s.closing or s.stage is Stage.STEP or s.steps_in_walk > 0)
        return CommandReply(True, s.walk_id)

    def never(self, command: MotionCommand) -> CommandReply | None:
        """Return the refusal of a command that cannot be obeyed at any time, or None."""
        return refusal_of(command, abilities(self.params, self.gaits), calibrated=True)

    @property
    def walk_id(self) -> int:
        """Number of the last command that was accepted, 0 before the first."""
        return self.state.walk_id

    def kept(self) -> WalkMemory:
        """Return the command with its start, and the offset of odom, from which a restarted walker resumes."""
        s, route = self.state, self.state.route
        if route is None:
            return WalkMemory(s.walk_id, None, None, None, s.offset)
        return WalkMemory(s.walk_id, route.command, route.start, route.began, s.offset)

    def resume(self, kept: WalkMemory) -> None:
        """Resume the stored walk after a restart, before the first tick: feet down, neutral stance, remaining route."""
        s = self.state
        route = None if kept.command is None else LeggedRoute(kept.command, kept.start, kept.walk_id, kept.began)
        s.walk_id, s.route, s.offset, s.recovering = kept.walk_id, route, kept.offset, True
        if route is not None and route.command.gait is not None:
            balance.usual(s, self.gaits[route.command.gait])

    # --- the tick --------------------------------------------------------------------------------------------------

    def step(self, inputs: WalkerInputs) -> WalkerOutputs:
        """Advance the gait by one control tick of 10 ms; return its set-points and state."""
        s = self.state
        inputs = anchor.placed(s, inputs)
        self._take(inputs)
        if s.stage is Stage.WAIT and s.measured is not None:
            anchor.begin(s, self.robot, inputs)
        if s.stage is not Stage.WAIT:
            if inputs.initialised and not s.calibrated:
                anchor.lay_over(s, self.params, self.frame.ground, inputs)
                s.calibrated = True
            if s.calibrated and not s.held:
                self._level(inputs)
            else:
                s.felt = None
            if s.stage is Stage.SETTLE:
                stepping.settle(s, TICK_S)
            elif s.stage is Stage.STAND:
                self._stand(inputs)
            if s.stage is Stage.STEP:
                self._step(inputs)
            self._posture(inputs)
        return self._outputs()

    def _take(self, inputs: WalkerInputs) -> None:
        s = self.state
        s.now = inputs.stamp
        if inputs.joints is not None:
            s.measured, s.measured_stamp = inputs.joints, inputs.stamp
        s.fresh = inputs.contacts is not None
        if inputs.contacts is not None:
            s.contacts, s.contacts_stamp = inputs.contacts, inputs.stamp
        oldest = min(inputs.estimate_stamp, s.measured_stamp, s.contacts_stamp)
        s.held = s.calibrated and (inputs.stamp - oldest > self.params.stale_s or not inputs.initialised)

    def _level(self, inputs: WalkerInputs) -> None:
        """Turn the commanded trunk against the estimated tilt: slowly to level, of a crawling robot also at once.

        Three legs that give way hold a heavy trunk only just: m g h is then near the stiffness of their servos.
        """
        s, p = self.state, self.params
        gain = p.level_gain if s.stage is Stage.STEP else p.stand_level_gain
        limit = p.level_limit_rad
        felt = np.array((inputs.roll, inputs.pitch)) + p.brace_lead_s * np.array(inputs.rate[:2])
        braced = p.brace_gain * (felt - s.felt) if s.gait.leans and s.felt is not None else np.zeros(2)
        s.felt = felt
        s.level = np.clip(s.level - gain * np.array(anchor.tilt(s, inputs)) - braced, -limit, limit)

    # --- standing and stepping -------------------------------------------------------------------------------------

    def _stand(self, inputs: WalkerInputs) -> None:
        s, p = self.state, self.params
        stepping.load(s, TICK_S)
        if not s.calibrated:
            return
        wanted = planning.trunk_height(self.frame, s.footholds, self._pose(), s.trunk_shift)
        reach = p.trunk_speed * TICK_S
        rise = max(-reach, min(reach, wanted - s.body[2]))
        s.body[2] += rise
        if s.adjusting and abs(wanted - s.body[2]) < 0.002:
            s.adjusting = False
        hangs = not s.held and s.gait.leans and s.goal is not None and stepping.bear(s, self.robot, p, TICK_S)
        if not s.held and not hangs:
            balance.shift(s, reach)
        if s.held or s.adjusting or s.goal is not None:
            return
        if s.route is not None or s.closing or s.recovering:
            self._next_step(inputs)

    def _step(self, inputs: WalkerInputs) -> None:
        s = self.state
        if stepping.advance(s, self.robot, self.params, TICK_S, np.array(anchor.tilt(s, inputs))):
            s.stage = Stage.STAND
            balance.relax(s, self.frame)
            if not s.held:
                self._next_step(inputs)

    def _next_step(self, inputs: WalkerInputs) -> None:
        """Plan the next step and begin it, end the walk, or try again in the next tick."""
        s, p = self.state, self.params
        anchor.lay_over(s, self.params, self.frame.ground, inputs)
        place, low = self._place(), ""
        if s.route is not None:
            s.route = s.route if s.recovering else s.route.begun(place, s.now)
        if s.route is not None and (s.route.over(s.now) or finished(s.route, place, p)):
            s.route, s.closing = None, True
        if s.route is None or s.recovering:
            legs, step, after = self._closing_group(), Advance(), Advance()
            if not legs and balance.upright(s, place):
                return
            if not legs:
                s.closed.clear()
                s.closing = s.recovering = False
                s.steps_in_walk, s.trunk_shift = 0, 0.0
                s.stage, s.plan = Stage.STAND, None
                return  # a route that waits begins in the next tick
        else:
            legs = s.gait.groups[s.group]
            first = 0.5 if s.steps_in_walk == 0 else 1.0
            if inputs.margin is not None and inputs.margin < p.low_margin_m:
                first *= 0.5
                low = f"margin {1e3 * inputs.margin:.0f} mm is low: shorter step"
            took = s.plan.duration + s.plan.lean if s.gait.leans and s.plan is not None else None
            step = advance(s.route, place, p, s.gait.steps_per_cycle, first * s.scale, took)
            after = advance(s.route, moved(place, step), p, s.gait.steps_per_cycle, s.scale, took)
        plan = self._plan(legs, moved(place, step), after)
        if plan is None:
            s.stage, s.plan = Stage.STAND, None
            s.attempts += s.goal is None
            if s.attempts >= p.max_attempts:
                s.route, s.closing, s.recovering, s.refused = None, False, False, True
            return
        s.reason = low
        s.attempts, s.scale, s.trunk_shift = 0, 1.0, 0.5 * s.trunk_shift
        s.closed = s.closed | {legs} if s.route is None or s.recovering else set()
        s.plan, s.stage, s.clock = plan, Stage.STEP, 0.0
        s.landed = ~plan.swing if plan.lean == 0.0 else np.ones_like(plan.swing)
        s.hanging[:], s.sunk[:] = 0, 0.0
        s.group = (s.group + 1) % s.gait.steps_per_cycle if s.route is not None else s.group
        s.swung = legs

    def _closing_group(self) -> tuple[int, ...]:
        """Return the legs of the group farthest from neutral, each group once; empty when all are near enough."""
        s = self.state
        place = self._place()
        wanted = planning.rotated(s.yaw, self.frame.neutral) + np.array([place.x, place.y])
        off = np.hypot(*(s.footholds[:, :2] - wanted).T)
        worst, far = (), self.params.close_tolerance_m
        for group in s.gait.groups:
            reach = float(max(off[list(group)]))
            if reach > far and group not in s.closed:
                worst, far = group, reach
        return worst

    def _plan(self, legs: tuple[int, ...], place: BodyPose, after: Advance) -> planning.StepPlan | None:
        """Return the plan of a step of `legs`, with requested footholds and checks; None when it cannot be taken.

        `place`: of the trunk at its end without leaning; `after`: movement of the trunk in each step after it. The
        reason of a None, and what the next try should change (scale, height, goal), are written to the state.
        """
        s, frame, gait = self.state, self.frame, self.state.gait
        begin = self._pose()
        nominal = planning.landings(frame, gait, legs, place, after, s.footholds)
        planar = balance.lean(s, frame, legs, place) if gait.leans else place
        feet_to = s.footholds.copy()
        feet_to[list(legs)] = nominal
        guess = BodyPose(planar.x, planar.y, planning.trunk_height(frame, feet_to, planar, s.trunk_shift), planar.yaw)
        replies = self.select(planning.foothold_request(legs, nominal, guess, after, gait))
        status = ["nominal"] * self.robot.nlegs
        shift = 0.0
        for leg, reply in zip(legs, replies, strict=True):
            status[leg] = reply.status
            name = self.robot.leg_names[leg]
            if reply.status == "ok" and reply.foothold is not None:
                feet_to[leg] = reply.foothold
            elif reply.status == "raise_trunk":
                shift = max(shift, reply.trunk_shift, key=abs)
                s.reason = f"{name}: no foothold in reach, trunk moves by {1e3 * shift:.0f} mm"
            elif reply.status == "infeasible":
                s.scale *= 0.5
                s.reason = f"{name}: no foothold ({reply.reason})"
        s.status = tuple(status)
        if "infeasible" in status:
            return None
        if shift != 0.0:
            self._adjust(shift)
            return None
        swings = planning.swing_tops(frame, legs, s.footholds, feet_to)
        apex = planning.apex(legs, s.footholds, feet_to, swings[1])
        end = planning.end_pose(frame, begin, planar, s.footholds, feet_to, apex, s.trunk_shift, gait.leans)
        if end is None:
            if 2 * s.attempts >= self.params.max_attempts and self._regain_reach(begin):
                return None
            s.scale *= 0.5
            s.reason = "a leg does not reach its foothold at any trunk height"
            return None
        plan = planning.complete(frame, legs, begin, end, s.footholds, feet_to, swings, gait.leans)
        rot = rotations.matrix_from_rpy(s.level[0], s.level[1], s.yaw)
        if gait.leans:
            plan = dataclasses.replace(plan, lean=balance.lean_time(begin, end, self.params))
            verdict = self.check(planning.leant_request(frame, plan, s.level))
        else:
            verdict = self.check(planning.check_request(frame, plan, s.q, rot))
        s.margin = verdict.margin
        safe = verdict.stable and (verdict.margin is None or verdict.margin >= self.params.wanted_margin_m)
        if not safe and not balance.react(s, frame, end if gait.leans else begin, verdict):
            return None
        if gait.leans:
            s.lean = planning.rotated(-place.yaw, np.array([[end.x - place.x, end.y - place.y]]))[0]
        return plan

    def _regain_reach(self, now: BodyPose) -> bool:
        """Let the trunk, at `now`, move to where all legs reach their places; False: no height is better than this.

        A step of any length begins in reach of the places where the feet stand: shorter ones do not help.
        """
        s = self.state
        height = planning.height_in_reach(self.frame, now, s.footholds)
        if height is None:
            return False
        self._adjust(height - planning.trunk_height(self.frame, s.footholds, now, 0.0) - s.trunk_shift)
        s.reason = f"a leg does not reach where it stands, trunk moves by {1e3 * (height - now.z):.0f} mm"
        return True

    def _adjust(self, shift: float) -> None:
        """Let the standing trunk move to a height that is changed by `shift`, m, before the next try of a step."""
        s = self.state
        s.trunk_shift = max(-0.05, min(0.05, s.trunk_shift + shift))
        s.adjusting = True

    # --- outputs ---------------------------------------------------------------------------------------------------

    def _pose(self) -> BodyPose:
        s = self.state
        return BodyPose(float(s.body[0]), float(s.body[1]), float(s.body[2]), s.yaw)

    def _place(self) -> BodyPose:
        """Return the position of the trunk in the gait: where it would be without leaning over the standing feet."""
        s = self.state
        x, y = s.body[:2] - planning.rotated(s.yaw, s.lean[None])[0]
        return BodyPose(float(x), float(y), float(s.body[2]), s.yaw)

    def _posture(self, inputs: WalkerInputs) -> None:
        s = self.state
        rot = rotations.matrix_from_rpy(s.level[0], s.level[1], s.yaw)
        measured, felt = AS_PLANNED, rot
        if s.gait.leans and s.calibrated and not s.held and s.measured is not None:
            measured, felt = s.measured, rotations.matrix_from_rpy(*anchor.tilt(s, inputs), s.yaw)
        s.command, s.q, reachable = posture.set_points(
            self.robot.model, s.feet, s.body, rot, s.support, self._compliance, measured, felt
        )
        s.unreachable = self.robot.nlegs - int(np.count_nonzero(reachable))

    def _walk_state(self) -> WalkState:
        s = self.state
        if s.stage is Stage.WAIT or not s.calibrated:
            return "waiting"
        if s.held:
            return "hold"
        if s.recovering or s.stage is Stage.SETTLE:
            return "recovering"
        if s.route is not None:
            return "turning" if s.route.command.action == "turn" else "walking"
        if s.closing:
            return "stopping"
        return "refused" if s.refused else "standing"

    def _outputs(self) -> WalkerOutputs:
        s = self.state
        plan = s.plan if s.stage is Stage.STEP else None
        left = 0.0
        if s.route is not None:
            left = remaining(s.route, self._place())
        return WalkerOutputs(
            command=s.command,
            state=self._walk_state(),
            walk_id=s.walk_id,
            phase=0.0 if plan is None else min(1.0, s.clock / plan.duration),
            stance=s.landed.copy(),
            footholds=(s.footholds if plan is None else plan.feet_to).copy(),
            foothold_status=s.status,
            trunk_height=float(s.body[2] - s.footholds[:, 2].sum() / self.robot.nlegs) + self.robot.foot_radius,
            remaining=left if math.isfinite(left) else 0.0,
            margin=s.margin,
            reason=s.reason,
            steps=s.steps,
            unreachable=s.unreachable,
        )
