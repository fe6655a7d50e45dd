"""One line of a log: when (UTC), how grave, who, in which tick, what. Written by services, read by `surefoot logs`.

``2026-03-01T12:00:00.123Z warning walker tick 250: refused (stale): ...``
"""

import re
from dataclasses import dataclass
from datetime import UTC, datetime

_FORM = re.compile(r"(\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d\.\d{3}Z) (\w+) +(\S+?)(?: tick (\d+))?: (.*)")


@dataclass(frozen=True)
class LogLine:
    """Line of a service's log as its parts."""

    time: str
    """UTC, ISO 8601 with ms: lines of several services sort by it as texts."""
    level: str
    service: str
    tick: int | None
    """Last tick the service had done; None before the first of a run."""
    text: str


def log_line(level: str, service: str, text: str, tick: int | None = None) -> str:
    """Return the line of a log entry at the present time; a text of several lines is folded into one."""
    now = datetime.now(UTC).isoformat(timespec="milliseconds").replace("+00:00", "Z")
    when = f" tick {tick}" if tick is not None and tick >= 0 else ""
    return f"{now} {level:<7} {service}{when}: {' | '.join(text.splitlines())}"


def read_log_line(line: str) -> LogLine | None:
    """Return a line taken apart; None for one that something else has written (a library, an interpreter that ends)."""
    match = _FORM.fullmatch(line)
    if match is None:
        return None
    time, level, service, tick, text = match.groups()
    return LogLine(time, level, service, None if tick is None else int(tick), text)


def sendable(text: str) -> str:
    """Return the text with what is no UTF-8 in it, as names of files may hold, written as escapes."""
    return text.encode("utf-8", "backslashreplace").decode()


def said(line: str) -> str:
    """Return the text of a log line without time and source."""
    found = read_log_line(line)
    return line if found is None else found.text
