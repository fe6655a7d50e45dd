"""Reading logs from their end, and following them as they grow."""

import time
from collections.abc import Iterator, Mapping
from operator import itemgetter
from pathlib import Path

from surefoot.logline import read_log_line

BLOCK = 1 << 16
POLL_S = 0.1


def tail(path: Path, lines: int) -> list[str]:
    """Return the last `lines` lines of a file, read from its end."""
    if lines <= 0:
        return []
    try:
        with path.open("rb") as stream:
            end = stream.seek(0, 2)
            text = b""
            while end > 0 and text.count(b"\n") <= lines:
                start = max(0, end - BLOCK)
                stream.seek(start)
                text = stream.read(end - start) + text
                end = start
    except OSError:
        return []
    return text.decode("utf-8", "replace").splitlines()[-lines:]


def last_lines(paths: Mapping[str, Path], lines: int) -> list[tuple[str, str]]:
    """Return the last lines of each log as (service, line), all in the order of time.

    A line without a time, e.g. of a library or of a crash, stays behind the line before it.
    """
    found: list[tuple[str, str, str]] = []
    for name, path in paths.items():
        time_of_last = ""
        for line in tail(path, lines):
            read = read_log_line(line)
            time_of_last = time_of_last if read is None else read.time
            found.append((time_of_last, name, line))
    return [(name, line) for _, name, line in sorted(found, key=itemgetter(0))]


def follow_logs(paths: Mapping[str, Path]) -> Iterator[tuple[str, str]]:
    """Yield (service, line) for each whole line that is added to a log; never ends."""
    places = {name: path.stat().st_size for name, path in paths.items() if path.exists()}
    rest = dict.fromkeys(paths, "")
    while True:
        for name, path in paths.items():
            size = path.stat().st_size if path.exists() else 0
            place = places.get(name, 0) if size >= places.get(name, 0) else 0  # smaller: it was begun anew
            with path.open("rb") as stream:
                stream.seek(place)
                text = rest[name] + stream.read().decode("utf-8", "replace")
                places[name] = stream.tell()
            *lines, rest[name] = text.split("\n")
            for line in lines:
                yield name, line
        time.sleep(POLL_S)
