"""The one place that loads OpenCV, an optional part: `pip install surefoot[vision]`."""

import importlib
from typing import Any

from surefoot.errors import SurefootError


def opencv() -> Any:
    """Return the module `cv2`, on one thread.

    Raises:
        SurefootError: it is not installed.
    """
    try:
        cv2: Any = importlib.import_module("cv2")
    except ImportError:
        text = "vision needs OpenCV: pip install 'surefoot[vision]' (or opencv-python-headless)"
        raise SurefootError("not_installed", text) from None
    cv2.setNumThreads(1)
    return cv2
