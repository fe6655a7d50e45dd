"""Entry point of the program `surefoot`: runs `stop` at once, every other command through `surefoot.lab.cli.main`."""

import io
import os
import sys
from collections.abc import Sequence

VALUES = ("--reason", "--timeout", "--connect", "--namespace")


def main(arguments: list[str] | None = None) -> None:
    """Run the command line; exit code 0: ok, 1: a check failed, 2: usage error, 130: interrupted."""
    words = sys.argv[1:] if arguments is None else arguments
    open_closed_streams()
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="replace")  # of a terminal that lacks a character
    options = stop_options(words)
    if options is not None:
        from surefoot.errors import SurefootError

        from .running import systems
        from .stopping import REASON, TIMEOUT_S, report, stop_all

        try:
            chosen = (options.get(name) for name in ("--connect", "--namespace", "system"))
            found = systems(*chosen, orphaned=True)
            reason, timeout_s = options.get("--reason", REASON), float(options.get("--timeout", TIMEOUT_S))
            sys.exit(report(stop_all(found, reason, timeout_s), json="--json" in options))
        except SurefootError:
            pass  # reported as by every other command
        except KeyboardInterrupt:
            sys.exit(130)
    from . import main as everything

    everything.main(words)


def open_closed_streams() -> None:
    """Open standard input, output and error at the null device if they are closed, as a parent process may leave them.

    Otherwise the first file or connection that the process opens would take their number, and get what is printed.
    """
    for number in (0, 1, 2):
        try:
            os.fstat(number)
        except OSError:
            os.open(os.devnull, os.O_RDWR)  # takes the lowest number that is free
    if sys.stdout is None:
        sys.stdout = os.fdopen(1, "w", encoding="utf-8", closefd=False)
    if sys.stderr is None:
        sys.stderr = os.fdopen(2, "w", encoding="utf-8", closefd=False)


def stop_options(words: Sequence[str]) -> dict[str, str] | None:
    """Return the options of a plain `stop` command by name; None for other commands, wrong words, and --help."""
    if not words or words[0] != "stop":
        return None
    found: dict[str, str] = {}
    rest = iter(words[1:])
    for word in rest:
        if word in VALUES:
            found[word] = next(rest, "")
        elif word == "--json":
            found[word] = ""
        elif not word.startswith("-") and "system" not in found:
            found["system"] = word
        else:
            return None
    try:
        well = float(found.get("--timeout", "1")) >= 0.1
    except ValueError:
        well = False
    return found if well and all(found.get(name, "x") for name in VALUES) else None


if __name__ == "__main__":
    main()
