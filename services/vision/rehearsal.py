"""Dry run of the vision service on a made-up image, so that OpenCV loads what it needs."""

from base64 import b64encode

import numpy as np

from surefoot.schemas.hw import CameraImage

from .eye import Eye
from .view import FloorPose

DOWN = (0.27059805, -0.65328148, 0.65328148, -0.27059805)
"""Rotation of a camera that looks ahead and 45 deg down, quaternion w, x, y, z."""


def rehearse(eye: Eye) -> None:
    """Process a made-up image, so that everything `eye` needs is loaded."""
    greys = np.random.default_rng(0).integers(0, 255, (96, 128)).astype(np.uint8)
    image = CameraImage(
        width=128, height=96, format="gray8", pixels=b64encode(greys.tobytes()).decode(), focal=150.0,
        center=(64.0, 48.0), exposure=0.0, position=(0.0, 0.0, 0.2), quat_wxyz=DOWN,
    )  # fmt: skip
    eye.look(image, FloorPose(np.eye(3), 0.3), None)
