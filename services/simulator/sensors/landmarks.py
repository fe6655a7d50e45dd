"""Landmarks on the floor as a robot's camera sees them: range, bearing and a descriptor of each that is recognised.

No images: a landmark in the camera's footprint is recognised with a probability that falls with the length of its own
motion blur. With p = (X, Y, Z) the landmark in camera axes (x right, y down, z ahead), x = X/Z, y = Y/Z, v and w the
camera's velocity and rate in those axes and f the focal length in pixels, the image flow is

    x' = (-v_x + x v_z)/Z + x y w_x - (1 + x^2) w_y + y w_z
    y' = (-v_y + y v_z)/Z + (1 + y^2) w_x - x y w_y - x w_z

(Chaumette & Hutchinson 2006), the blur b = f |(x', y')| t, t the exposure, and the probability p0 exp(-(b/b0)^2 / 2).
"""

import math
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from surefoot.arrays import Array
from surefoot.geometry.linear import exp, product
from surefoot.geometry.rotations import matrix_from_quat
from surefoot.robot.description import Robot, RobotError
from surefoot.robot.kinematics import foot_positions, forward
from surefoot.robot.profiles import CameraFile, read_profile
from surefoot.schemas.topics import HW_LANDMARKS

from ..ground.grid import random_stream
from ..ground.terrain import Terrain
from ..physics.samples import Detection
from .rate import period_ms

DESCRIPTOR = 8  # numbers in a descriptor
CAMERA_AXES = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])  # rot_link_from_camera, looking ahead
NEAREST = 0.05  # m, of a point before the camera
NOISE_BLUR = 9  # a third of the blur that hides a landmark blurs its place
GOAL_SHARP = 3.0  # a goal marker is big: it stands this many times the blur


@dataclass(frozen=True, eq=False)
class Camera:
    """Properties of a camera that points at the floor, SI; width and height in pixels, period in ms.

    `detect` is the probability that a landmark in a sharp image is recognised, `most` the largest number of them in an
    image.
    """

    name: str
    link: str
    position: Array  # (3,) m in that link
    pitch: float  # rad, downwards
    width: int
    height: int
    focal: float  # px
    period_ms: int
    exposure: float  # s
    detect: float
    blur: float  # px
    most: int
    range_sigma: float  # part of the range
    bearing_sigma: float  # rad
    descriptor_sigma: float
    range_noise: float = 0.0
    """Standard deviation of a range that does not grow with the range, m; added to the part by `range_sigma`."""
    still: float = 1.0
    """Share of the noise of range and bearing that remains in a sharp image, 0..1; the rest comes with motion blur."""
    tilt_blind: bool = False
    """True if positions are computed as if the trunk were level and at its height in the neutral stance, False if its
    true pose is used."""


class Landmarks(NamedTuple):
    """Landmarks on the floor: positions (n, 2) m, frame map, and descriptors (n, k), unit vectors."""

    position: Array  # (n, 2) m
    descriptor: Array  # (n, DESCRIPTOR) unit vectors


class Spot(NamedTuple):
    """Point of the floor that an image shows: its place in the map and in camera axes, and how sharp it is."""

    point: Array  # (2,) m, map
    local: Array  # (3,) m, camera axes
    sharp: float  # 0..1, 1 = no blur


class CameraPose(NamedTuple):
    """Pose of a camera and of base_link in the map, and the mount of the camera on base_link."""

    position: Array  # (3,) m, map
    rot: Array  # (3, 3) rot_map_from_camera
    base: Array  # (3,) x, y, heading of base_link
    mount: Array = np.zeros(3)  # (3,) m, the camera in base_link
    look: Array = np.eye(3)  # (3, 3) rot_base_from_camera


def read_camera(name: str) -> Camera:
    """Return the camera of `robots/cameras/<name>.toml`.

    Raises:
        RobotError: unknown name, or a number is out of range; `field` names it.
    """
    return camera_of(read_profile(CameraFile, name, "camera")[0])


def camera_of(file: CameraFile) -> Camera:
    """Return the camera that a file of a profile describes, in SI."""
    return Camera(
        name=file.name,
        link=file.link,
        position=np.array(file.position),
        pitch=math.radians(file.pitch_deg),
        width=file.width_px,
        height=file.height_px,
        focal=0.5 * file.width_px / math.tan(0.5 * math.radians(file.field_deg)),
        period_ms=period_ms(file.period_ms, HW_LANDMARKS),
        exposure=1e-3 * file.exposure_ms,
        detect=file.detect,
        blur=file.blur_px,
        most=file.most,
        range_sigma=file.range_sigma,
        bearing_sigma=math.radians(file.bearing_sigma_deg),
        descriptor_sigma=file.descriptor_sigma,
        range_noise=file.range_noise,
        still=file.still,
        tilt_blind=file.tilt_blind,
    )


def scatter(seed: int, low: tuple[float, float], high: tuple[float, float], density: float) -> Landmarks:
    """Return landmarks at random places of a rectangle of the floor, frame map; `density` per square metre.

    low, high: corners of the rectangle, x and y, m.
    """
    rng = random_stream(seed, "landmarks")
    area = (high[0] - low[0]) * (high[1] - low[1])
    n = round(density * area)
    descriptor = rng.standard_normal((n, DESCRIPTOR))
    length = np.sqrt(np.add.reduce(descriptor * descriptor, axis=1, keepdims=True))
    return Landmarks(rng.uniform(low, high, (n, 2)), descriptor / length)


def laid(field: Landmarks, terrain: Terrain, seed: int, copied: float, copies: int) -> Landmarks:
    """Return the landmarks that lie on the floor of a terrain, some of which look alike.

    Args:
        field: landmarks, those in or behind walls as well.
        terrain: the ground.
        seed: seed of the choice of those that look alike.
        copied: share of the landmarks whose descriptor is that of others, 0..1.
        copies: number of landmarks that share one such descriptor.
    """
    on = terrain.on_floor(field.position)
    position, descriptor = field.position[on], field.descriptor[on]
    groups = round(copied * len(position)) // copies
    if groups > 0:
        alike = random_stream(seed, "landmarks/copies").permutation(len(position))[: groups * copies]
        descriptor[alike] = np.repeat(descriptor[alike[::copies]], copies, axis=0)
    return Landmarks(position, descriptor)


def link_of(robot: Robot, camera: Camera) -> int:
    """Return the index of the link that carries a camera.

    Raises:
        RobotError: the robot has no such link.
    """
    names = [link.name for link in robot.links]
    if camera.link not in names:
        raise RobotError("unknown_name", "link", f"camera {camera.name} sits on {camera.link!r}, {robot.name} has none")
    return names.index(camera.link)


def camera_pose(robot: Robot, camera: Camera, position: Array, quat_wxyz: Array, joints: Array) -> CameraPose:
    """Return the pose of a camera of a robot in the map.

    Args:
        robot: robot that carries the camera.
        camera: camera, whose link, place and pitch are read.
        position: position of base_link, (3,) m, map.
        quat_wxyz: rotation from base_link to map, (4,).
        joints: joint angles, (nj,) rad.

    Raises:
        RobotError: the robot has no such link.
    """
    i = link_of(robot, camera)
    links, origins = forward(robot.model, joints)
    base = matrix_from_quat(quat_wxyz)
    c, s = math.cos(camera.pitch), math.sin(camera.pitch)
    look = product(links[i], np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]]))
    mount = origins[i] + product(links[i], camera.position)
    ground = np.array([position[0], position[1], math.atan2(base[1, 0], base[0, 0])])
    rot = product(product(base, look), CAMERA_AXES)
    return CameraPose(position + product(base, mount), rot, ground, mount, product(look, CAMERA_AXES))


def motion(before: CameraPose, now: CameraPose, dt: float) -> tuple[Array, Array]:
    """Return velocity (3,) m/s and rate (3,) rad/s of a camera in its own axes, from two poses `dt` s apart."""
    turn = product(before.rot.T, now.rot)
    angle = math.acos(min(1.0, max(-1.0, 0.5 * (np.trace(turn) - 1.0))))
    axis = np.array([turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]])
    scale = 0.5 if angle < 1e-6 else 0.5 * angle / math.sin(angle)
    return product(now.rot.T, now.position - before.position) / dt, scale * axis / dt


def seen(camera: Camera, pose: CameraPose, points: Array) -> tuple[NDArray[np.int64], Array]:
    """Return the indices (k,) of floor points (n, 2) m, map, in the image, and their places, (k, 3) m, camera axes."""
    local = product(points, pose.rot[:2]) - product(pose.position, pose.rot)  # (n, 3)
    index = np.flatnonzero(local[:, 2] > NEAREST)
    half = 0.5 * np.array([camera.width, camera.height]) / camera.focal
    index = index[(np.abs(local[index, :2]) <= half * local[index, 2:]).all(axis=1)]
    return index, local[index]


def blur(camera: Camera, local: Array, v: Array, w: Array) -> Array:
    """Return the length of the motion blur of points (k, 3) m, camera axes, (k,) px.

    v, w: velocity (3,) m/s and angular velocity (3,) rad/s of the camera, its axes.
    """
    z = local[:, 2]
    x, y = local[:, 0] / z, local[:, 1] / z
    along_x = (-v[0] + x * v[2]) / z + x * y * w[0] - (1.0 + x * x) * w[1] + y * w[2]
    along_y = (-v[1] + y * v[2]) / z + (1.0 + y * y) * w[0] - x * y * w[1] - x * w[2]
    return camera.focal * camera.exposure * np.hypot(along_x, along_y)


def on_level_floor(pose: CameraPose, local: Array, height: float) -> tuple[float, float]:
    """Return the place of a point on the floor, computed as if the trunk were level: forward and left of base_link, m.

    Args:
        pose: pose of the camera; its place and direction in base_link count.
        local: (3,) the point in camera axes, m; its direction counts.
        height: height of base_link over the floor, m.

    Returns:
        inf, inf for a direction that does not meet the floor.
    """
    ray = product(pose.look, local)
    above = height + float(pose.mount[2])
    if ray[2] > -1e-3 * above:
        return math.inf, math.inf
    scale = above / -float(ray[2])
    return float(pose.mount[0] + scale * ray[0]), float(pose.mount[1] + scale * ray[1])


class LandmarkSensor:
    """Sensor model of a camera that recognises landmarks on the floor; one seeded random stream.

    Args:
        robot: robot that carries the camera.
        camera: profile of the camera.
        field: landmarks on the floor.
        seed: seed of the run.
        goal: x, y of the marker of the goal on the floor, m, map; None = none.
    """

    def __init__(
        self, robot: Robot, camera: Camera, field: Landmarks, seed: int, goal: tuple[float, float] | None = None
    ) -> None:
        self.robot, self.camera, self.field = robot, camera, field
        self.goal = None if goal is None else np.array([goal])
        self.rng = random_stream(seed, "landmark sensor")
        self.visible = 0
        self.height = -float(foot_positions(robot.model, robot.neutral)[:, 2].min())
        """Height of base_link above the lowest foot in the neutral stance, m."""

    def look(self, before: CameraPose, now: CameraPose, dt: float) -> tuple[list[Detection], Detection | None]:
        """Return one frame: recognised landmarks, at most `camera.most`, and the goal marker if it is seen.

        Args:
            before: pose of the camera dt before the exposure's end.
            now: pose at its end.
            dt: time between both, s.
        """
        c = self.camera
        v, w = motion(before, now, dt)
        index, local = seen(c, now, self.field.position)
        self.visible = len(index)
        sharp = exp(-0.5 * (blur(c, local, v, w) / c.blur) ** 2)
        found = np.flatnonzero(self.rng.uniform(size=len(index)) < c.detect * sharp)[: c.most]
        detections: list[Detection] = []
        for k in found:
            i = int(index[k])
            place = Spot(self.field.position[i], local[k], float(sharp[k]))
            detections.append(self._measure(now, place, self.field.descriptor[i], i))
        marker = None
        if self.goal is not None:
            _, place = seen(c, now, self.goal)
            if len(place):
                p = math.exp(-0.5 * (float(blur(c, place, v, w)[0]) / (GOAL_SHARP * c.blur)) ** 2)
                if self.rng.uniform() < p:
                    marker = self._measure(now, Spot(self.goal[0], place[0], p), np.zeros(DESCRIPTOR), -1)
        return [d for d in detections if math.isfinite(d.range)], marker

    def _measure(self, now: CameraPose, spot: Spot, descriptor: Array, index: int) -> Detection:
        c, base = self.camera, now.base
        dx, dy = spot.point[0] - base[0], spot.point[1] - base[1]
        noise, heading = self.rng.standard_normal(2 + DESCRIPTOR), base[2]
        if c.tilt_blind:
            (dx, dy), heading = on_level_floor(now, spot.local, self.height), 0.0
        part = 1.0 - (1.0 - c.still) * spot.sharp**NOISE_BLUR
        away = math.hypot(dx, dy)
        distance = away * (1.0 + part * c.range_sigma * noise[0])
        if c.range_noise > 0.0:
            distance = max(NEAREST, distance + part * c.range_noise * float(self.rng.standard_normal()))
        bearing = math.atan2(dy, dx) - heading + part * c.bearing_sigma * noise[1]
        bearing = math.atan2(math.sin(bearing), math.cos(bearing))
        return Detection(float(distance), float(bearing), descriptor + c.descriptor_sigma * noise[2:], index)

    def state(self) -> dict[str, Any]:
        """Return the state of the random stream, as plain JSON values."""
        return {"rng": self.rng.bit_generator.state}

    def restore(self, state: dict[str, Any]) -> None:
        """Set the random stream to a `state` that was returned earlier."""
        self.rng.bit_generator.state = state["rng"]
