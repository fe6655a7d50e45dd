"""The picture from above: against a projection of its own, and images that are none."""

from base64 import b64encode

import numpy as np
import pytest

from surefoot.errors import Refusal
from surefoot.geometry.rotations import matrix_from_rpy
from surefoot.services.vision.view import FloorPose, Patch, from_above, greys, homography
from tests.services.vision.shots import HEIGHT, LOOK, MOUNT, base, shot


def projected(point, roll, pitch):
    """Pixel of a floor point in heading axes, by the pinhole."""
    rot = matrix_from_rpy(roll, pitch, 0.0)
    at = rot @ MOUNT + np.array([0.0, 0.0, HEIGHT])
    local = (rot @ LOOK).T @ (np.array([*point, 0.0]) - at)
    return 373.0 * local[:2] / local[2] + np.array([160.0, 120.0])


@pytest.mark.parametrize(("roll", "pitch"), [(0.0, 0.0), (0.05, -0.03), (-0.1, 0.08)])
def test_a_pixel_from_above_is_the_image_of_its_floor_point(roll, pitch):
    patch = Patch()
    matrix = homography(shot((0.0, 0.0, 0.0)), base(roll, pitch), patch)
    for pixel in np.random.default_rng(0).uniform(0, 260, (20, 2)):
        u, v, w = matrix @ np.array([*pixel, 1.0])
        assert np.array([u, v]) / w == pytest.approx(projected(patch.place(pixel[None])[0], roll, pitch), abs=1e-6)


def test_from_above_a_tilted_robot_sees_what_a_level_one_sees():
    level, seen = from_above(shot((0.1, 0.0, 0.0)), greys(shot((0.1, 0.0, 0.0))), base(), Patch())
    image = shot((0.1, 0.0, 0.0, 0.04, 0.05))
    tilted, mask = from_above(image, greys(image), base(0.04, 0.05), Patch())
    both = (seen > 0) & (mask > 0)
    assert both.mean() > 0.2
    unmoved, wrong = (
        np.abs(level.astype(int) - tilted)[both].mean(),
        from_above(image, greys(image), base(), Patch())[0],
    )
    assert unmoved < 12.0 < 20.0 < np.abs(level.astype(int) - wrong)[both].mean()


def broken(**fields):
    return shot((0.0, 0.0, 0.0)).model_copy(update=fields)


def jpeg(size: int) -> str:
    import cv2

    return b64encode(cv2.imencode(".jpg", np.zeros((size, size), np.uint8))[1].tobytes()).decode()


@pytest.mark.parametrize(
    ("fields", "words"),
    [
        ({"width": 300}, "300 x 240"),
        ({"pixels": "?"}, "base64"),
        ({"pixels": b64encode(b"nothing").decode(), "format": "jpeg"}, "no JPEG"),
        ({"pixels": jpeg(64)[:400], "format": "jpeg", "width": 64, "height": 48}, "JPEG"),
        ({"pixels": jpeg(32), "format": "jpeg"}, "32 x 32 pixels, stated are 320 x 240"),
    ],
)
def test_what_is_no_image_is_refused(fields, words):
    with pytest.raises(Refusal, match=words) as error:
        greys(broken(**fields))
    assert error.value.code == "bad_image"


def test_a_camera_that_looks_up_is_refused():
    with pytest.raises(Refusal, match="looks up"):
        homography(shot((0.0, 0.0, 0.0)), FloorPose(matrix_from_rpy(0.0, -2.5, 0.0), HEIGHT), Patch())
