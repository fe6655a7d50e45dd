"""Odometry for ROS 2, whose frame `odom` is continuous (REP-105): corrections of the past move the frame instead."""

import math

import numpy as np

from surefoot.arrays import Array
from surefoot.geometry.linear import product
from surefoot.schemas.state import Odometry


class ContinuousOdometry:
    """Converter of the odometry of one estimator to a frame in which corrections of the past cause no jumps."""

    def __init__(self) -> None:
        self._last: Odometry | None = None
        self._frame = (0.0, 0.0, 0.0)
        """Pose of the estimator's frame odom in the published continuous frame odom, x, y (m), heading (rad)."""

    def take(self, message: Odometry) -> Odometry:
        """Return the odometry of a tick in the continuous frame; before the first correction it is unchanged."""
        if self._last is not None and message.corrects(self._last):
            x, y, heading = self._placed(self._last)
            turn = heading - message.yaw
            c, s = math.cos(turn), math.sin(turn)
            px, py, _ = message.position
            self._frame = (x - c * px + s * py, y - s * px - c * py, turn)
        self._last = message
        return message if self._frame == (0.0, 0.0, 0.0) else self._moved(message)

    def _placed(self, message: Odometry) -> tuple[float, float, float]:
        """Return x, y in m and heading in rad of a message in the frame that is published."""
        c, s = math.cos(self._frame[2]), math.sin(self._frame[2])
        x, y, _ = message.position
        return self._frame[0] + c * x - s * y, self._frame[1] + s * x + c * y, self._frame[2] + message.yaw

    def _moved(self, message: Odometry) -> Odometry:
        x, y, yaw = self._placed(message)
        turn = self._frame[2]
        c, s = math.cos(turn), math.sin(turn)
        vx, vy, vz = message.velocity
        (w, i, j, k), ch, sh = message.quat_wxyz, math.cos(0.5 * turn), math.sin(0.5 * turn)
        whole = message.pose_covariance
        update = {
            "position": (x, y, message.position[2]), "yaw": yaw, "velocity": (c * vx - s * vy, s * vx + c * vy, vz),
            "quat_wxyz": (ch * w - sh * k, ch * i - sh * j, ch * j + sh * i, ch * k + sh * w),
            "covariance": turned(message.covariance, turn),
            "pose_covariance": None if whole is None else turned(whole, turn),
        }  # fmt: skip
        return message.model_copy(update=update)


def turned(covariance: tuple[float, ...], turn: float) -> tuple[float, ...]:
    """Return a row-major covariance in axes turned about the vertical.

    Args:
        covariance: that of x, y, z (m) and yaw (rad), 16 numbers, or of x, y, z and rotation about x, y, z, 36 numbers.
        turn: turn of the axes of `covariance` against those of the result, rad.
    """
    n = math.isqrt(len(covariance))
    rot: Array = np.eye(n)
    c, s = math.cos(turn), math.sin(turn)
    for i in range(0, n - 1, 3):
        rot[i : i + 2, i : i + 2] = (c, -s), (s, c)
    whole = product(product(rot, np.array(covariance).reshape(n, n)), rot.T)
    return tuple(whole.ravel().tolist())
