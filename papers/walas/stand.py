"""Robot that stands in the simulator and moves its trunk over its feet, with its sensor readings at rest.

The simulated servos have the constant of the corrected paper, 0.6356 Nm/A; the driver uses the data sheet's
0.845. So a reported torque is 1.33 times the true one, and the factor to be found is 0.7522.
"""

import math
from dataclasses import dataclass

import numpy as np

from surefoot.arrays import Array
from surefoot.geometry.constants import GRAVITY
from surefoot.geometry.rotations import matrix_from_quat, matrix_from_rpy
from surefoot.robot.description import Robot
from surefoot.robot.kinematics import foot_positions, legs_ik
from surefoot.services.estimator.feet.contact import touch_rows
from surefoot.services.estimator.stream import Estimator
from surefoot.services.simulator.ground.terrain import make_terrain
from surefoot.services.simulator.world import PhysicsWorld, WorldConfig
from surefoot.services.stability.sensing.calibration import SweptPose, level_from_up

DATA_SHEET = 0.845  # Nm/A, (29)
MOVE_SPEED = 0.05  # m/s, of the trunk while it moves over its feet
REST_S, MEAN_S = 1.0, 0.6  # waiting after a movement, and time over which a reading is the mean


@dataclass(frozen=True)
class Reading:
    """Mean sensor readings of the robot at rest, with the true centre of mass, trunk and forces."""

    joints: Array  # (nj,) rad
    current: Array  # (nj,) A
    load: Array  # (L,) N, pressure sensors
    g_up: Array  # (3,) m/s2, by the estimator (exact without noise)
    com: Array  # (2,) m, true, from the mean foot, along the trunk's heading
    trunk: Array  # (2,) m, true, along the heading at the start
    force: Array  # (L, 3) N, true, heading axes

    @property
    def rot(self) -> Array:
        """Rotation rot_level_from_base (3, 3) by the measured tilt; x along the trunk's heading."""
        return level_from_up(self.g_up / np.linalg.norm(self.g_up))

    def pose(self, nm_per_a: float = DATA_SHEET) -> SweptPose:
        """Return posture and torques as a sample for the calibration; `nm_per_a`: torque by current, Nm/A."""
        return SweptPose(self.joints, nm_per_a * self.current, self.g_up, np.ones(len(self.load), dtype=np.bool_))


class Stand:
    """Simulated robot that stands and moves its trunk over its feet."""

    def __init__(self, robot: Robot, seed: int = 0, *, ideal: bool = False, gain: float = 1.0) -> None:
        self.robot = robot
        true = gain * robot.current.torque_per_ampere
        config = WorldConfig(imu_profile="ideal" if ideal else None, torque_per_ampere=true)
        self.world = PhysicsWorld(robot, make_terrain("flat"), seed, config)
        self.estimator = None if ideal else Estimator.for_robot(robot)
        self.feet = foot_positions(robot.model, robot.neutral)
        self.place, self.tilt = np.zeros(3), np.zeros(2)
        self.wait(REST_S)

    def wait(self, seconds: float) -> None:
        """Simulate for `seconds` s while the servos hold their set-points."""
        for _ in range(round(100.0 * seconds)):
            self._tick(None)

    def _tick(self, command: Array | None) -> None:
        self.world.step_tick(command)
        if self.estimator is None:
            return
        s = self.world.samples
        if s.imu is not None:
            self.estimator.imu(s.imu.stamp_ns, s.imu.gyro, s.imu.acc)
        if s.joints is not None and s.contacts is not None:
            self.estimator.joints(s.joints.stamp_ns, s.joints.position, touch_rows(s.contacts.touch))

    def _up(self) -> Array:
        if self.estimator is None:
            return matrix_from_quat(self.world.truth().quat_wxyz)[2]
        return self.estimator.estimate().g_up

    def move(self, place: tuple[float, float, float] = (0.0, 0.0, 0.0), tilt: tuple[float, float] = (0.0, 0.0)) -> None:
        """Bring the trunk slowly to a place (m) and to roll and pitch (rad) while the feet stay, then wait."""
        start, from_tilt = self.place, self.tilt
        far = max(float(np.linalg.norm(np.array(place) - start)), 0.2 * float(np.linalg.norm(tilt - from_tilt)))
        steps = max(1, round(100.0 * far / MOVE_SPEED))
        for k in range(1, steps + 1):
            self.place = start + (np.array(place) - start) * k / steps
            self.tilt = from_tilt + (np.array(tilt) - from_tilt) * k / steps
            rot = matrix_from_rpy(float(self.tilt[0]), float(self.tilt[1]), 0.0)
            q, reached = legs_ik(self.robot.model, np.ascontiguousarray((self.feet - self.place) @ rot))
            if not reached.all():
                raise ValueError(f"{self.robot.name} cannot reach its feet at {place}, tilt {tilt}")
            self._tick(q)
        self.wait(REST_S)

    def read(self, seconds: float = MEAN_S) -> Reading:
        """Return the mean of the sensors over a time, s, while the robot stands."""
        joints, current, load, up = [], [], [], []
        for _ in range(round(100.0 * seconds)):
            self._tick(None)
            s = self.world.samples
            up.append(self._up())
            if s.joints is not None:
                joints.append(s.joints.position)
                current.append(s.joints.current)
            if s.contacts is not None and s.contacts.normal_force is not None:
                load.append(s.contacts.normal_force)
        g_up, truth = np.mean(up, axis=0), self.world.truth()
        rot = matrix_from_quat(truth.quat_wxyz)
        yaw = math.atan2(rot[1, 0], rot[0, 0])
        back = np.array([[math.cos(yaw), math.sin(yaw)], [-math.sin(yaw), math.cos(yaw)]])
        force = truth.foot_force.copy()
        force[:, :2] = force[:, :2] @ back.T
        return Reading(
            joints=np.mean(joints, axis=0),
            current=np.mean(current, axis=0),
            load=np.mean(load, axis=0) if load else np.full(self.robot.nlegs, np.nan),
            g_up=GRAVITY * g_up / np.linalg.norm(g_up),
            com=back @ (truth.com - truth.foot_position.mean(axis=0))[:2],
            trunk=back @ truth.position[:2],
            force=force,
        )
