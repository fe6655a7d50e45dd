"""Replay of a recorded walk with a simulated camera over another floor, through vision and localisation.

The robot moves as in the recording: images are rendered along its path, the service vision reads them, and the
navigator's localiser takes the landmarks. The truth moves the camera and measures errors; neither service reads it.
"""

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from surefoot.arrays import Array
from surefoot.errors import SurefootError
from surefoot.lockstep.join import TickInputs
from surefoot.record.recording import read_recording
from surefoot.robot.description import Robot
from surefoot.robot.profiles import CameraFile, read_profile
from surefoot.robot.reader import load_robot
from surefoot.schemas import topics
from surefoot.schemas.hw import CameraImage, Tick
from surefoot.schemas.state import SeenLandmarks
from surefoot.services.navigator.belief.landmarks import FloorLandmarks
from surefoot.services.navigator.belief.matching import DetectionError
from surefoot.services.navigator.config import NavigatorConfig
from surefoot.services.navigator.goals import GaitView
from surefoot.services.navigator.localiser import Localiser
from surefoot.services.navigator.policy.params import load as load_params
from surefoot.services.simulator.ground.terrain import make_terrain
from surefoot.services.simulator.messages import image_message
from surefoot.services.simulator.physics.faults import Fault, FaultBank
from surefoot.services.simulator.sensors.floors import Texture, paint
from surefoot.services.simulator.sensors.images import ImageSensor, Optics
from surefoot.services.simulator.sensors.landmarks import CameraPose, camera_of, camera_pose
from surefoot.services.vision.config import VisionConfig
from surefoot.services.vision.feature_map import FeatureMap
from surefoot.services.vision.service import VisionService

KEYS = (topics.HW_JOINTS.key, topics.STATE_ODOMETRY.key, topics.STATE_GAIT.key, topics.SIM_TRUTH.key)


@dataclass(frozen=True)
class RecordedMotion:
    """Recorded messages of a walk by control tick; `hw/joints` at its own rate."""

    robot: Robot
    ticks: list[dict[str, Any]]

    def truth(self, tick: int) -> tuple[float, float, float]:
        """Return the true x, y (m) and heading (rad) of the robot at a control tick."""
        message = self.ticks[tick][topics.SIM_TRUTH.key]
        w, x, y, z = message.quat_wxyz
        return (*message.position[:2], math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z)))


def read_motion(path: Path, seconds: float = math.inf, robot: str = "nao") -> RecordedMotion:
    """Return the first `seconds` s of a recorded walk (raises SurefootError: it lacks a topic of `KEYS`)."""
    table: dict[int, dict[str, Any]] = {}
    for item in read_recording(path, KEYS):
        message = item.message()
        table.setdefault(message.tick, {})[item.key] = message
    ticks = [table.get(tick, {}) for tick in range(max(table, default=0))]
    for key in KEYS:
        if not any(key in messages for messages in ticks):
            raise SurefootError("invalid", f"{path} has no {key}; a replay needs it", key)
    whole = next((n for n, m in enumerate(ticks) if n > 0 and not {*KEYS[1:]} <= set(m)), len(ticks))
    return RecordedMotion(load_robot(robot), ticks[: int(min(whole, seconds / topics.TICK_S))])


def floor(texture: str, seed: int, terrain: str = "corridor", width: float = 2.0) -> Texture:
    """Return the floor of a terrain with a named texture; `width`: of a picture, m; `seed`: of a procedural texture."""
    return paint(make_terrain(terrain), texture, width, 1.0, seed)


class TakenAt(NamedTuple):
    """An image that the replay of a walk has rendered, with its tick and camera pose."""

    tick: int
    image: CameraImage
    pose: CameraPose
    """True pose of the camera at the time when its image arrived."""


def images_of(
    motion: RecordedMotion, texture: Texture, seed: int, exposure: float | None = None, faults: Iterable[Fault] = ()
) -> Iterable[TakenAt | None]:
    """Yield for each tick of a walk the rendered image that arrives in it, or None.

    Args:
        motion: recorded walk.
        texture: texture of the floor.
        seed: seed of noise and delays.
        exposure: exposure time, s; None = that of the camera `nao_eyes`.
        faults: faults of the camera.
    """
    file = read_profile(CameraFile, "nao_eyes", "camera")[0]
    if exposure is not None:
        file = file.model_copy(update={"exposure_ms": 1e3 * exposure})
    camera, sensor, bank = camera_of(file), ImageSensor(Optics.of(file), texture, seed), FaultBank((), ())
    for fault in faults:
        bank.add(fault)
    for tick, messages in enumerate(motion.ticks):
        truth = messages.get(topics.SIM_TRUTH.key)
        if truth is None:
            yield None
            continue
        exact = (np.array(truth.position), np.array(truth.quat_wxyz), np.array(truth.joints))
        pose = camera_pose(motion.robot, camera, *exact)
        taken = sensor.spoil(bank, tick, sensor.look(tick, pose))
        if taken is None:
            yield None
            continue
        message = image_message(taken).stamped(taken.stamp_ns, tick, 1, taken.seq, "simulator")
        yield TakenAt(tick, message, pose)


class Published(NamedTuple):
    """Pose estimate of the navigator against the truth, after one message of vision in a replay."""

    tick: int
    gait: str
    seen: SeenLandmarks
    error: Array
    """Believed less true x, y (m) and heading (rad), (3,)."""
    covariance: Array
    """Covariance of the published pose x, y, yaw, (3, 3) in m and rad."""
    lost: bool

    @property
    def nees(self) -> float:
        """NEES of the pose x, y, yaw (normalised squared error) divided by its 3 degrees of freedom."""
        return float(self.error @ np.linalg.solve(self.covariance, self.error)) / 3.0


class _Outlet:
    """Runtime of a service without a bus: keeps what it publishes."""

    def __init__(self) -> None:
        self.last: Any = None

    def publish(self, topic: Any, message: Any, stamp_ns: int | None) -> None:
        self.last = message

    def call(self, query: Any, request: Any, timeout_s: float | None) -> Any:
        raise NotImplementedError

    def log(self, level: str, text: str) -> None:
        """Discard a log line; a replay writes no log."""


@dataclass
class WalkReplay:
    """Replay of vision and localisation along a recorded motion.

    Attributes:
        world: map of features.
        params: name of the navigation model.
        begin: initial error of the pose estimate, estimated less true x, y (m) and heading (rad).
        change: called with tick, vision and localiser before each tick.
    """

    world: FeatureMap
    params: str = "nao"
    begin: tuple[float, float, float] = (0.0, 0.0, 0.0)
    change: Callable[[int, VisionService, Localiser], None] = lambda tick, vision, localiser: None

    def run(self, motion: RecordedMotion, images: Iterable[TakenAt | None]) -> list[Published]:
        """Return pose estimate and truth after each message of vision, including those without a new image."""
        config = NavigatorConfig(robot=motion.robot.name, params=self.params)
        localiser = Localiser(config, load_params(self.params))
        localiser.tracker.world = FloorLandmarks(self.world.positions, self.world.codes, sd=self.world.sd)
        truth = motion.truth(0)
        localiser.place((truth[0] + self.begin[0], truth[1] + self.begin[1], truth[2] + self.begin[2]))
        vision, outlet = VisionService(VisionConfig(robot=motion.robot.name)), _Outlet()
        vision.attach(outlet)
        vision.on_start()
        vision.use(self.world)
        vision.on_reset()
        found: list[Published] = []
        belief: Any = None
        for tick, (messages, taken) in enumerate(zip(motion.ticks, images, strict=True)):
            if topics.STATE_ODOMETRY.key not in messages:
                continue
            self.change(tick, vision, localiser)
            inputs = {
                key: messages[key] for key in (topics.HW_JOINTS.key, topics.STATE_ODOMETRY.key) if key in messages
            }
            inputs |= {} if taken is None else {topics.HW_IMAGE.key: taken.image}
            inputs |= {} if belief is None else {topics.STATE_POSE.key: belief}
            now, belief, outlet.last = tick * topics.TICK_NS, None, None
            head = Tick(roster=(), roster_version=0, due=(), mode="lockstep").stamped(now, tick, 1, tick, "simulator")
            vision.on_tick(TickInputs(head, inputs))
            self._believe(messages, outlet.last, localiser, now)
            if topics.STATE_POSE.due(tick):
                belief = localiser.message(1e-9 * now, ready=True)
            if topics.STATE_LANDMARKS.due(tick):
                found.append(self._measured(motion, tick, outlet.last, localiser))
        vision.on_stop()
        return found

    def _believe(self, messages: dict[str, Any], seen: SeenLandmarks | None, localiser: Localiser, now: int) -> None:
        """Update the localiser with the odometry and the recognised landmarks of a tick."""
        odometry, gait = messages[topics.STATE_ODOMETRY.key], GaitView.of(messages[topics.STATE_GAIT.key])
        if odometry.initialised:
            localiser.odometry(odometry, now * 1e-9)
        if seen is not None and seen.fresh:
            try:
                localiser.look(seen.stamped(now, now // topics.TICK_NS, 1, 0, "vision"), gait, now * 1e-9)
            except DetectionError:
                return
        localiser.search(standing=gait.state == "standing")

    def _measured(self, motion: RecordedMotion, tick: int, seen: SeenLandmarks, localiser: Localiser) -> Published:
        error = np.array(localiser.tracker.pose) - motion.truth(tick)
        error[2] = math.atan2(math.sin(error[2]), math.cos(error[2]))
        covariance = np.array(localiser.tracker.cov)[:3, :3].copy()
        gait = motion.ticks[tick][topics.STATE_GAIT.key].state
        return Published(tick, gait, seen, error, covariance, localiser.lost.lost)
