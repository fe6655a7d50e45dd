"""Format of a log line: time (UTC), level, service, tick, text. Written by services, read by `surefoot logs`.

``2026-03-01T12:00:00.123Z warning walker tick 250: refused (stale): ...``
"""

import re
import sys
from contextlib import suppress
from dataclasses import dataclass
from datetime import UTC, datetime

_FORM = re.compile(r"(\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d\.\d{3}Z) (\w+) +(\S+?)(?: tick (\d+))?: (.*)")


@dataclass(frozen=True)
class LogLine:
    """Parts of one line of a service's log."""

    time: str
    """Time of the line, UTC, ISO 8601 with ms, so that lines of several services, sorted as texts, are in order of
    time."""
    level: str
    service: str
    tick: int | None
    """Number of the last control tick that the service had finished at that time; None = before the first tick of a
    run."""
    text: str


def log_line(level: str, service: str, text: str, tick: int | None = None) -> str:
    """Return a log line with the present time, level, service and tick; lines of `text` are joined to one by `|`.

    `level`: debug, info, warning or error; `tick`: control tick, None or below 0 = it is left out.
    """
    now = datetime.now(UTC).isoformat(timespec="milliseconds").replace("+00:00", "Z")
    when = f" tick {tick}" if tick is not None and tick >= 0 else ""
    return f"{now} {level:<7} {service}{when}: {' | '.join(text.splitlines())}"


def write_line(line: str) -> None:
    """Write a line to standard error; where that is a file on a full disk, the line is lost and nothing else."""
    with suppress(OSError):
        sys.stderr.write(line + "\n")
        sys.stderr.flush()


def read_log_line(line: str) -> LogLine | None:
    """Return the parts of a log line; None for a line of another format, such as the output of a library."""
    match = _FORM.fullmatch(line)
    if match is None:
        return None
    time, level, service, tick, text = match.groups()
    return LogLine(time, level, service, None if tick is None else int(tick), text)


def sendable(text: str) -> str:
    """Return the text with characters that UTF-8 cannot encode (file names may hold some) written as escapes."""
    return text.encode("utf-8", "backslashreplace").decode()


def said(line: str) -> str:
    """Return the text of a log line without time, level, service and tick; a line of another format as it is."""
    found = read_log_line(line)
    return line if found is None else found.text
