"""Set-points of a biped's servos from the plan of a tick: the posture of all links, sag and lag of the servos, the
trunk's rate at the standing ankles and its lean at the swinging one.
"""

import numpy as np

from surefoot.arrays import Array
from surefoot.geometry.constants import GRAVITY
from surefoot.robot import kinematics
from surefoot.robot.description import Robot
from surefoot.schemas.topics import TICK_S

from . import posture
from .feedback import felt_rate
from .ik import LegGeometry
from .landing import set_down
from .params import BipedParams
from .plan import between, smooth
from .state import BipedState, Mode


class SetPoints:
    """Set-points of the servos that hold the trunk for the planned centre of mass and compensate the servos' load.

    Args:
        robot: the robot.
        geometry: geometry of the robot's legs.
        params: crouch and lean of the stance.
        feet: (2, 4) x, y, yaw, height of the soles under the hips, m and rad, origin between them.
        middle: horizontal position of the CoM at rest over the soles, (2,) m, from the origin of `feet`.
    """

    def __init__(self, robot: Robot, geometry: LegGeometry, params: BipedParams, feet: Array, middle: Array) -> None:
        self.robot, self.geometry = robot, geometry
        g = geometry
        self.height = params.crouch * (g.thigh + g.shin) + g.ankle - float(g.hip[0, 2])
        """Height of base_link over the soles, m."""
        self._kp = np.array([joint.servo.kp for joint in robot.joints])
        self._kv = np.array([joint.servo.kv for joint in robot.joints])
        self._tilt = np.array([0.0, params.lean_rad])
        self.stance = robot.neutral.copy()
        """Joint angles with both feet under the hips, (nj,) rad."""
        trunk = np.array([0.0, 0.0, 0.0, self.height])
        for _ in range(5):
            posture.place_com(robot.model, g, self.stance, feet, trunk, self._tilt, middle)
        self.com_height = float(self.height + kinematics.com(robot.model, self.stance)[2])
        """Height of the CoM over the soles, m."""

    def follow(self, s: BipedState, p: BipedParams, soles: Array, double: int) -> None:
        """Set joint angles and set-points of this tick in the state `s`.

        Args:
            s: state; trunk, angles, command and the correction of the landing are written.
            p: settings.
            soles: left and right by plan, (2, 4) x, y, yaw, height, m and rad, odom.
            double: ticks of a step in which both feet bear load.
        """
        s.trunk[2] = between(soles)[2]
        s.trunk[3] = self.height
        soles, turns = set_down(s, p, soles, double)
        q = s.q.copy()
        _, reachable, rot = posture.place_com(self.robot.model, self.geometry, q, soles, s.trunk, self._tilt, s.x[0])
        s.unreachable = 0 if reachable else 1
        zmp = s.x[0] - self.com_height / GRAVITY * s.x[2]
        share = posture.load_share(zmp, soles)
        if s.mode is Mode.STEP and s.step is not None and s.clock > double:
            share = np.zeros(2)
            share[1 - s.step.swing] = 1.0
        points = soles[:, :2] if share.min() > 0.0 else np.stack((zmp, zmp))
        push = np.array([s.x[2, 0], s.x[2, 1], GRAVITY])
        torque = posture.load_torques(self.robot.model, q, rot, s.trunk, push, share, np.ascontiguousarray(points))
        command = (
            q
            + p.sag * torque / self._kp
            + p.lag * (self._kv / self._kp) * np.clip((q - s.q) / TICK_S, -p.lag_limit, p.lag_limit)
        )
        joints = self.geometry.joints
        rate = felt_rate(s)
        command[joints[:, 5]] += p.gyro_s * share * rate[0] - turns[:, 0]
        command[joints[:, 4]] += p.gyro_s * share * rate[1] - turns[:, 1]
        s.q = q
        if s.mode is Mode.RISE and s.rise_from is not None:
            part = smooth(s.clock * TICK_S / p.rise_s)
            command = s.rise_from + part * (command - s.rise_from)
        s.command = np.clip(command, self.robot.joint_lower, self.robot.joint_upper)
