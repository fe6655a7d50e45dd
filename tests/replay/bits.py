"""Bits of what services make of recorded inputs, here and elsewhere.

`python -m tests.replay.bits --write FILE` on one machine and `python -m tests.replay.bits FILE` on another, or under
an emulator, show for each recording and service whether all messages are equal to the last bit. Every value of
`FILE` is the digest of all messages of one key.
"""

import argparse
import hashlib
import json
import sys
from collections.abc import Sequence
from pathlib import Path

from surefoot.version import numbers
from tests.replay.cases import recorded, replayed

EXACT_DIGITS = 17
"""Significant digits that hold a double exactly."""


def digests(case: str, name: str) -> dict[str, str]:
    """Return a digest of all that a service publishes and replies to its recorded inputs, by key."""
    found: dict[str, hashlib._Hash] = {}
    for row in replayed(case, name, every=1, digits=EXACT_DIGITS):
        found.setdefault(row[0], hashlib.sha256()).update(json.dumps(row).encode())
    return {key: digest.hexdigest() for key, digest in found.items()}


def main(words: Sequence[str] | None = None) -> int:
    """Write the digests, or compare them with those of a file; return 1 where a message differs."""
    parser = argparse.ArgumentParser(prog="python -m tests.replay.bits", description=__doc__)
    parser.add_argument("file", type=Path)
    parser.add_argument("--write", action="store_true", help="write the file instead of comparing with it")
    parser.add_argument("--case", action="append", default=[], help="recording; may be repeated [all]")
    options = parser.parse_args(words)
    cases = [(case, name) for case, name in recorded() if not options.case or case in options.case]
    if not cases:
        parser.error(f"--case {options.case}: allowed are {', '.join(sorted({case for case, _ in recorded()}))}")
    if options.write:
        made = {f"{case} {name}": digests(case, name) for case, name in cases}
        options.file.write_text(json.dumps({"numbers": numbers(), "digests": made}, indent=1), encoding="utf-8")
        return 0
    try:
        there = json.loads(options.file.read_text(encoding="utf-8"))
        other = {name: there["digests"][name] for name in (f"{case} {name}" for case, name in cases)}
    except (OSError, ValueError, KeyError, TypeError) as error:
        parser.error(f"{options.file} is no file of --write with these cases: {error}")
    print(f"numbers there  {there['numbers']}\nnumbers here   {numbers()}", flush=True)
    failed = False
    for case, name in cases:
        was, now = other[f"{case} {name}"], digests(case, name)
        unlike = [key for key in was | now if was.get(key) != now.get(key)]
        failed |= bool(unlike)
        print(f"{case:<12} {name:<10} {'differs: ' + ', '.join(unlike) if unlike else 'equal'}", flush=True)
    return int(failed)


if __name__ == "__main__":
    sys.exit(main())
