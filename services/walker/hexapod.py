"""The hexapod walker: one call per control tick, from estimates, joints and foot switches to servo set-points.

Stages: WAIT (no joints) -> SETTLE (all feet down) -> STAND <-> STEP. The plan lives in the map; at the end of every
step it is laid anew over the dead-reckoned pose, the estimated tilt and the map's heights, which moves no joint.
"""

import math

import numpy as np
from numpy.typing import NDArray

from services.walker import planning, posture, swing
from services.walker.gaits import HEXAPOD_GAITS, Gait
from services.walker.ground import Ground
from services.walker.interface import (
    Advance,
    Check,
    Command,
    CommandReply,
    Pose,
    Select,
    WalkerInputs,
    WalkerOutputs,
    WalkState,
)
from services.walker.params import WalkerParams
from services.walker.route import Route, advance, finished, moved, remaining
from services.walker.standins import HullCheck, nominal_footholds
from services.walker.state import Stage, WalkerState
from surefoot import kinematics, rotations
from surefoot.heightmap import HeightMap
from surefoot.robot import Robot

Array = NDArray[np.float64]

DT = 0.01  # s, control tick
SETTLE_SPEED = 0.04  # m/s, how fast a lifted foot looks for the ground after a start
SETTLE_DEPTH = 0.08  # m, how far
TOUCH_PHASE = 0.05  # of the swing after the fall begins: earlier switch readings belong to the lift-off


class HexapodWalker:
    """Gait of a six-legged robot with closed-form legs.

    Args:
        robot: description; its legs in the order LF LM LH RF RM RH.
        params: settings; None = the robot's own.
        select: chooses the footholds of all legs of a step.
        check: judges a step before it is taken; None = hull of the standing feet.
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
        self.frame = planning.Frame(robot, self.params, None, np.ascontiguousarray(neutral[:, :2]))
        self._compliance = self.params.sag / np.array([joint.servo.kp for joint in robot.joints])
        self.state = WalkerState(robot.nlegs, robot.nj, gait=HEXAPOD_GAITS[self.params.gait])

    # --- inputs that come now and then ---------------------------------------------------------------------------

    def set_map(self, heights: HeightMap | None) -> None:
        """Take a new terrain map, or none (then the ground is where the feet are)."""
        ground = None if heights is None else Ground.build(heights, self.robot.foot_radius)
        self.frame = planning.Frame(self.robot, self.params, ground, self.frame.neutral)

    def command(self, command: Command) -> CommandReply:
        """Accept or refuse a command; an accepted one replaces the present one at the next step."""
        refusal = self._refusal(command)
        if refusal is not None:
            return refusal
        s = self.state
        s.walk_id += 1
        if command.gait is not None:
            s.gait = HEXAPOD_GAITS[command.gait]
            s.group %= s.gait.steps_per_cycle
        s.refused, s.reason, s.attempts, s.scale = False, "", 0, 1.0
        s.steps_in_walk = s.steps_in_walk if s.route is not None else 0
        walking = command.action in ("walk", "turn")
        s.route = Route(command, self._pose(), s.walk_id) if walking else None
        s.closing = not walking and (s.closing or s.stage is Stage.STEP or s.steps_in_walk > 0)
        return CommandReply(True, s.walk_id)

    def _refusal(self, command: Command) -> CommandReply | None:
        values = (command.distance, command.velocity, command.angle)
        if any(value is not None and not math.isfinite(value) for value in values):
            return CommandReply(False, 0, "bad_value", f"numbers must be finite, got {values}")
        if command.gait is not None and command.gait not in HEXAPOD_GAITS:
            known = ", ".join(HEXAPOD_GAITS)
            return CommandReply(False, 0, "unknown_gait", f"gait must be one of {known}, got {command.gait!r}")
        if command.action in ("stand", "stop"):
            return None
        if not self.state.calibrated:
            return CommandReply(False, 0, "not_initialised", "the estimator has not finished its standstill calibration")
        if command.action == "turn" and command.angle is None:
            return CommandReply(False, 0, "missing_field", "turn needs an angle")
        fastest = self.params.max_stride_m / self.params.period_s
        if command.velocity is not None and not 0.0 < abs(command.velocity) <= fastest:
            text = f"velocity must be within 0 and {fastest:.3f} m/s, got {command.velocity:g}"
            return CommandReply(False, 0, "too_fast", text)
        return None

    # --- the tick --------------------------------------------------------------------------------------------------

    def step(self, inputs: WalkerInputs) -> WalkerOutputs:
        """Advance by one control tick."""
        s = self.state
        self._take(inputs)
        if s.stage is Stage.WAIT and s.measured is not None:
            self._start(inputs)
        if s.stage is not Stage.WAIT:
            if inputs.initialised and not s.calibrated:
                self._anchor(inputs)
                s.calibrated = True
            if s.calibrated and not s.held:
                self._level(inputs)
            if s.stage is Stage.SETTLE:
                self._settle()
            elif s.stage is Stage.STAND:
                self._stand(inputs)
            if s.stage is Stage.STEP:
                self._swing(inputs)
            self._posture()
        return self._outputs()

    def _take(self, inputs: WalkerInputs) -> None:
        s = self.state
        if inputs.joints is not None:
            s.measured, s.measured_stamp = inputs.joints, inputs.stamp
        s.fresh = inputs.contacts is not None
        if inputs.contacts is not None:
            s.contacts, s.contacts_stamp = inputs.contacts, inputs.stamp
        oldest = min(inputs.estimate_stamp, s.measured_stamp, s.contacts_stamp)
        s.held = s.calibrated and (inputs.stamp - oldest > self.params.stale_s or not inputs.initialised)

    def _start(self, inputs: WalkerInputs) -> None:
        """Lay the plan under the measured joints; feet without contact will be lowered first."""
        s = self.state
        assert s.measured is not None
        rot = rotations.matrix_from_rpy(inputs.roll, inputs.pitch, inputs.yaw)
        feet = posture.into_map(kinematics.foot_positions(self.robot.model, s.measured), np.zeros(3), rot)
        down = s.contacts if s.contacts.any() else np.ones(self.robot.nlegs, dtype=np.bool_)
        s.body[:] = (inputs.x, inputs.y, -float(np.mean(feet[down, 2])) + self.robot.foot_radius)
        s.yaw, s.level[:] = inputs.yaw, (inputs.roll, inputs.pitch)
        s.feet = feet + s.body
        s.footholds = s.feet.copy()
        s.support[:] = down
        s.landed = down.copy()
        s.recovering = not down.all()
        s.stage = Stage.STAND if down.all() else Stage.SETTLE

    def _anchor(self, inputs: WalkerInputs) -> None:
        """Lay the whole plan over the estimated pose, tilt and the map's heights; body-frame feet stay as they are."""
        s = self.state
        old = rotations.matrix_from_rpy(s.level[0], s.level[1], s.yaw)
        limit = self.params.level_limit_rad
        s.level[:] = max(-limit, min(limit, inputs.roll)), max(-limit, min(limit, inputs.pitch))
        s.yaw = inputs.yaw
        new = rotations.matrix_from_rpy(s.level[0], s.level[1], s.yaw)
        at = np.array([inputs.x, inputs.y, s.body[2]])
        s.feet = posture.into_map(posture.into_base(s.feet, s.body, old), at, new)
        s.footholds = posture.into_map(posture.into_base(s.footholds, s.body, old), at, new)
        s.body = at
        ground = self.frame.ground
        if ground is not None:
            gaps = np.array([ground.centre_height(p[0], p[1]) - p[2] for p in s.footholds[s.landed]])
            gaps = gaps[np.isfinite(gaps)]
            if gaps.size:
                part = self.params.anchor_height if s.calibrated else 1.0
                rise = part * float(np.median(gaps))
                s.body[2] += rise
                s.feet[:, 2] += rise
                s.footholds[:, 2] += rise

    def _level(self, inputs: WalkerInputs) -> None:
        s, p = self.state, self.params
        gain = p.level_gain if s.stage is Stage.STEP else p.stand_level_gain
        limit = p.level_limit_rad
        s.level[0] = max(-limit, min(limit, s.level[0] - gain * inputs.roll))
        s.level[1] = max(-limit, min(limit, s.level[1] - gain * inputs.pitch))

    def _settle(self) -> None:
        """Lower every foot that has no contact until all stand."""
        s = self.state
        if s.fresh:
            s.landed |= s.contacts
        deep = s.footholds[:, 2] - s.feet[:, 2] > SETTLE_DEPTH
        s.landed |= deep
        s.feet[~s.landed, 2] -= SETTLE_SPEED * DT
        s.support = np.minimum(1.0, s.support + s.landed * (DT / 0.1))
        if s.landed.all():
            s.footholds = s.feet.copy()
            s.stage = Stage.STAND

    # --- standing ----------------------------------------------------------------------------------------------------

    def _stand(self, inputs: WalkerInputs) -> None:
        s, p = self.state, self.params
        s.support = np.minimum(1.0, s.support + DT / 0.1)
        if not s.calibrated:
            return
        wanted = planning.trunk_height(self.frame, s.footholds, self._pose(), s.trunk_shift)
        reach = p.trunk_speed * DT
        rise = max(-reach, min(reach, wanted - s.body[2]))
        s.body[2] += rise
        if s.adjusting and abs(wanted - s.body[2]) < 0.002:
            s.adjusting = False
        if s.held or s.adjusting:
            return
        if s.route is not None or s.closing or s.recovering:
            self._next_step(inputs)

    def _next_step(self, inputs: WalkerInputs) -> None:
        """Plan the next step and begin it, end the walk, or try again in the next tick."""
        s, p = self.state, self.params
        self._anchor(inputs)
        begin = self._pose()
        if s.route is not None and finished(s.route, begin, p):
            s.route, s.closing = None, True
        if s.route is None:
            legs, step, after = self._closing_group(), Advance(), Advance()
            if not legs:
                s.closing = s.recovering = False
                s.steps_in_walk, s.trunk_shift = 0, 0.0
                s.stage, s.plan = Stage.STAND, None
                return
        else:
            legs = s.gait.groups[s.group]
            first = 0.5 if s.steps_in_walk == 0 else 1.0
            step = advance(s.route, begin, p, s.gait.steps_per_cycle, first * s.scale)
            after = advance(s.route, moved(begin, step), p, s.gait.steps_per_cycle, s.scale)
        plan = self._plan(inputs, legs, begin, step, after)
        if plan is None:
            s.stage, s.plan = Stage.STAND, None
            s.attempts += 1
            if s.attempts >= p.max_attempts:
                s.route, s.closing, s.recovering, s.refused = None, False, False, True
            return
        s.attempts, s.scale, s.trunk_shift = 0, 1.0, 0.5 * s.trunk_shift
        s.plan, s.stage, s.clock = plan, Stage.STEP, 0.0
        s.landed = ~plan.swing
        s.group = (s.group + 1) % s.gait.steps_per_cycle if s.route is not None else s.group

    def _closing_group(self) -> tuple[int, ...]:
        """The group of legs farthest from neutral, none when all are near."""
        s = self.state
        wanted = planning.rotated(s.yaw, self.frame.neutral) + s.body[:2]
        off = np.hypot(*(s.footholds[:, :2] - wanted).T)
        groups = s.gait.groups
        worst = max(range(len(groups)), key=lambda g: float(max(off[list(groups[g])])))
        return groups[worst] if max(off[list(groups[worst])]) > self.params.close_tolerance_m else ()

    def _plan(
        self, inputs: WalkerInputs, legs: tuple[int, ...], begin: Pose, step: Advance, after: Advance
    ) -> planning.StepPlan | None:
        """Ask for footholds and for the step's safety; None with the reason set when the step cannot be taken."""
        s, frame, gait = self.state, self.frame, self.state.gait
        planar = moved(begin, step)
        nominal = planning.landings(frame, gait, legs, planar, after, s.footholds)
        feet_to = s.footholds.copy()
        feet_to[list(legs)] = nominal
        guess = Pose(planar.x, planar.y, planning.trunk_height(frame, feet_to, planar, s.trunk_shift), planar.yaw)
        replies = self.select(planning.foothold_request(legs, nominal, guess, after, gait))
        status = ["nominal"] * self.robot.nlegs
        shift = 0.0
        for leg, reply in zip(legs, replies, strict=True):
            status[leg] = reply.status
            name = self.robot.leg_names[leg]
            if reply.status == "ok" and reply.foothold is not None:
                x, y = reply.foothold[0], reply.foothold[1]
                feet_to[leg] = (x, y, planning.centre_height(frame, x, y, s.footholds))
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
            s.trunk_shift = max(-0.05, min(0.05, s.trunk_shift + shift))
            s.adjusting = True
            return None
        end = planning.end_pose(frame, begin, planar, feet_to, s.trunk_shift)
        if end is None:
            s.scale *= 0.5
            s.reason = "a leg does not reach its foothold at any trunk height"
            return None
        plan = planning.complete(frame, legs, begin, end, s.footholds, feet_to, s.status)
        rot = rotations.matrix_from_rpy(s.level[0], s.level[1], s.yaw)
        verdict = self.check(planning.check_request(frame, plan, s.q, rot))
        s.margin = verdict.margin
        if not verdict.stable:
            s.scale *= 0.5
            s.reason = f"step would not be stable (status {verdict.status}, margin {verdict.margin})"
            return None
        s.reason = ""
        return plan

    # --- stepping ----------------------------------------------------------------------------------------------------

    def _swing(self, inputs: WalkerInputs) -> None:
        s, p, plan = self.state, self.params, self.state.plan
        assert plan is not None
        duration = 0.5 * p.period_s
        s.clock += DT
        u = min(1.0, s.clock / duration)
        v = max(0.0, (s.clock / duration - p.overlap) / (1.0 - 2.0 * p.overlap))
        if s.fresh and v > p.swing.fall_start + TOUCH_PHASE:
            self._touch(plan)
        lost = plan.swing & ~s.landed & (v > 1.0) & (plan.feet_to[:, 2] - s.feet[:, 2] > p.search_m)
        if lost.any():
            s.landed |= lost
            plan.feet_to[lost] = s.feet[lost]
            s.reason = "no ground found under " + ", ".join(n for n, f in zip(self.robot.leg_names, lost, strict=True) if f)
        s.feet = swing.targets(
            p.swing, plan.swing, s.landed, plan.feet_from, plan.feet_to, plan.top, plan.go, plan.arrive,
            v, s.feet, p.press_speed * DT,
        )  # fmt: skip
        rate = DT / (p.overlap * duration)
        s.support = np.clip(s.support + np.where(s.landed, rate, -rate), 0.0, 1.0)
        a, b, ease = plan.begin, plan.end, swing.smooth(u)
        s.body[:] = (a.x + u * (b.x - a.x), a.y + u * (b.y - a.y), a.z + ease * (b.z - a.z))
        s.yaw = a.yaw + u * (b.yaw - a.yaw)
        if u >= 1.0 and s.landed.all():
            s.footholds = plan.feet_to.copy()
            s.steps += 1
            s.steps_in_walk += 1
            s.stage = Stage.STAND
            if not s.held:
                self._next_step(inputs)

    def _touch(self, plan: planning.StepPlan) -> None:
        """Feet that swing and touch stay where they are; their height is the measured one."""
        s = self.state
        touched = plan.swing & ~s.landed & s.contacts
        if not touched.any() or s.measured is None:
            return
        rot = rotations.matrix_from_rpy(s.level[0], s.level[1], s.yaw)
        measured = posture.into_map(kinematics.foot_positions(self.robot.model, s.measured), s.body, rot)
        plan.feet_to[touched] = s.feet[touched]
        plan.feet_to[touched, 2] = measured[touched, 2]
        s.landed |= touched

    # --- outputs -------------------------------------------------------------------------------------------------------

    def _pose(self) -> Pose:
        s = self.state
        return Pose(float(s.body[0]), float(s.body[1]), float(s.body[2]), s.yaw)

    def _posture(self) -> None:
        s = self.state
        rot = rotations.matrix_from_rpy(s.level[0], s.level[1], s.yaw)
        s.command, s.q, reachable = posture.set_points(
            self.robot.model, s.feet, s.body, rot, s.support, self._compliance
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
            left = remaining(s.route, self._pose())
        return WalkerOutputs(
            command=s.command,
            state=self._walk_state(),
            walk_id=s.walk_id,
            phase=0.0 if plan is None else min(1.0, s.clock / (0.5 * self.params.period_s)),
            stance=s.landed,
            footholds=s.footholds if plan is None else plan.feet_to,
            foothold_status=s.status,
            trunk_height=float(s.body[2] - np.mean(s.footholds[:, 2])) + self.robot.foot_radius,
            remaining=left if math.isfinite(left) else 0.0,
            margin=s.margin,
            reason=s.reason,
            steps=s.steps,
            unreachable=s.unreachable,
        )
