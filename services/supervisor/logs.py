"""Reading logs from their end, and following them as they grow."""

import time
from collections.abc import Iterator, Mapping
from pathlib import Path

BLOCK = 1 << 16
POLL_S = 0.1


def tail(path: Path, lines: int) -> list[str]:
    """Return the last lines of a file without reading the rest of it."""
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


def follow_logs(paths: Mapping[str, Path]) -> Iterator[tuple[str, str]]:
    """Yield (service, line) as whole lines are added; never ends."""
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
