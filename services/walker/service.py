"""The walker service: walk commands in, joint commands out; asks for footholds and stability before each step."""

import dataclasses
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
from pydantic import Field

from surefoot.errors import CallError, Refusal
from surefoot.geometry import rotations
from surefoot.geometry.heightmap import HeightMap, HeightMapError
from surefoot.lockstep.config import ServiceConfig
from surefoot.lockstep.join import Delayed, TickInputs
from surefoot.lockstep.service import Service
from surefoot.robot.reader import load_robot
from surefoot.schemas.base import Message
from surefoot.schemas.cmd import WalkCommand, WalkReply
from surefoot.schemas.footholds import BasePose, LegRequest, SelectRequest
from surefoot.schemas.hw import EmergencyStop, JointCommand
from surefoot.schemas.navigation import MotionOrder
from surefoot.schemas.stability import BasePose as CheckBase
from surefoot.schemas.stability import CheckRequest, Contact
from surefoot.schemas.state import GaitState, Odometry, VelocityEstimate
from surefoot.schemas.topics import (
    CMD_ESTOP,
    CMD_JOINTS,
    CMD_WALK,
    FOOTHOLDS_SELECT,
    HW_CONTACTS,
    HW_JOINTS,
    NAVIGATOR_ORDER,
    STABILITY_CHECK,
    STATE_GAIT,
    STATE_ODOMETRY,
    STATE_STABILITY,
    STATE_VELOCITY,
    TERRAIN_MAP,
    Topic,
)

from . import interface
from .biped.gait import BipedWalker
from .gait import Gait
from .hexapod.gait import HexapodWalker
from .hexapod.params import WalkerParams
from .hexapod.standins import HullCheck, nominal_footholds
from .interface import FootholdReply, WalkerInputs, WalkerOutputs
from .memory import Memory
from .orders import Order
from .outcomes import Outcomes
from .rehearsal import rehearse

ANSWER_S = 1.0
"""A question to another service that is not answered in this wall time is answered by the walker's own stand-in."""
REGION_TOLERANCE_M = 1e-3
"""Accuracy of the region in the answer; its margins are exact."""


class WalkerConfig(ServiceConfig):
    """How the walker walks; null = as the robot description says."""

    hip_height_m: float | None = Field(default=None, gt=0, lt=1, description="m, base_link over the ground")
    stride_m: float | None = Field(default=None, gt=0, lt=1, description="m, way of the trunk in one gait cycle")
    period_s: float | None = Field(default=None, gt=0, lt=10, description="s, two steps of the tripod gait")
    clearance_m: float | None = Field(default=None, gt=0, lt=1, description="m, height of a swing over the ground")
    ask_footholds: bool = Field(default=True, description="ask footholds/select for each landing")
    ask_stability: bool = Field(default=True, description="ask stability/check before each step")
    memory: str | None = Field(
        default=None, description="file of this run that keeps the command for a walker that is started again"
    )


class Walker(Service[WalkerConfig]):
    """Gait of the robot; the only one who may command its joints."""

    name = "walker"
    Config = WalkerConfig
    inputs = (
        STATE_VELOCITY, STATE_ODOMETRY, HW_JOINTS, HW_CONTACTS, TERRAIN_MAP, Delayed(STATE_STABILITY),
        Delayed(NAVIGATOR_ORDER),
    )  # fmt: skip
    outputs = (CMD_JOINTS, STATE_GAIT)
    serves = (CMD_WALK,)
    calls = (FOOTHOLDS_SELECT, STABILITY_CHECK)
    observes = (CMD_ESTOP,)

    def on_start(self) -> None:
        self.robot = load_robot(self.config.robot)
        self.biped = self.robot.kind == "biped"
        chosen = {k: v for k, v in self.config.model_dump().items() if k in _TUNABLE and v is not None}
        self.params = WalkerParams.for_robot(self.robot, **chosen)
        self.own_check = HullCheck(self.robot)
        self.memory = Memory(self.config.memory)
        self.on_reset()
        self.handle(CMD_WALK, self.walk)

    def rehearse(self) -> None:
        rotations.quat_from_rpy(0.0, 0.0, 0.1)
        if self.biped:
            rehearse(BipedWalker(self.robot), hexapod=False)
        else:
            rehearse(HexapodWalker(self.robot, self.params), hexapod=True)

    def on_reset(self) -> None:
        self.gait: Gait = (
            BipedWalker(self.robot) if self.biped else HexapodWalker(self.robot, self.params, self._select, self._check)
        )
        self._map: object = None
        self._planned: list[tuple[int, int, WalkCommand]] = []
        self._tick, self._epoch = -1, 0
        self._degraded = ""
        self._order = Order()
        self._outcomes = Outcomes()
        self._out: WalkerOutputs | None = None
        self._stopped = ""  # the reason of an emergency stop; only a new run releases it
        self._estimate: tuple[VelocityEstimate, Odometry] | None = None  # the newest; the gait judges its age

    # -- commands ----------------------------------------------------------------------------------------------

    def walk(self, request: WalkCommand) -> WalkReply:
        """Accepts or refuses a command; with ``at_tick`` it is kept until then."""
        if self._stopped and request.action != "stop":
            return self._refused()
        if request.at_tick is not None:
            if request.at_tick <= self._tick:
                reason = f"at_tick {request.at_tick} has passed; the next tick is {self._tick + 1}"
                raise Refusal("late", reason, "at_tick")
            refusal = self.gait.never(_command_of(request))
            if refusal is not None:
                return _reply(refusal)
            number = self.gait.walk_id + len(self._planned) + 1
            self._planned.append((request.at_tick, number, request))
            self._keep()
            return WalkReply(accepted=True, id=number)
        reply = self._command(request)
        self._keep()
        return reply

    def on_message(self, topic: Topic[Any], message: Message) -> None:
        """An emergency stop: the driver obeys no joint command from now on, so no walk would ever arrive."""
        if isinstance(message, EmergencyStop):
            self._stopped = message.reason or "no reason given"

    def _refused(self) -> WalkReply:
        reason = f"an emergency stop is in force ({self._stopped}); sim/reset begins a new run"
        return WalkReply(accepted=False, id=0, code="stopped", reason=reason)

    def _command(self, request: WalkCommand, learn: bool = True) -> WalkReply:
        if self._stopped and request.action != "stop":
            return self._refused()  # planned before the stop
        return _reply(self.gait.command(dataclasses.replace(_command_of(request), learn=learn)))

    def _recall(self, tick: int) -> None:
        """A newcomer in the middle of a run takes up what it left."""
        kept = self.memory.recall(self._epoch, tick)
        if kept is None:
            self._order = Order(known=False)
            return
        self._order = Order(kept.order)
        self.gait.resume(kept)
        for number, item in enumerate(kept.planned, kept.walk_id + 1):
            request = WalkCommand.model_validate(item)
            self._planned.append((request.at_tick or tick, number, request))
        what = "goes on with its command" if kept.command else "no command"
        self.log("info", f"started again in tick {tick}: {what}")

    def _keep(self) -> None:
        if self.memory.path is None or self._tick < 0:  # before the first tick nothing is worth keeping
            return
        planned = tuple(item[2].model_dump() for item in self._planned)
        kept = dataclasses.replace(self.gait.kept(), planned=planned, order=self._order.number)
        self.memory.keep(self._epoch, self._tick, kept)
        if self.memory.problem:
            self.log("warning", self.memory.problem)
            self.memory.problem = ""

    # -- ticks -------------------------------------------------------------------------------------------------

    def on_tick(self, inputs: TickInputs) -> None:
        first, self._tick, self._epoch = self._tick < 0, inputs.number, inputs.tick.epoch
        if first and inputs.number > 0:
            self._recall(inputs.number)
        elif first:
            self.memory.forget()
        self._take_map(inputs)
        self._degraded = ""
        for item in [item for item in self._planned if item[0] <= inputs.number]:
            self._planned.remove(item)
            reply = self._command(item[2])
            if not reply.accepted:
                self.log("warning", f"command {item[1]} ({item[2].action}) refused in its tick: {reply.reason}")
                self._degraded = reply.reason
        odometry = inputs.get(STATE_ODOMETRY)
        for stance in () if odometry is None else odometry.stances:
            self._outcomes.ended(self.robot.leg_names[stance.foot], stance.slip)
        order = inputs.get(NAVIGATOR_ORDER)
        if order is not None:
            self._take_order(order)
        out = self._held(inputs.tick.held) or self.gait.step(self._inputs(inputs))
        self._out = out
        self._keep()
        position = None if out.command is None else tuple(out.command.tolist())
        self.publish(STATE_GAIT, self._gait(out, order is not None))
        self.publish(CMD_JOINTS, JointCommand(position=position))

    def _held(self, held: bool) -> WalkerOutputs | None:
        """While the driver holds the joints the gait stands still: the last set-points again, until one is obeyed."""
        if not held or self._out is None:
            return None
        reason = f"emergency stop: {self._stopped}" if self._stopped else "the driver holds the joints: no command came"
        return dataclasses.replace(self._out, state="hold", reason=reason)

    def _take_order(self, order: MotionOrder) -> None:
        """Obey a new order of the navigator, none twice; it takes effect in this tick.

        The walker does not learn from such a walk: the navigator estimates drift itself.
        """
        taken, self._order = self._order, self._order.after(order)
        if self._order.number == taken.number or order.command is None:
            return
        reason = "at_tick does not go with an order"
        if order.command.at_tick is None:
            reason = self._command(order.command, learn=False).reason
        self._order = dataclasses.replace(self._order, refused=reason)
        if reason:
            self.log("warning", f"order {order.number} ({order.command.action}) refused: {reason}")

    def _take_map(self, inputs: TickInputs) -> None:
        message = inputs.get(TERRAIN_MAP)
        if message is None or message is self._map:
            return
        self._map = message
        try:
            self.gait.set_map(HeightMap.from_wire(message.model_dump(), message.data))
        except HeightMapError as error:
            self.gait.set_map(None)
            self.log("error", f"terrain/map refused: {error}")

    def _inputs(self, inputs: TickInputs) -> WalkerInputs:
        velocity, odometry = inputs.get(STATE_VELOCITY), inputs.get(STATE_ODOMETRY)
        joints, contacts = inputs.get(HW_JOINTS), inputs.get(HW_CONTACTS)
        stability = inputs.get(STATE_STABILITY)
        if velocity is not None and odometry is not None:
            self._estimate = velocity, odometry
        velocity, odometry = self._estimate or (None, None)  # one may be left out in paced time
        return WalkerInputs(
            stamp=inputs.tick.stamp_ns * 1e-9,
            roll=velocity.roll if velocity else 0.0,
            pitch=velocity.pitch if velocity else 0.0,
            rate=velocity.angular_velocity if velocity else (0.0, 0.0, 0.0),
            x=odometry.position[0] if odometry else 0.0,
            y=odometry.position[1] if odometry else 0.0,
            yaw=odometry.yaw if odometry else 0.0,
            estimate_stamp=velocity.stamp_ns * 1e-9 if velocity else -1.0,
            initialised=velocity.initialised if velocity else False,
            joints=None if joints is None else np.array(joints.position),
            contacts=None if contacts is None else np.array([any(foot) for foot in contacts.touch]),
            margin=None if stability is None else stability.margin_planned,
        )

    def _gait(self, out: WalkerOutputs, navigated: bool) -> GaitState:
        return GaitState(
            walk_id=out.walk_id,
            state=out.state,
            phase=min(1.0, max(0.0, out.phase)),
            stance=tuple(out.stance.tolist()),
            footholds=tuple(map(tuple, out.footholds.tolist())),
            foothold_status=out.foothold_status,
            trunk_height=out.trunk_height,
            remaining=out.remaining,
            margin=out.margin,
            reason=self._degraded or out.reason,
            steps=out.steps,
            order=self._order.number,
            order_refused=self._order.refused,
            ends_in_s=out.ends_in_s if navigated else None,
        )

    # -- questions ---------------------------------------------------------------------------------------------

    def _select(self, step: interface.LandingRequest) -> Sequence[FootholdReply]:
        """Footholds of a step, all legs in one question."""
        if not self.config.ask_footholds:
            return nominal_footholds(step)
        quat = rotations.quat_from_rpy(0.0, 0.0, step.yaw)
        request = SelectRequest(
            epoch=self._epoch,
            tick=self._tick,
            base=BasePose(position=_floats(step.body), quat_wxyz=_floats(quat)),
            legs=tuple(
                LegRequest(leg=self.robot.leg_names[leg.leg], nominal=_floats(leg.nominal), stroke=_floats(leg.stroke))
                for leg in step.legs
            ),
            outcomes=self._outcomes.take(),
        )
        try:
            reply = self.call(FOOTHOLDS_SELECT, request, ANSWER_S)
        except CallError as error:
            self._degraded = f"no foothold advice: {error.message}"
            return [dataclasses.replace(own, status="no_answer") for own in nominal_footholds(step)]
        for asked, leg in zip(request.legs, reply.legs, strict=True):
            self._outcomes.chose(asked, leg)
        return [FootholdReply(leg.status, leg.foothold, leg.trunk_shift, leg.reason) for leg in reply.legs]

    def _check(self, step: interface.StanceCheck) -> interface.StanceVerdict:
        """Whether a step is safe; without an answer the hull of the feet decides."""
        if not self.config.ask_stability:
            return self.own_check(step)
        request = CheckRequest(
            contacts=tuple(
                Contact(position=_floats(p), normal=_floats(n), mu=step.mu, leg=leg)
                for p, n, leg in zip(step.positions, step.normals, step.legs, strict=True)
            ),
            joints=_floats(step.joints),
            base=CheckBase(position=_floats(step.base_position), quat_wxyz=_floats(step.base_quat)),
            movement=_floats(step.movement),
            tolerance_m=REGION_TOLERANCE_M,
        )
        try:
            reply = self.call(STABILITY_CHECK, request, ANSWER_S)
        except CallError as error:
            self._degraded = f"no stability advice: {error.message}"
            return self.own_check(step)
        margins = [value for value in (reply.margin_now, reply.margin) if value is not None]
        return interface.StanceVerdict(
            stable=reply.stable and min(margins, default=0.0) >= 0.0,
            margin=min(margins, default=None),
            status=reply.status,
            region=np.array(reply.inner) if reply.status == "ok" else None,
            com=np.array(reply.com),
            com_after=np.array(reply.com_after),
        )


_TUNABLE = ("hip_height_m", "stride_m", "period_s", "clearance_m")


def _floats(values: Iterable[float]) -> Any:
    """Numbers of an array or sequence as the tuple a message wants; its model checks the length."""
    return tuple(float(value) for value in values)


def _command_of(r: WalkCommand) -> interface.MotionCommand:
    return interface.MotionCommand(r.action, r.distance, r.velocity, r.angle, r.gait, r.duration, r.shift)


def _reply(r: interface.CommandReply) -> WalkReply:
    return WalkReply(accepted=r.accepted, id=r.walk_id, code=r.code, field=r.field, reason=r.reason)


SERVICE = Walker
