"""Stability service: answers the queries `stability/...`, and watches the margin while the robot walks."""

import math

import numpy as np

from surefoot.lockstep.join import Delayed, TickInputs
from surefoot.lockstep.service import Service
from surefoot.robot.reader import load_robot
from surefoot.schemas import topics
from surefoot.schemas.hw import FootContacts, JointState
from surefoot.schemas.state import VelocityEstimate

from .answers import check_reply, com_reply, equilibrium_reply, no_status, region_reply, status_message
from .config import StabilityConfig
from .job import CalibrationJob
from .rehearsal import rehearse, rehearse_rare
from .sensing import state
from .workers import Workers, answered

STALE_NS = 100_000_000
"""Age of an input, ns, above which the status is published as not fresh."""

LEAST_GRAVITY = 1.0
"""Length of the estimated gravity g_up, m/s^2, up to which it gives no direction and no status is computed."""


class Stability(Service[StabilityConfig]):
    """Service that computes where the centre of mass may be, and how far it is from the edge."""

    name = "stability"
    Config = StabilityConfig
    inputs = (topics.HW_JOINTS, topics.HW_CONTACTS, topics.STATE_VELOCITY, Delayed(topics.STATE_GAIT))
    outputs = (topics.STATE_STABILITY,)
    serves = (
        topics.STABILITY_REGION,
        topics.STABILITY_CHECK,
        topics.STABILITY_COM,
        topics.STABILITY_WHATIF,
        topics.STABILITY_EQUILIBRIUM,
        topics.STABILITY_BATCH,
        topics.STABILITY_CALIBRATE,
    )

    def on_start(self) -> None:
        """Load the robot and register the handlers of the queries."""
        self.robot = load_robot(self.config.robot)
        self.params = self.config.watch()
        self.workers = Workers()
        self.on_reset()
        self.handle(topics.STABILITY_REGION, answered(lambda r: region_reply(r, self.robot)))
        self.handle(topics.STABILITY_CHECK, answered(lambda r: check_reply(r, self.robot)))
        self.handle(topics.STABILITY_COM, answered(lambda r: com_reply(r, self.robot)))
        self.handle(topics.STABILITY_WHATIF, self.workers.whatif)
        self.handle(topics.STABILITY_EQUILIBRIUM, answered(equilibrium_reply))
        self.handle(topics.STABILITY_BATCH, self.workers.batch)
        self.handle(topics.STABILITY_CALIBRATE, answered(lambda r: self.calibration.answer(r)))

    def rehearse(self) -> None:
        """Answer made-up requests, and compute the status of made-up stances."""
        rehearse(self.robot, self.params)

    def rehearse_rare(self) -> None:
        """Run the rare queries once, a batch and the servos' limits, so that their kernels are compiled."""
        rehearse_rare(self.robot)

    def on_reset(self) -> None:
        """Reset joints, contacts, tilt and calibration, because time begins anew (a new epoch)."""
        self._joints: JointState | None = None
        self._contacts: FootContacts | None = None
        self._velocity: VelocityEstimate | None = None
        self._standing = state.StandingFeet(len(self.robot.legs), self.params.hold_s)
        self._closed: state.Flags | None = None
        self._touch: state.Flags | None = None
        self.calibration = CalibrationJob(self.robot, self.params.torque_variance)

    def on_config(self) -> None:
        """Apply new parameters of the configuration from the next status on."""
        self.params = self.config.watch()

    def on_tick(self, inputs: TickInputs) -> None:
        """Store the latest samples; publish the status every second tick."""
        self._joints = inputs.get(topics.HW_JOINTS) or self._joints
        self._velocity = inputs.get(topics.STATE_VELOCITY) or self._velocity
        if (contacts := inputs.get(topics.HW_CONTACTS)) is not None:
            self._contacts = contacts
            self._closed = np.array([True in foot for foot in contacts.touch])
        if self._closed is not None:
            gait = inputs.get(topics.STATE_GAIT)
            planned = None if gait is None or gait.state == "waiting" else np.array(gait.stance)
            self._touch = self._standing.update(inputs.tick.stamp_ns * 1e-9, self._closed, planned)
        if report := self.calibration.on_tick(inputs.number):
            self.log("info", f"calibration: {report}")
        if self.calibration.collector is not None and inputs.get(topics.HW_JOINTS) is not None:
            self._collect()
        if not topics.STATE_STABILITY.due(inputs.number):
            return
        joints, contacts, velocity, touch = self._joints, self._contacts, self._velocity, self._touch
        if joints is None or contacts is None or velocity is None or touch is None or not _points_up(velocity.g_up):
            self.publish(topics.STATE_STABILITY, no_status(len(self.robot.legs), self.config.mu))
            return
        oldest = min(joints.stamp_ns, contacts.stamp_ns, velocity.stamp_ns)
        torque = np.array(joints.torque) if joints.torque is not None and self.config.measured_com else None
        if torque is not None and self.calibration.gain is not None:
            torque = self.calibration.gain * torque
        now = state.watch(self.robot, np.array(joints.position), touch, np.array(velocity.g_up), torque, self.params)
        fresh = inputs.tick.stamp_ns - oldest <= STALE_NS
        self.publish(topics.STATE_STABILITY, status_message(now, self.config.mu, fresh), joints.stamp_ns)

    def on_stop(self) -> None:
        """End the threads that answer queries."""
        self.workers.stop()

    def _collect(self) -> None:
        """Pass the latest samples to the calibration in progress."""
        joints, closed, velocity = self._joints, self._closed, self._velocity
        if joints is None or joints.torque is None or closed is None or velocity is None:
            return
        if velocity.initialised and _points_up(velocity.g_up):
            now = np.array(joints.position), np.array(joints.torque), np.array(velocity.g_up)
            self.calibration.sample(*now, closed)


def _points_up(g_up: tuple[float, float, float]) -> bool:
    """Return True if the estimator knows the direction up: g_up, base_link, m/s^2, is longer than 1."""
    return math.hypot(*g_up) > LEAST_GRAVITY


SERVICE = Stability
