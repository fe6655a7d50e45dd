"""File name endings of picture files; apart from the painter, since its import takes a second."""

import shutil
from pathlib import Path

from surefoot.errors import SurefootError

ANIMATED = (".webp", ".gif", ".mp4")
ENDINGS = (*ANIMATED, ".png")


def kind_of(out: Path) -> str:
    """Return the ending of a picture file in lower case.

    Raises:
        SurefootError: the kind of file is not known, or what writes it is not installed.
    """
    kind = out.suffix.lower()
    if kind not in ENDINGS:
        raise SurefootError("invalid", f"{out} ends in {kind!r}; known are {', '.join(ENDINGS)}", "out")
    if kind == ".mp4" and shutil.which("ffmpeg") is None:
        raise SurefootError("not_installed", "an MP4 needs the program ffmpeg on the path; .webp needs nothing", "out")
    return kind
