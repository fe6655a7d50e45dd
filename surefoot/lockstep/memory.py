"""File in which a service keeps its state, so that a new process continues after one that was killed."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any, TypeVar

from pydantic import BaseModel, ConfigDict, ValidationError

from surefoot.disk import whole
from surefoot.files import FileError, read_regular
from surefoot.tables import TableError, table_error

MOST_BYTES = 1 << 20
"""Largest size of a state file, bytes; a larger one is not read, and the service starts without it."""
MOST_ID = 2**53
"""Largest number of a command or order, because every JSON reader keeps integers up to 2**53 exactly."""


class Stored(BaseModel):
    """Base of the state that a service keeps in a file: run number (epoch) and tick at which it was written."""

    model_config = ConfigDict(strict=True, extra="forbid")
    epoch: int
    tick: int


S = TypeVar("S", bound=Stored)


class RunMemory:
    """File in which a service keeps its state for a restart; errors of the disk are recorded, not raised.

    Args:
        path: path of the file; None = nothing is kept.
        what: name of the state, for messages.

    Attributes:
        path: path of the file; None = nothing is kept, or nothing more after an error.
        problem: text of the last error, for the log of the service, which then sets it to "".
    """

    def __init__(self, path: str | None, what: str) -> None:
        self.path = None if path is None else Path(path)
        self.problem = ""
        self._what = what

    def write(self, epoch: int, tick: int, fields: Mapping[str, Any]) -> None:
        """Replace the content of the file by the state `fields`, which JSON can hold, at a tick of a run (epoch)."""
        if self.path is None:
            return
        try:
            with whole(self.path) as fresh:
                fresh.write_text(json.dumps({"epoch": epoch, "tick": tick, **fields}), encoding="utf-8")
        except OSError as error:
            self._lose(error)

    def forget(self) -> None:
        """Remove the state file that an earlier run has left."""
        try:
            if self.path is not None:
                self.path.unlink(missing_ok=True)
        except OSError as error:
            self._lose(error)

    def read(self, model: type[S], epoch: int, tick: int) -> S | None:
        """Return the state if it was written in run `epoch` at or before `tick`; else, or if it is unreadable, None.

        A process may be killed after it wrote a tick and before it published it: its successor repeats that tick.
        """
        if self.path is None or not self.path.exists():
            return None
        try:
            found = model.model_validate_json(read_regular(self.path, MOST_BYTES))
        except (FileError, ValidationError) as error:
            why = table_error(error, model, TableError) if isinstance(error, ValidationError) else error
            self.problem = f"the kept {self._what} cannot be read and is given up: {why}"
            return None
        return found if found.epoch == epoch and found.tick <= tick else None

    def _lose(self, error: OSError) -> None:
        self.problem = f"the {self._what} cannot be kept for a restart: {error.strerror}"
        self.path = None
