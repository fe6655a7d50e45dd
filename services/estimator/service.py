"""The estimator service: hardware samples in, velocity, tilt and odometry out."""

import numpy as np

from surefoot.lockstep.join import TickInputs
from surefoot.lockstep.service import Service
from surefoot.robot.reader import load_robot
from surefoot.schemas import topics
from surefoot.schemas.hw import FootContacts, JointState

from .config import EstimatorConfig
from .feet.contact import touch_rows
from .feet.faulty import leg_faults
from .feet.mount import foot_mount
from .feet.slip import FinishedStance, StanceSlip, feet_in_odom
from .inputs.results import InputResult
from .messages import odometry_message, sample_of, velocity_message
from .rehearsal import rehearse, rehearse_log

LATE_JOINTS_S = 0.03
"""Largest age of joint angles with which slip is measured, s: poses at the time of older ones are not stored."""
LATE_TICK = 100
"""Number of the tick above which a service that joins an epoch does not rely on the stated start pose."""

VARIANTS = {
    "imu": topics.STATE_VELOCITY_IMU,
    "kinematics": topics.STATE_VELOCITY_KINEMATICS,
    "kinematics_gyro": topics.STATE_VELOCITY_KINEMATICS_GYRO,
    "ekf": topics.STATE_VELOCITY_EKF,
}


class EstimatorService(Service[EstimatorConfig]):
    """Service that publishes velocity, tilt and odometry, by `best` and by the estimators of Wawrzynski et al."""

    name = "estimator"
    Config = EstimatorConfig
    inputs = (topics.HW_IMU, topics.HW_JOINTS, topics.HW_CONTACTS, topics.HW_EXTERNAL)
    outputs = (topics.STATE_VELOCITY, topics.STATE_ODOMETRY, *VARIANTS.values())

    def on_start(self) -> None:
        self._robot = load_robot(self.config.robot)
        self.estimator = self.config.estimator(self._robot)
        self._mount = foot_mount(self._robot)
        self._begin()

    def _begin(self) -> None:
        self._contacts: FootContacts | None = None
        self._first = True
        self._slip = StanceSlip(len(self._mount.radius), self._mount.radius)
        self._faults = leg_faults(self._robot)
        self._stances: list[FinishedStance] = []

    def rehearse(self) -> None:
        rehearse(self.config, load_robot(self.config.robot), (self.config.mode, *self.config.modes))

    def rehearse_rare(self) -> None:
        rehearse_log(self.config, load_robot(self.config.robot))

    def on_reset(self) -> None:
        self.estimator.reset()
        self._begin()

    def on_tick(self, inputs: TickInputs) -> None:
        if self._first and inputs.number > LATE_TICK:
            self.estimator.reset(stated=False)
        self._first = False
        imu, joints, contacts = inputs.get(topics.HW_IMU), inputs.get(topics.HW_JOINTS), inputs.get(topics.HW_CONTACTS)
        external = inputs.get(topics.HW_EXTERNAL)
        if imu is not None:
            self._log("imu", self.estimator.imu(imu.stamp_ns, imu.gyro, imu.acc, imu.saturated))
        if contacts is not None:
            self._contacts = contacts
        if joints is not None and self._contacts is not None:
            self._kinematics(joints, self._contacts)
        if external is not None:
            self._log("external", self.estimator.external(external.stamp_ns, sample_of(external)))
        e = self.estimator
        e.silent = {key: age for key, age in inputs.late.items() if key != topics.HW_EXTERNAL.key}  # it may come and go
        self.publish(topics.STATE_VELOCITY, velocity_message(e.estimate(self.config.mode)), e.stamp_ns)
        if topics.STATE_ODOMETRY.due(inputs.number):
            self.publish(topics.STATE_ODOMETRY, odometry_message(e.pose(), e.initialised, self._stances), e.stamp_ns)
            self._stances = []
        for name in self.config.modes:
            if (topic := VARIANTS[name]).due(inputs.number):
                self.publish(topic, velocity_message(e.estimate(name)), e.stamp_ns)

    def _kinematics(self, joints: JointState, contacts: FootContacts) -> None:
        touch = touch_rows(contacts.touch)
        q, e = np.array(joints.position), self.estimator
        result = e.joints(joints.stamp_ns, q, touch)
        self._log("kinematics", result)
        behind_s = 1e-9 * (e.stamp_ns - joints.stamp_ns)
        if result is InputResult.OK and e.initialised and -topics.TICK_S < behind_s < LATE_JOINTS_S:
            feet, closed = feet_in_odom(self._mount, e.seen, e.pose(), behind_s), np.asarray(touch.any(axis=1))
            faulty = self._faults.update(q, joints.stamp_ns, closed, self._slip.risen(feet[0]))
            self._stances += self._slip.update(closed, *feet, faulty | e.wrong_legs)

    def _log(self, source: str, result: InputResult) -> None:
        """Log the first refusal of each kind from a source; further ones are only counted."""
        if not result.accepted and self.estimator.check.counts[f"{source}_{result}"] == 1:
            self.log("warning", f"{source} refused: {result}")


SERVICE = EstimatorService
