"""Conversion between messages on the bus and the elevation map."""

import math
from base64 import b64decode, b64encode
from collections.abc import Mapping

import numpy as np

from surefoot.arrays import Array
from surefoot.errors import Refusal
from surefoot.geometry.linear import product
from surefoot.geometry.rotations import matrix_from_quat
from surefoot.robot.description import Robot
from surefoot.robot.kinematics import foot_positions
from surefoot.schemas.hw import DepthImage, FootContacts, JointState
from surefoot.schemas.state import Odometry
from surefoot.schemas.terrain import ElevationMap

from .mapper import UNKNOWN_TILT, DepthView, Mapper, MapPose


def map_pose(odometry: Odometry) -> MapPose:
    """Return pose and covariance of an odometry message; variances of roll and pitch that it lacks are 1e-4 rad^2."""
    if odometry.pose_covariance is not None:
        covariance = np.array(odometry.pose_covariance).reshape(6, 6)
    else:
        covariance = np.diag((0.0, 0.0, 0.0, UNKNOWN_TILT, UNKNOWN_TILT, 0.0))
        at = np.array([0, 1, 2, 5])
        covariance[np.ix_(at, at)] = np.array(odometry.covariance).reshape(4, 4)
    rot = matrix_from_quat(np.array(odometry.quat_wxyz))
    return MapPose(odometry.stamp_ns, np.array(odometry.position), rot, covariance)


def standing_points(robot: Robot, pose: MapPose, joints: JointState, contacts: FootContacts) -> Array:
    """Return the ground points under the feet with a pressed switch, (n, 3) m, frame of `pose`.

    Args:
        robot: robot, whose legs and foot radius are read.
        pose: pose of base_link.
        joints: angles of the joints.
        contacts: switches of the feet.
    """
    down = np.array([any(foot) for foot in contacts.touch])
    feet = foot_positions(robot.model, np.array(joints.position))[down]
    return product(feet, pose.rot.T) + pose.position - np.array([0.0, 0.0, robot.foot_radius])


def depth_view(image: DepthImage) -> DepthView:
    """Return the depths of an image message, with the camera's intrinsics, noise and pose.

    Raises:
        Refusal: the data is no base64, or not one float32 a pixel.
    """
    try:
        data = b64decode(image.depths, validate=True)
    except ValueError as error:
        raise Refusal("depths", f"depths are no base64: {error}") from None
    if len(data) != 4 * image.width * image.height:
        need = 4 * image.width * image.height
        raise Refusal("depths", f"{image.width} x {image.height} depths need {need} bytes, got {len(data)}")
    depths = np.frombuffer(data, dtype="<f4").astype(np.float64).reshape(image.height, image.width)
    return DepthView(
        image.stamp_ns, depths, image.focal, image.center, image.sigma, image.sigma_square, image.frame,
        np.array(image.position), np.array(image.quat_wxyz),
    )  # fmt: skip


def depth_words(turned: float, scale: float) -> str:
    """Return the log text on a camera turned by `turned`, rad, with depths `scale` times the true ones."""
    angle, off = round(math.degrees(turned), 1), round(100.0 * (scale - 1.0))
    parts = [f"turned by {angle:.1f} deg"] * (angle != 0.0) + [f"depths {off:+d} % off"] * (off != 0)
    if not parts:
        return "the depth camera is as stated again"
    return f"the depth camera is not as stated: {', '.join(parts)}; its images are corrected"


def elevation_message(mapper: Mapper, refused: Mapping[str, int]) -> ElevationMap:
    """Return the map as a message; before the first height is known, it has one unknown cell.

    `refused`: number of images refused, by reason.
    """
    found = mapper.heights()
    heights, variances = found or (np.full((1, 1), np.nan), np.full((1, 1), np.nan))
    return ElevationMap(
        rows=heights.shape[0], cols=heights.shape[1], cell=mapper.params.cell, origin=mapper.origin,
        version=mapper.images, heights=_text(heights), variances=_text(variances), refused=dict(refused),
    )  # fmt: skip


def _text(layer: Array) -> str:
    return b64encode(layer.astype("<f4").tobytes()).decode()
