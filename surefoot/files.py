"""Search for hand-written files and reading them: of limited size, UTF-8, with an error message for every failure."""

import os
import stat
import sys
from os.path import isfile
from pathlib import Path

from surefoot.disk import PACKAGE, regular_size
from surefoot.errors import printable
from surefoot.nearest import did_you_mean
from surefoot.tables import TableError

MAX_FILE_BYTES = 256 * 1024  # written by hand; more is a mistake
NAMED = {"compose": "system", "scenarios": "scenario"}
"""Noun for the files of a folder in error messages, by name of the folder."""


class FileError(TableError):
    """Error of a hand-written file that cannot be used.

    Attributes:
        file: the file as the user named it.
    """

    def __init__(self, code: str, field: str, message: str, file: str = "") -> None:
        super().__init__(code, field, message)
        self.file = file

    def __str__(self) -> str:
        return ": ".join(part for part in (printable(self.file), self.field, self.message) if part and part != "file")


def read_text(path: Path, error: type[FileError]) -> str:
    """Return the text of a file; raise `error` with code `not_found`, `value` (too large) or `syntax` (not UTF-8)."""
    try:
        size = regular_size(path)
        if size <= MAX_FILE_BYTES:
            return path.read_text(encoding="utf-8")
        problem = "value", f"has {size} bytes, allowed are {MAX_FILE_BYTES}"
    except OSError as exc:
        problem = "not_found", f"cannot be read ({exc.strerror})"
    except UnicodeDecodeError:
        problem = "syntax", "is not UTF-8 text"
    raise error(problem[0], "file", problem[1], str(path))


def read_regular(path: Path, most_bytes: int) -> bytes:
    """Return the content of a regular file of limited size, and refuse a pipe or a device without waiting for it.

    Raises:
        FileError: `not_found` the file cannot be opened, `value` it is no regular file or larger than `most_bytes`.
    """
    try:
        with open(path, "rb", opener=lambda name, flags: os.open(name, flags | os.O_NONBLOCK)) as file:
            status = os.fstat(file.fileno())
            if not stat.S_ISREG(status.st_mode):
                raise FileError("value", "file", "is no regular file", str(path))
            content = file.read(most_bytes + 1)
    except OSError as error:
        raise FileError("not_found", "file", f"cannot be read ({error.strerror})", str(path)) from None
    if len(content) > most_bytes:
        raise FileError("value", "file", f"has more than {most_bytes} bytes, the most that is read", str(path))
    return content


def folders(kind: str) -> tuple[Path, ...]:
    """Return the folders that may hold `kind` ("compose" or "scenarios"): working folder, checkout, installation."""
    places = (Path.cwd(), PACKAGE.parent, Path(sys.prefix) / "share" / "surefoot")
    return tuple(dict.fromkeys(place / kind for place in places))


def names(kind: str, suffix: str) -> tuple[str, ...]:
    """Return the sorted names, without suffix, of the files in all folders of a kind ("compose" or "scenarios")."""
    return tuple(sorted({path.stem for folder in folders(kind) for path in folder.glob(f"*{suffix}")}))


def find(kind: str, name: str, suffix: str, error: type[FileError]) -> Path:
    """Return the path of a hand-written file of a kind such as `compose`.

    Args:
        kind: "compose" or "scenarios".
        name: a path, returned as it is, or a bare name such as `ragno`, searched for in the folders of the kind.
        suffix: suffix of the file, such as `.toml`.
        error: raised with code `not_found` if no folder has the name.
    """
    path = Path(name)
    if path.suffix == suffix or len(path.parts) > 1:
        return path
    for folder in folders(kind):
        if isfile(folder / f"{name}{suffix}"):
            return folder / f"{name}{suffix}"
    known = names(kind, suffix)
    hint = did_you_mean(name, known)
    raise error("not_found", "", f"no {NAMED[kind]} is named {name!r}{hint}; there are {', '.join(known) or 'none'}")
