"""View of the floor from straight above, computed from a camera image.

With p and R the camera's pose over the floor (position m and rot_floor_from_camera in heading axes below base_link,
origin on the floor) a point of the floor (x, y, 0) is seen at K R^T ((x, y, 0) - p): a homography, linear in (x, y, 1).
The picture from above has the same scale everywhere, so a feature looks the same from near and far, whatever the tilt.
"""

from base64 import b64decode
from binascii import Error as Base64Error
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from surefoot.arrays import Array
from surefoot.errors import Refusal
from surefoot.geometry.linear import product
from surefoot.geometry.rotations import matrix_from_quat
from surefoot.schemas.hw import CameraImage

from .opencv import opencv

Greys = NDArray[np.uint8]

EDGE = 9
"""Edge of the square, px of the view from above, by which the visible floor is eroded: no features are searched within
4 px of its border."""


class FloorPose(NamedTuple):
    """Roll, pitch and height of base_link above the floor."""

    rot: Array
    """Rotation by roll and pitch, from base_link to the level axes along its heading, (3, 3)."""
    height: float
    """Height of base_link above the floor, m."""


@dataclass(frozen=True)
class Patch:
    """Part of the floor that is evaluated, forward and left of base_link, m.

    It reaches from `nearest` to `farthest` ahead of the robot, and by `beside` to each side.
    """

    nearest: float = 0.3
    farthest: float = 1.1
    beside: float = 0.55
    pixel: float = 0.003
    """Edge length on the floor of a pixel of the view from above, m."""

    @property
    def size(self) -> tuple[int, int]:
        """Columns (to the right) and rows (towards the robot) of the picture."""
        return round(2.0 * self.beside / self.pixel), round((self.farthest - self.nearest) / self.pixel)

    def place(self, pixels: Array) -> Array:
        """Return the floor points of pixels (column, row) of the picture, (n, 2): forward and left of base_link, m."""
        forward = self.farthest - self.pixel * (pixels[:, 1] + 0.5)
        return np.stack((forward, self.beside - self.pixel * (pixels[:, 0] + 0.5)), axis=1)


def greys(image: CameraImage) -> Greys:
    """Return the pixels of an image message as grey levels 0 to 255, (height, width).

    Raises:
        Refusal: what came is no such image.
    """
    try:
        data = b64decode(image.pixels, validate=True)
    except (Base64Error, ValueError):
        raise Refusal("bad_image", "pixels are base64, got something else", "pixels") from None
    if image.format == "gray8":
        if len(data) != image.width * image.height:
            text = f"gray8 of {image.width} x {image.height} has {image.width * image.height} bytes, got {len(data)}"
            raise Refusal("bad_image", text, "pixels")
        return np.frombuffer(data, dtype=np.uint8).reshape(image.height, image.width)
    cv2 = opencv()
    try:
        found = cv2.imdecode(np.frombuffer(data, dtype=np.uint8), cv2.IMREAD_GRAYSCALE)
    except cv2.error:
        found = None
    if found is None:
        raise Refusal("bad_image", f"{len(data)} bytes are no JPEG that can be read", "pixels")
    if found.shape != (image.height, image.width):
        text = f"the JPEG has {found.shape[1]} x {found.shape[0]} pixels, stated are {image.width} x {image.height}"
        raise Refusal("bad_image", text, "width")
    return found


def homography(image: CameraImage, base: FloorPose, patch: Patch) -> Array:
    """Return the matrix (3, 3) from pixels (u, v, 1) of the picture from above to pixels (times a factor) of the image.

    Args:
        image: message with the camera's place and lens.
        base: roll, pitch and height of base_link.
        patch: part of the floor that the picture from above shows.

    Raises:
        Refusal: the camera does not look down on the floor.
    """
    rot = product(base.rot, matrix_from_quat(np.array(image.quat_wxyz)))
    place = product(base.rot, np.array(image.position))
    height = base.height + float(place[2])
    if height <= 0.0 or rot[2, 2] >= 0.0:
        raise Refusal("bad_view", f"the camera is {height:.2f} m over the floor and looks up", "quat_wxyz")
    # camera axes of the floor point (x, y, 0): columns for x, y and 1
    from_floor = np.stack((rot[0], rot[1], product(rot.T, np.array([-place[0], -place[1], -height]))), axis=1)
    cx, cy = image.center
    lens = np.array([[image.focal, 0.0, cx], [0.0, image.focal, cy], [0.0, 0.0, 1.0]])
    p = patch.pixel
    above = np.array(
        [[0.0, -p, patch.farthest - 0.5 * p], [-p, 0.0, patch.beside - 0.5 * p], [0.0, 0.0, 1.0]]
    )  # fmt: skip
    return product(lens, product(from_floor, above))


def in_image(image: CameraImage, base: FloorPose, patch: Patch, places: Array) -> Array:
    """Return the pixels (column, row) at which an image shows points of the floor, (n, 2) px.

    Args:
        image: message with the camera's place and lens.
        base: roll, pitch and height of base_link.
        patch: part of the floor that pictures from above show.
        places: places of the points, forward and left of base_link, (n, 2) m.

    Raises:
        Refusal: the camera does not look down on the floor.
    """
    right, down = (patch.beside - places[:, 1]) / patch.pixel - 0.5, (patch.farthest - places[:, 0]) / patch.pixel - 0.5
    h = homography(image, base, patch)
    u, v, w = (h[i, 0] * right + h[i, 1] * down + h[i, 2] for i in range(3))
    return np.stack((u / w, v / w), axis=1)


def from_above(image: CameraImage, pixels: Greys, base: FloorPose, patch: Patch) -> tuple[Greys, Greys]:
    """Return the view of the floor from above, (rows, cols) greys, and its mask: 255 where it shows the floor.

    Args:
        image: message of the image, with the camera's place.
        pixels: greys of the image, (height, width).
        base: pose of base_link over the floor.
        patch: part of the floor that the picture shows.

    Raises:
        Refusal: the camera does not look down on the floor.
    """
    cv2 = opencv()
    h = homography(image, base, patch)
    shift = np.array([[1.0, 0.0, -0.5], [0.0, 1.0, -0.5], [0.0, 0.0, 1.0]])  # OpenCV counts from a pixel's centre
    flags: Any = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    whole = product(shift, h)
    picture = cv2.warpPerspective(pixels, whole, patch.size, flags=flags, borderMode=cv2.BORDER_REPLICATE)
    seen = np.full(pixels.shape, 255, np.uint8)
    mask = cv2.warpPerspective(seen, whole, patch.size, flags=cv2.INTER_NEAREST | cv2.WARP_INVERSE_MAP)
    return picture, cv2.erode(mask, np.ones((EDGE, EDGE), np.uint8), borderValue=0)
