"""Memory of a service: a file of its run, from which the process goes on that follows one that was killed."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from surefoot.disk import whole
from surefoot.files import FileError, read_regular

MOST_BYTES = 1 << 20
"""Largest file that is read; a service writes some kB."""
MOST_ID = 2**53
"""Largest number of a command or order: the largest that every JSON reader keeps exactly."""


class RunMemory:
    """The file; a disk that fails costs the memory and nothing else.

    Args:
        path: None = nothing is kept.
        what: is kept, in words.

    Attributes:
        path: None where nothing is kept, or no longer.
        problem: what failed, for the log of the service, which empties it.
    """

    def __init__(self, path: str | None, what: str) -> None:
        self.path = None if path is None else Path(path)
        self.problem = ""
        self._what = what

    def write(self, epoch: int, tick: int, fields: Mapping[str, Any]) -> None:
        """Replace the content by fields that JSON knows."""
        if self.path is None:
            return
        try:
            with whole(self.path) as fresh:
                fresh.write_text(json.dumps({"epoch": epoch, "tick": tick, **fields}), encoding="utf-8")
        except OSError as error:
            self._lose(error)

    def forget(self) -> None:
        """Begin a run: remove the file of an earlier one."""
        try:
            if self.path is not None:
                self.path.unlink(missing_ok=True)
        except OSError as error:
            self._lose(error)

    def read(self) -> bytes | None:
        """Return the content; None where there is no file, or none that can be read."""
        if self.path is None or not self.path.exists():
            return None
        try:
            return read_regular(self.path, MOST_BYTES)
        except FileError as error:
            self.give_up(error)
            return None

    def give_up(self, why: object) -> None:
        """Note why the content is of no use."""
        self.problem = f"the kept {self._what} cannot be read and is given up: {why}"

    def _lose(self, error: OSError) -> None:
        self.problem = f"the {self._what} cannot be kept for a restart: {error.strerror}"
        self.path = None
