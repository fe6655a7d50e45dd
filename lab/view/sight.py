"""Newest camera image that vision has processed, with features, matches and search regions, for the live page."""

import base64
import json
from contextlib import suppress
from functools import partial
from io import BytesIO
from typing import Any

import numpy as np
from PIL import Image

from surefoot.bus.interface import Delivery
from surefoot.client import Client
from surefoot.errors import SurefootError
from surefoot.schemas.topics import HW_IMAGE, STATE_LANDMARKS, STATE_ODOMETRY, STATE_POSE
from surefoot.services.vision.view import greys

from ..scene.sights import SeenImage, SightKeeper, features, gates, in_image, words

WIDEST, QUALITY = 480, 60
"""`WIDEST`: longest edge of a camera image on the page, px; `QUALITY`: its JPEG quality, 0 to 100: about 10 kB."""


class LiveSight:
    """Collector of the newest image with its landmarks; subscribes to images once vision has published landmarks.

    Attributes:
        shown: index of the newest image, which counts up, and its JSON; "null" = there is none in this run.
    """

    def __init__(self, client: Client) -> None:
        self._client, self._images = client, None
        self._keeper, self._last = SightKeeper(), 0
        self.shown = (0, "null")

    def images(self) -> None:
        """Read the newest camera image; to be called before `take`, as landmark messages refer to their image."""
        images = self._images  # a page that comes or goes may take them away meanwhile
        delivery: Delivery | None = images() if images else None
        if delivery is not None and not delivery.prime:
            with suppress(SurefootError):
                self._keeper.image(delivery.message())

    def take(self, delivery: Delivery) -> None:
        """Process a message of landmarks, odometry or pose; ignore all others."""
        if delivery.key == STATE_LANDMARKS.key and not self._images:
            self._images = self._client.bus.newest(HW_IMAGE)
        take = {
            STATE_ODOMETRY.key: self._keeper.moved, STATE_POSE.key: self._keeper.believed,
            STATE_LANDMARKS.key: partial(self._keeper.landmarks, action=""),
        }.get(delivery.key)  # fmt: skip
        if self._images and take:
            with suppress(SurefootError):
                take(delivery.message())

    def forget(self) -> None:
        """Drop the newest image and the image subscription, until vision publishes landmarks again."""
        if self._images:
            self._images, self._keeper, self._last = None, SightKeeper(), 0
            self.shown = (self.shown[0] + 1, "null")

    def look(self) -> tuple[int, str]:
        """Return the index of the newest image with landmarks, which counts up, and its JSON ("null" = none)."""
        keeper = self._keeper
        sight = keeper.by_action.get("")
        if sight is not None and sight.image.stamp_ns != self._last:
            self._last = sight.image.stamp_ns
            with suppress(SurefootError):  # what came is no image
                picture = json.dumps(drawn(sight), separators=(",", ":"), allow_nan=False)
                if keeper is self._keeper:
                    self.shown = (self.shown[0] + 1, picture)
        return self.shown


def drawn(sight: SeenImage) -> dict[str, Any]:
    """Return an image with features, matches and search regions as a JSON object; positions in pixels of the JPEG.

    Raises:
        SurefootError: the message holds no image.
    """
    pixels = greys(sight.image)
    picture = Image.fromarray(pixels)
    picture.thumbnail((WIDEST, WIDEST))
    scale, file = picture.width / pixels.shape[1], BytesIO()
    picture.save(file, "JPEG", quality=QUALITY)
    found: dict[str, list[Any]] = {"features": [], "matches": [], "gates": []}
    with suppress(SurefootError):  # the camera does not look at the floor
        found["matches"] = _px(in_image(sight.places, sight), scale)
        found["gates"] = [_px(outline, scale) for outline in gates(sight)]
        found["features"] = _px(features(sight, pixels), scale)
    jpeg = base64.b64encode(file.getvalue()).decode()
    return {"width": picture.width, "height": picture.height, "jpeg": jpeg, "text": words(sight), **found}


def _px(places: Any, scale: float) -> list[float]:
    finite = np.nan_to_num(np.asarray(places) * scale, nan=-1e3, posinf=-1e3, neginf=-1e3)
    return np.round(finite.clip(-1e4, 1e4), 1).ravel().tolist()
