"""Run folder, by which `down`, `status` and `logs` find a running system.

`<XDG state home>/surefoot/<system>/` with `lock` (held by the supervisor while it lives, so a stale folder shows at
once), `endpoint.json`, `processes.json` and `logs/<service>.log`.
"""

import fcntl
import json
import os
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any, NamedTuple, cast

from surefoot.state import ENDPOINT, LOCK, NO_HOME, SECRET, is_held, state_home

from .identity import Identity, end, identify

if TYPE_CHECKING:
    from surefoot.schemas.system import ServiceStatus

ROW = {"service", "state", "pid", "restarts", "detail"}

MEMORIES = {"walker": "walker.json", "navigator": "navigator.json"}
"""Services that keep a memory over their restarts, each with the name of its file in the run folder."""
FILES = (ENDPOINT, SECRET, "processes.json", "supervisor.json", "status.json", "ready.json", *MEMORIES.values())
"""Names of the files in a run folder that describe a running system; they are removed when it ends."""


LOCK_TRIES, LOCK_PAUSE_S = 5, 0.02
"""`LOCK_TRIES`: number of tries to lock a run folder, as readers hold its lock for microseconds to see whether it is
held; `LOCK_PAUSE_S`: time between two of them, s."""


class RunFolderError(Exception):
    """Error of a run folder that cannot be used: it is locked by a live supervisor, or cannot be written."""

    def __init__(self, message: str, code: str = "already_up") -> None:
        super().__init__(message)
        self.code = code


class Endpoint(NamedTuple):
    """Address of a running system.

    Attributes:
        connect: Zenoh endpoint of its router.
        namespace: prefix of its keys, e.g. `surefoot/ragno`.
        compose: path of the compose file.
        robot: name of the robot.
    """

    connect: str
    namespace: str
    compose: str = ""
    robot: str = ""


class RunFolder:
    """Folder of files about one running system: processes, logs, lock."""

    def __init__(self, name: str, home: Path | None = None) -> None:
        self.name = name
        self.path = (home or state_home()) / name
        self._lock: IO[bytes] | None = None
        self.trouble = ""
        """Why a file of the running system could not be written last, in words; empty = it was."""

    def log(self, service: str) -> Path:
        """Return the path of a service's log file."""
        return self.path / "logs" / f"{service}.log"

    def logs(self) -> dict[str, Path]:
        """Return the paths of the log files that exist, by service."""
        return {path.stem: path for path in sorted((self.path / "logs").glob("*.log"))}

    def acquire(self) -> None:
        """Lock the run folder for this process, which becomes the supervisor of the system.

        Raises:
            RunFolderError: another live supervisor has it, or the folder cannot be written.
        """
        try:
            self.path.mkdir(parents=True, exist_ok=True)
            stream = (self.path / LOCK).open("ab")
        except OSError as exc:
            hint = "; set XDG_STATE_HOME, as there is no home folder" if NO_HOME in self.path.parents else ""
            text = f"cannot write the run folder {self.path} ({exc.strerror}){hint}"
            raise RunFolderError(text, "unwritable") from exc
        if not _locked(stream):
            stream.close()
            raise self._taken()
        os.utime(self.path / LOCK)
        for path in self.memories.values():
            path.unlink(missing_ok=True)
        self._lock = stream

    @property
    def memories(self) -> dict[str, Path]:
        """Paths, by service, of the files in which services store their state for a restart; removed with the run."""
        return {service: self.path / name for service, name in MEMORIES.items()}

    def release(self) -> None:
        """Remove the files that describe the running system and release its lock; logs stay."""
        if self._lock is None:
            return
        for name in FILES:
            (self.path / name).unlink(missing_ok=True)
        self._lock.close()
        self._lock = None

    def _taken(self) -> RunFolderError:
        owner = self.supervisor()
        by = f" by process {owner.pid}" if owner else ""
        return RunFolderError(f"system {self.name!r} is already run{by}; stop it with `surefoot down {self.name}`")

    def refuse_held(self) -> None:
        """Raise RunFolderError if the system is up already, before anything is prepared for it."""
        if self.held():
            raise self._taken()

    def held(self) -> bool:
        """Return True if a live supervisor runs this system."""
        return is_held(self.path)

    def write_endpoint(self, endpoint: Endpoint, secret: str = "") -> None:
        """Store the address of the system, its secret, and the identity of this process as its supervisor.

        Only this user can read these files.
        """
        self._write(SECRET, secret)  # before the address: a client that finds this takes what is there as its secret
        try:
            self._write(ENDPOINT, endpoint._asdict())
        except OSError:
            (self.path / SECRET).unlink(missing_ok=True)
            raise
        own = identify(os.getpid())
        if own is not None:
            self._write("supervisor.json", own._asdict())

    def endpoint(self, *, orphaned: bool = False) -> Endpoint | None:
        """Return the address of the system, None if it does not run; `orphaned`: also without live supervisor."""
        content = self._read(ENDPOINT) if self.held() or (orphaned and self.orphans()) else None
        table = cast("dict[str, Any]", content) if isinstance(content, dict) else {}
        if not {"connect", "namespace"} <= set(table) <= set(Endpoint._fields):
            return None
        return Endpoint(**table) if all(isinstance(one, str) for one in table.values()) else None

    def supervisor(self) -> Identity | None:
        """Return the identity of the process that supervises this system, None if no such process lives."""
        found = _identity(self._read("supervisor.json"))
        return found if found is not None and found.alive() else None

    def write_rows(self, rows: Sequence["ServiceStatus"]) -> bool:
        """Store the rows of `surefoot status`, one per service; return False if they cannot be written."""
        return self._note("status.json", [row.model_dump(include=ROW) for row in rows])

    def read_rows(self) -> list[dict[str, Any]]:
        """Return the stored rows of `surefoot status`, one a service."""
        rows = self._read("status.json")
        return [row for row in rows if _is_row(row)] if isinstance(rows, list) else []

    def write_ready(self, report: dict[str, Any]) -> None:
        """Store the report of `surefoot up`, which marks the system as ready."""
        self._write("ready.json", report)

    def clear_ready(self) -> None:
        """Remove the stored report that an earlier system was ready."""
        (self.path / "ready.json").unlink(missing_ok=True)

    def ready(self) -> dict[str, Any] | None:
        """Return the stored report of `surefoot up`, None until the system is ready."""
        content = self._read("ready.json") if self.held() else None
        return cast("dict[str, Any]", content) if isinstance(content, dict) else None

    def touched(self) -> float:
        """Return the wall time at which a supervisor last locked this run folder, s since 1970; 0 = never."""
        try:
            return (self.path / LOCK).stat().st_mtime
        except OSError:
            return 0.0

    def write_processes(self, processes: Mapping[str, Identity]) -> bool:
        """Store the identity of each service's process, for a later supervisor; return False if that fails."""
        return self._note("processes.json", {name: identity._asdict() for name, identity in processes.items()})

    def processes(self) -> dict[str, Identity]:
        """Return the processes of this system that still run, by service, whoever supervises them."""
        content = self._read("processes.json")
        found = {name: _identity(entry) for name, entry in content.items()} if isinstance(content, dict) else {}
        return {name: identity for name, identity in found.items() if identity is not None and identity.alive()}

    def orphans(self) -> dict[str, Identity]:
        """Return the processes, by service, that still run although their supervisor has died."""
        left = self.processes()  # before the lock: one that is ending has none when it lets go
        return {} if self.held() else left

    @property
    def orphaned(self) -> str:
        """Message for the user about services that still run although their supervisor has died."""
        return f"services of {self.name} run without their supervisor; `surefoot down {self.name}` ends them"

    def end_leftovers(self) -> tuple[str, ...]:
        """End the processes whose supervisor has died; return the names of their services. Needs the lock."""
        if self._lock is None:
            raise RunFolderError(f"run folder of {self.name!r} is not held by this process", "not_held")
        left = self.processes()
        for identity in left.values():
            end(identity)
        return tuple(left)

    def _note(self, name: str, content: Any) -> bool:
        """Replace a file as `_write` does; return False if it cannot be written, which ends no system that runs.

        The reason is kept in `trouble`, for the log; it is empty again once files are written.
        """
        try:
            self._write(name, content)
        except OSError as error:
            self.trouble = f"cannot write {self.path / name} ({error.strerror}); it is tried again"
            return False
        self.trouble = ""
        return True

    def _write(self, name: str, content: Any) -> None:
        """Replace a file of the run folder atomically: a reader sees the old content or the new one, never a part."""
        import tempfile  # here: whoever only reads does without

        temporary = ""
        try:
            handle, temporary = tempfile.mkstemp(dir=self.path, prefix=f".{name}")
            with os.fdopen(handle, "w", encoding="utf-8") as stream:
                json.dump(content, stream, indent=1)
            os.replace(temporary, self.path / name)
        except BaseException as error:
            if temporary:
                Path(temporary).unlink(missing_ok=True)
            if isinstance(error, OSError):
                error.filename = str(self.path / name)
                del error.filename2
            raise

    def _read(self, name: str) -> Any:
        try:
            return json.loads((self.path / name).read_text(encoding="utf-8"))
        except (OSError, ValueError, RecursionError):
            return None


def run_folders(home: Path | None = None) -> tuple[RunFolder, ...]:
    """Return the run folders of this user, running or not."""
    base = home or state_home()
    return tuple(RunFolder(path.parent.name, base) for path in sorted(base.glob(f"*/{LOCK}")))


def unreadable(home: Path | None = None) -> str:
    """Return which run folders this user cannot read, so that systems there are not known; empty if there are none."""
    base = home or state_home()
    found = list[str]()
    try:
        places = [base / entry.name for entry in os.scandir(base)]
    except PermissionError:
        places, found = [], [str(base)]
    except OSError:
        return ""
    for place in sorted(places):
        try:
            with (place / LOCK).open("rb"):
                pass
        except PermissionError:
            found.append(str(place))
        except OSError:
            continue
    return f"this user cannot read {', '.join(found)}, so that a system there is not seen" if found else ""


def _locked(stream: IO[bytes]) -> bool:
    """Lock the file of a run folder; return False if a supervisor has it, and not only a reader for a moment."""
    for left in reversed(range(LOCK_TRIES)):
        try:
            fcntl.flock(stream, fcntl.LOCK_EX | fcntl.LOCK_NB)
            return True
        except BlockingIOError:
            if left:
                time.sleep(LOCK_PAUSE_S)
    return False


def _identity(content: Any) -> Identity | None:
    table = cast("dict[str, Any]", content) if isinstance(content, dict) else {}
    if set(table) != set(Identity._fields):
        return None
    right = type(table["pid"]) is type(table["started"]) is int and table["pid"] > 0 and isinstance(table["boot"], str)
    return Identity(**table) if right else None


def _is_row(row: Any) -> bool:
    """Return True if an entry of the file of rows has the fields of one, each of its type."""
    table = cast("dict[str, Any]", row) if isinstance(row, dict) else {}
    kinds = {"service": str, "state": str, "detail": str, "restarts": int, "pid": int | None}
    return set(kinds) <= set(table) and all(isinstance(table[name], kind) for name, kind in kinds.items())
