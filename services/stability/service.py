"""Stability service: answers the queries `stability/...`, and watches the margin while the robot walks."""

import math
import threading
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from typing import TypeVar

import numpy as np

from surefoot.errors import Refusal
from surefoot.lockstep.join import Delayed, TickInputs
from surefoot.lockstep.service import Service
from surefoot.robot.reader import load_robot
from surefoot.schemas.base import Reply, Request
from surefoot.schemas.hw import FootContacts, JointState
from surefoot.schemas.stability import StabilityStatus
from surefoot.schemas.state import VelocityEstimate
from surefoot.schemas.topics import (
    HW_CONTACTS,
    HW_JOINTS,
    STABILITY_BATCH,
    STABILITY_CALIBRATE,
    STABILITY_CHECK,
    STABILITY_COM,
    STABILITY_EQUILIBRIUM,
    STABILITY_REGION,
    STABILITY_WHATIF,
    STATE_GAIT,
    STATE_STABILITY,
    STATE_VELOCITY,
)
from surefoot.schemas.whatif import BatchReply, BatchRequest, WhatifReply, WhatifRequest

from .config import StabilityConfig
from .programs.clarabel_tools import clarabel_and_sparse
from .programs.contacts import StabilityError
from .queries.answers import (
    batch_reply,
    com_reply,
    equilibrium_reply,
    whatif_reply,
)
from .queries.beyond import region_answer
from .queries.check_query import check_reply
from .queries.job import CalibrationJob
from .regions import many
from .rehearsal import rehearse, rehearse_rare
from .sensing import state

Req = TypeVar("Req", bound=Request)
Rep = TypeVar("Rep", bound=Reply)

STALE_NS = 100_000_000
"""An input older than that makes the status not fresh."""

LEAST_GRAVITY = 1.0
"""m/s^2; a shorter g_up is no direction."""

LATER_S = 1.0
"""s after the start: what is imported for odd contact sets only is imported then, on another thread; it takes 0.2 s."""

AT_ONCE = 32
"""Sets of a batch that are worked out between two ticks, about 1 ms; more go to another thread."""

MOST_WAITING = 8
"""Batches that may wait for that thread."""


class Stability(Service[StabilityConfig]):
    """Tells where the centre of mass may be, and how far it is from the edge."""

    name = "stability"
    Config = StabilityConfig
    inputs = (HW_JOINTS, HW_CONTACTS, STATE_VELOCITY, Delayed(STATE_GAIT))
    outputs = (STATE_STABILITY,)
    serves = (
        STABILITY_REGION,
        STABILITY_CHECK,
        STABILITY_COM,
        STABILITY_WHATIF,
        STABILITY_EQUILIBRIUM,
        STABILITY_BATCH,
        STABILITY_CALIBRATE,
    )

    def on_start(self) -> None:
        """Load the robot, register the handlers."""
        self.robot = load_robot(self.config.robot)
        self.params = self.config.watch()
        self._timer = threading.Timer(LATER_S, clarabel_and_sparse)
        self._timer.daemon = True
        self._timer.start()
        self._worker = ThreadPoolExecutor(1, "batch", initializer=many.be_nice)
        self._waiting = threading.BoundedSemaphore(MOST_WAITING)
        self.on_reset()
        self.handle(STABILITY_REGION, _answer(lambda r: region_answer(r, self.robot)))
        self.handle(STABILITY_CHECK, _answer(lambda r: check_reply(r, self.robot)))
        self.handle(STABILITY_COM, _answer(lambda r: com_reply(r, self.robot)))
        self.handle(STABILITY_WHATIF, self._whatif)
        self.handle(STABILITY_EQUILIBRIUM, _answer(equilibrium_reply))
        self.handle(STABILITY_BATCH, self._batch)
        self.handle(STABILITY_CALIBRATE, _answer(lambda r: self.calibration.answer(r)))

    def rehearse(self) -> None:
        """Answer made-up requests, and judge made-up stances."""
        rehearse(self.robot, self.params)

    def rehearse_rare(self) -> None:
        """Answer a batch, and ask what the servos can hold."""
        rehearse_rare(self.robot)

    def on_reset(self) -> None:
        """A new epoch: forget joints, contacts, tilt."""
        self._joints: JointState | None = None
        self._contacts: FootContacts | None = None
        self._velocity: VelocityEstimate | None = None
        self._standing = state.StandingFeet(len(self.robot.legs), self.params.hold_s)
        self._closed: state.Flags | None = None
        self._touch: state.Flags | None = None
        self.calibration = CalibrationJob(self.robot, self.params.torque_variance)

    def on_tick(self, inputs: TickInputs) -> None:
        """Keep the latest samples; every second tick say how the robot stands."""
        self._joints = inputs.get(HW_JOINTS) or self._joints
        self._velocity = inputs.get(STATE_VELOCITY) or self._velocity
        if (contacts := inputs.get(HW_CONTACTS)) is not None:
            self._contacts = contacts
            self._closed = np.array([any(foot) for foot in contacts.touch])
        if self._closed is not None:
            gait = inputs.get(STATE_GAIT)
            planned = None if gait is None or gait.state == "waiting" else np.array(gait.stance)
            self._touch = self._standing.update(inputs.tick.stamp_ns * 1e-9, self._closed, planned)
        if said := self.calibration.on_tick(inputs.number):
            self.log("info", f"calibration: {said}")
        if self.calibration.collector is not None and inputs.get(HW_JOINTS) is not None:
            self._collect()
        if not STATE_STABILITY.due(inputs.number):
            return
        joints, contacts, velocity, touch = self._joints, self._contacts, self._velocity, self._touch
        if joints is None or contacts is None or velocity is None or touch is None or not _points_up(velocity.g_up):
            self.publish(STATE_STABILITY, self._nothing())
            return
        oldest = min(joints.stamp_ns, contacts.stamp_ns, velocity.stamp_ns)
        torque = np.array(joints.torque) if joints.torque is not None and self.config.measured_com else None
        if torque is not None and self.calibration.gain is not None:
            torque = self.calibration.gain * torque
        now = state.watch(self.robot, np.array(joints.position), touch, np.array(velocity.g_up), torque, self.params)
        fresh = inputs.tick.stamp_ns - oldest <= STALE_NS
        self.publish(STATE_STABILITY, status_message(now, self.config.mu, fresh), joints.stamp_ns)

    def on_stop(self) -> None:
        """End the threads."""
        self._worker.shutdown(wait=False, cancel_futures=True)

    def _batch(self, request: BatchRequest) -> BatchReply | Future[BatchReply]:
        """Answer to `stability/batch`, of large ones later."""
        large = max(len(request.sets), len(request.counts)) > AT_ONCE
        return self._aside(_answer(batch_reply), request) if large else self._soon(_answer(batch_reply), request)

    def _whatif(self, request: WhatifRequest) -> WhatifReply | Future[WhatifReply]:
        """Answer to `stability/whatif`."""
        return self._soon(_answer(whatif_reply), request)

    def _soon(self, answer: Callable[[Req], Rep], request: Req) -> Rep | Future[Rep]:
        """Answer with the kernel of many sets: at once, but on the other thread as long as it is not compiled."""
        return answer(request) if many.loaded() else self._aside(answer, request)

    def _aside(self, answer: Callable[[Req], Rep], request: Req) -> Future[Rep]:
        """Answer on the thread of batches."""
        if not self._waiting.acquire(blocking=False):
            raise Refusal("busy", f"{MOST_WAITING} batches wait already; ask again later")
        found: Future[Rep] = self._worker.submit(answer, request)
        found.add_done_callback(lambda _: self._waiting.release())
        return found

    def _collect(self) -> None:
        """Show the calibration the latest samples."""
        joints, closed, velocity = self._joints, self._closed, self._velocity
        if joints is None or joints.torque is None or closed is None or velocity is None:
            return
        if velocity.initialised and _points_up(velocity.g_up):
            now = np.array(joints.position), np.array(joints.torque), np.array(velocity.g_up)
            self.calibration.sample(*now, closed)

    def _nothing(self) -> StabilityStatus:
        return StabilityStatus(
            status="infeasible",
            stance=(False,) * len(self.robot.legs),
            region=(),
            com_planned=None,
            com_measured=None,
            margin_planned=None,
            margin_measured=None,
            mu=self.config.mu,
            fresh=False,
        )


def _points_up(g_up: tuple[float, float, float]) -> bool:
    """Whether the estimator knows where up is."""
    return math.hypot(*g_up) > LEAST_GRAVITY


def status_message(now: state.Status, mu: float, fresh: bool) -> StabilityStatus:
    """A status as it travels."""
    measured = now.com_measured
    return StabilityStatus(
        status=now.region.status,
        stance=tuple(now.stance.tolist()),
        region=tuple(map(tuple, now.region.inner.tolist())),  # pyright: ignore[reportArgumentType] - rows of two
        com_planned=(float(now.com_planned[0]), float(now.com_planned[1])),
        com_measured=None if measured is None else (float(measured.com[0]), float(measured.com[1])),
        margin_planned=now.margin_planned.value,
        margin_measured=None if now.margin_measured is None else now.margin_measured.value,
        weight_n=None if measured is None else measured.weight,
        mu=mu,
        fresh=fresh,
    )


def _answer(handler: Callable[[Req], Rep]) -> Callable[[Req], Rep]:
    """A handler whose typed errors become refusals."""

    def answer(request: Req) -> Rep:
        try:
            return handler(request)
        except StabilityError as error:
            raise Refusal(error.code, str(error), error.field) from None

    return answer


SERVICE = Stability
