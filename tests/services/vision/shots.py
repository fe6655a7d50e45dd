"""Images of a small random floor from a camera like Nao's, and a map of it from known poses."""

import math
from functools import cache

import numpy as np

from surefoot.geometry.rotations import matrix_from_rpy
from surefoot.lab.maps.images import map_of
from surefoot.lab.maps.turned import FloorLook
from surefoot.schemas.hw import CameraImage
from surefoot.services.simulator.messages import image_message
from surefoot.services.simulator.sensors import floors, images
from surefoot.services.simulator.sensors.landmarks import CAMERA_AXES, CameraPose
from surefoot.services.vision.eye import Eye
from surefoot.services.vision.feature_map import FeatureMap
from surefoot.services.vision.features import Extractor
from surefoot.services.vision.view import FloorPose

HEIGHT, MOUNT = 0.33, np.array([0.05, 0.0, 0.17])
LOOK = matrix_from_rpy(0.0, math.radians(40.0), 0.0) @ CAMERA_AXES
OPTICS = images.Optics(320, 240, 373.0, 200, 0.0, 0.0, 0.04, 0.0, 0.008, 0.012, 0.3)


@cache
def floor(seed: int = 0) -> floors.Texture:
    """Noise on 2.4 x 2 m about the origin, which then repeats."""
    grey = floors._random((992, 1216), np.random.default_rng(seed))
    return floors._sizes(np.clip(grey, 0.0, 1.0), (-0.6, -1.0, 0.002, 1.0))


def camera(x: float, y: float, yaw: float, roll: float = 0.0, pitch: float = 0.0) -> CameraPose:
    base = matrix_from_rpy(roll, pitch, yaw)
    return CameraPose(np.array([x, y, HEIGHT]) + base @ MOUNT, base @ LOOK, np.array([x, y, yaw]), MOUNT, LOOK)


def shot(pose: tuple[float, ...], seed: int = 0, noise: int = 0, stamp_ns: int = 0) -> CameraImage:
    """Image from a pose x, y, yaw, roll, pitch of base_link."""
    sensor = images.ImageSensor(OPTICS, floor(seed), noise)
    sensor.path.extend([camera(*pose)] * 3)
    return image_message(sensor.take(0, 2)).stamped(stamp_ns, 0, 1, 0, "simulator")


def base(roll: float = 0.0, pitch: float = 0.0) -> FloorPose:
    return FloorPose(matrix_from_rpy(roll, pitch, 0.0), HEIGHT)


def extractor(kind: str = "orb") -> Extractor:
    return Extractor(kind, 250)


@cache
def world(kind: str = "orb", seed: int = 0) -> FeatureMap:
    """Map of the floor from 12 known poses."""
    eye, looks = Eye(extractor(kind), None), []
    for x in (0.0, 0.1, 0.2, 0.3):
        for y in (-0.1, 0.0, 0.1):
            found, flags = eye.features(shot((x, y, 0.5 * y), seed), base())
            assert flags == ()
            looks.append(FloorLook((x, y, 0.5 * y), eye.patch.place(found.pixels), found.descriptors))
    return map_of(looks, eye, "camera of the tests", "known poses", exact=True)
