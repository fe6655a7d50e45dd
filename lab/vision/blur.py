"""Share of the landmarks in view that an image recognises: along a recorded walk, and against the camera's speed.

In view are the features of the map whose floor point lies in the image and in the part of the floor that vision looks
at. A pose estimate exact to centimetres restricts the search, as in a navigator whose robot is localised.
"""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from surefoot.geometry.rotations import quat_from_rpy
from surefoot.robot.description import Robot
from surefoot.robot.kinematics import foot_positions
from surefoot.robot.profiles import CameraFile, read_profile
from surefoot.robot.reader import load_robot
from surefoot.schemas.hw import CameraImage
from surefoot.schemas.topics import SIM_TRUTH, STATE_GAIT, STATE_ODOMETRY, TICK_S
from surefoot.services.simulator.messages import image_message
from surefoot.services.simulator.sensors.floors import Texture
from surefoot.services.simulator.sensors.images import ImageSensor, Optics
from surefoot.services.simulator.sensors.landmarks import Camera, CameraPose, camera_of, camera_pose, motion
from surefoot.services.vision.eye import Eye
from surefoot.services.vision.feature_map import FeatureMap
from surefoot.services.vision.features import Extractor, Kind
from surefoot.services.vision.motion import MotionHistory
from surefoot.services.vision.recognise import Believed, RecogniseParams
from surefoot.services.vision.view import FloorPose, Patch

from ..maps.images import map_of
from ..maps.turned import FloorLook
from .replay import RecordedMotion, TakenAt

CAMERA, ROBOT = "nao_eyes", "nao"
KNOWN_SD = 0.03
"""Standard deviation of the belief about the pose that limits the landmark search, m (x, y) and rad (yaw)."""
COUNT = 250
ALL = RecogniseParams(most=10_000)


class MatchCount(NamedTuple):
    """Number of landmarks in view of one image and of those recognised, with the speed of its image flow."""

    speed: float
    """Image flow at the optical axis on the floor, px/s."""
    in_view: int
    matched: int


@cache
def _robot() -> Robot:
    return load_robot(ROBOT)


@cache
def _camera() -> Camera:
    return camera_of(read_profile(CameraFile, CAMERA, "camera")[0])


@dataclass(frozen=True)
class StillCamera:
    """Camera of a robot that stands in its neutral stance; the base moves as stated for each image.

    Attributes:
        optics: optics of the camera.
        texture: texture of the floor.
    """

    optics: Optics
    texture: Texture

    def pose(self, x: float, y: float, yaw: float) -> CameraPose:
        """Return the pose of the camera, level, where base_link is at x, y (m) and yaw (rad) on the floor."""
        robot = _robot()
        place = np.array([x, y, self.base.height])
        return camera_pose(robot, _camera(), place, np.array(quat_from_rpy(0.0, 0.0, yaw)), robot.neutral)

    @property
    def base(self) -> FloorPose:
        """Pose of base_link over the floor, level, at the height of the standing robot."""
        robot = _robot()
        return FloorPose(np.eye(3), -float(foot_positions(robot.model, robot.neutral)[:, 2].min()))

    def shot(self, at: tuple[float, float, float], ahead: float, turn: float, seed: int) -> CameraImage:
        """Return an image of the moving camera, whose exposure has its middle at a given pose of base_link.

        Args:
            at: pose x, y, yaw, m and rad.
            ahead: forward speed of base_link, m/s.
            turn: yaw rate of base_link, rad/s.
            seed: seed of the image noise.
        """
        sensor = ImageSensor(self.optics, self.texture, seed)
        kept = sensor.path.maxlen or 2
        middle = (kept - 1) * TICK_S - 0.5 * (self.optics.exposure + self.optics.readout)
        for k in range(kept):
            t = k * TICK_S - middle
            c, s = math.cos(at[2]), math.sin(at[2])
            sensor.path.append(self.pose(at[0] + ahead * t * c, at[1] + ahead * t * s, at[2] + turn * t))
        return image_message(sensor.take(0, kept - 1))


def still_camera(texture: Texture, exposure: float | None = None) -> StillCamera:
    """Return the camera over a floor of a texture; `exposure`: exposure time, s; default: that of its file."""
    optics = Optics.of(read_profile(CameraFile, CAMERA, "camera")[0])
    return StillCamera(optics if exposure is None else replace(optics, exposure=exposure), texture)


def map_by_grid(camera: StillCamera, kind: Kind, xs: Sequence[float], ys: Sequence[float]) -> FeatureMap:
    """Return the map of a floor from still images of known poses on a grid `xs`, `ys`, m, three headings each."""
    eye, looks = Eye(Extractor(kind, COUNT), None), list[FloorLook]()
    for x in xs:
        for y in ys:
            for yaw in (-0.35, 0.0, 0.35):
                found, flags = eye.features(camera.shot((x, y, yaw), 0.0, 0.0, len(looks)), camera.base)
                if not flags:
                    looks.append(FloorLook((x, y, yaw), eye.patch.place(found.pixels), found.descriptors))
    words = f"{camera.optics.width} x {camera.optics.height} px, focal length {camera.optics.focal:.1f} px"
    return map_of(looks, eye, words, "known poses", exact=True)


def in_view(world: FeatureMap, patch: Patch, image: CameraImage, pose: CameraPose) -> NDArray[np.bool_]:
    """Return a flag for each feature of a map, (n,): True if an image shows it, within a patch of the floor.

    Args:
        world: map of n features, frame map.
        patch: part of the floor that vision uses, in heading axes of base_link.
        image: gives size, focal length and centre, px.
        pose: poses of the camera and of base_link.
    """
    points = np.hstack((world.positions, np.zeros((len(world), 1)))) - pose.position
    local = points @ pose.rot
    with np.errstate(divide="ignore", invalid="ignore"):
        u, v = (image.focal * local[:, i] / local[:, 2] + image.center[i] for i in (0, 1))
    d = world.positions - pose.base[:2]
    c, s = math.cos(pose.base[2]), math.sin(pose.base[2])
    ahead, beside = c * d[:, 0] + s * d[:, 1], -s * d[:, 0] + c * d[:, 1]
    seen = (local[:, 2] > 0.0) & (u >= 0.0) & (u < image.width) & (v >= 0.0) & (v < image.height)
    return seen & (ahead >= patch.nearest) & (ahead <= patch.farthest) & (np.abs(beside) <= patch.beside)


def flow(before: CameraPose, now: CameraPose, dt: float, focal: float) -> float:
    """Return the image flow of the floor at the optical axis, px/s, between two poses `dt` s apart.

    `focal`: focal length, px.
    """
    v, w = motion(before, now, dt)
    far = -float(now.position[2]) / min(-1e-3, float(now.rot[2, 2]))
    return focal * math.hypot(-v[0] / far - w[1], -v[1] / far + w[0])


def _matched(eye: Eye, world: FeatureMap, image: CameraImage, base: FloorPose, pose: CameraPose) -> tuple[int, int]:
    """Return the numbers of landmarks in view and recognised in an image, for a belief at the true pose."""
    belief = Believed(pose.base, np.eye(3) * KNOWN_SD**2)
    seen = eye.look(image, base, belief)
    return int(in_view(world, eye.patch, image, pose).sum()), len(seen.landmarks)


def by_speed(
    camera: StillCamera, world: FeatureMap, motions: Iterable[tuple[float, float]], trials: int
) -> list[MatchCount]:
    """Return the numbers of matched landmarks in images of a camera in steady motion, at random places of the map.

    Args:
        camera: camera with its exposure.
        world: map of features.
        motions: pairs of forward speed, m/s, and yaw rate, rad/s.
        trials: number of images of each motion.
    """
    rng, found = np.random.default_rng(1), list[MatchCount]()
    low, high = world.positions.min(axis=0), world.positions.max(axis=0)
    for ahead, turn in motions:
        for trial in range(trials):
            x = float(rng.uniform(*sorted((low[0] - 0.2, high[0] - 1.1))))
            at = (x, float(rng.uniform(-0.2, 0.2)), float(rng.uniform(-0.25, 0.25)))
            image = camera.shot(at, ahead, turn, trial)
            eye = Eye(Extractor(world.kind, COUNT), world, Patch(pixel=world.pixel), ALL)
            counts = _matched(eye, world, image, camera.base, camera.pose(*at))
            c, s = math.cos(at[2]), math.sin(at[2])
            then = camera.pose(at[0] - ahead * TICK_S * c, at[1] - ahead * TICK_S * s, at[2] - turn * TICK_S)
            found.append(MatchCount(flow(then, camera.pose(*at), TICK_S, camera.optics.focal), *counts))
    return found


def along(walk: RecordedMotion, images: Iterable[TakenAt | None], world: FeatureMap) -> dict[str, list[MatchCount]]:
    """Return the numbers of matched landmarks in images along a recorded walk, by state of the gait.

    The tilt of the camera is taken from the estimator of the recording.
    """
    history, found = MotionHistory(walk.robot), dict[str, list[MatchCount]]()
    eye = Eye(Extractor(world.kind, COUNT), world, Patch(pixel=world.pixel), ALL)
    poses: list[CameraPose | None] = []
    for messages, taken in zip(walk.ticks, images, strict=True):
        if "hw/joints" in messages:
            history.bent(messages["hw/joints"])
        if STATE_ODOMETRY.key in messages:
            history.moved(messages[STATE_ODOMETRY.key])
        poses.append(None if SIM_TRUTH.key not in messages else camera_at(walk, len(poses)))
        if taken is None or (here := history.at(taken.image.stamp_ns)) is None:
            continue
        tick = round(taken.image.stamp_ns * 1e-9 / TICK_S)
        now, before = poses[tick], poses[max(0, tick - 1)]
        if now is None or before is None:
            continue
        counts = _matched(eye, world, taken.image, here[1], now)
        state = walk.ticks[tick][STATE_GAIT.key].state
        kind = "stand" if state in ("standing", "waiting") else "turn" if state == "turning" else "walk"
        found.setdefault(kind, []).append(MatchCount(flow(before, now, TICK_S, taken.image.focal), *counts))
    return found


def camera_at(walk: RecordedMotion, tick: int) -> CameraPose:
    """Return the true pose of the camera at a control tick of a recorded walk."""
    truth = walk.ticks[tick][SIM_TRUTH.key]
    return camera_pose(
        walk.robot, _camera(), np.array(truth.position), np.array(truth.quat_wxyz), np.array(truth.joints)
    )  # fmt: skip


def share(found: Sequence[MatchCount]) -> float:
    """Return the share of the landmarks in view that were matched, over all images; NaN where none was in view."""
    total = sum(each.in_view for each in found)
    return sum(each.matched for each in found) / total if total else math.nan
