"""State folder of this user, with one subfolder, the run folder, for each system that runs or ran on this machine."""

import fcntl
import json
import os
from pathlib import Path
from typing import Any, cast

ENDPOINT, SECRET, LOCK = "endpoint.json", "secret.json", "lock"
"""`ENDPOINT`: name of the file in a run folder that holds the address of the system; `SECRET`: name of the file in a
run folder that holds the secret of the system; `LOCK`: name of the file that its supervisor locks while it lives."""

NO_HOME = Path("/nonexistent")
"""Home folder of a user that has none; the file system hierarchy of Debian knows it by this name."""


def user_home() -> Path:
    """Return the home folder of this user; `NO_HOME` if there is none, e.g. of a user in a container without HOME."""
    try:
        return Path.home()
    except RuntimeError:
        return NO_HOME


def state_home() -> Path:
    """Return the state folder of this user, which holds the run folders of all systems."""
    base = os.environ.get("XDG_STATE_HOME", "")
    return (Path(base) if os.path.isabs(base) else user_home() / ".local" / "state") / "surefoot"


def secret_of(connect: str, namespace: str) -> str:
    """Return the secret of a system that this user has started on this machine, empty if there is none.

    Of several run folders with the same address, as a killed supervisor leaves them behind, the one of a supervisor
    that lives counts, else the newest: times of files are of the wall clock, which may be set back.

    Args:
        connect: Zenoh endpoint of its router.
        namespace: prefix of its keys.
    """
    found = [(is_held(path.parent), _changed(path), path.parent) for path in state_home().glob(f"*/{ENDPOINT}")]
    for _, _, folder in sorted(found, reverse=True):
        place, secret = _read(folder / ENDPOINT), _read(folder / SECRET)
        if isinstance(place, dict) and isinstance(secret, str):
            fields = cast("dict[str, Any]", place)
            if (fields.get("connect"), fields.get("namespace")) == (connect, namespace):
                return secret
    return ""


def is_held(folder: Path) -> bool:
    """Return True if a supervisor that lives has locked a run folder."""
    try:
        with (folder / LOCK).open("rb") as stream:
            fcntl.flock(stream, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except BlockingIOError:
        return True
    except OSError:
        return False
    return False


def _changed(path: Path) -> int:
    try:
        return path.stat().st_mtime_ns
    except OSError:
        return 0


def _read(path: Path) -> Any:
    try:
        return json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError):
        return None
