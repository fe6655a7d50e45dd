"""Safe access to files: refusal of pipes and devices, and files that are never left half written."""

import stat
from collections.abc import Generator
from contextlib import contextmanager
from errno import ESPIPE
from pathlib import Path

PACKAGE = Path(__file__).resolve().parent
"""Folder of the installed package; in a checkout some of its subfolders are links to folders beside it."""


def regular_size(path: Path) -> int:
    """Return the size of a file, bytes, and refuse files that are neither regular files nor folders.

    Raises:
        OSError: there is no such file, or it is a pipe or a device, at which a reader may wait for ever.
    """
    status = path.stat()
    if not (stat.S_ISREG(status.st_mode) or stat.S_ISDIR(status.st_mode)):  # to open a folder fails by itself
        raise OSError(ESPIPE, "is no regular file", str(path))
    return status.st_size


@contextmanager
def whole(path: Path) -> Generator[Path]:
    """Yield a temporary path to write to, which replaces `path` at the end; an error leaves `path` as it was.

    Raises:
        OSError: what failed, with the name of the file where the system gives none (a full disk).
    """
    part = path.with_name(path.name + ".part")
    try:
        yield part
        part.replace(path)
    except BaseException as error:
        part.unlink(missing_ok=True)
        if isinstance(error, OSError) and error.filename in (None, str(part)):
            error.filename = str(path)
        raise
