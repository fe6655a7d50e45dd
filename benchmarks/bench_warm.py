"""Processor time of a cold `surefoot warm`, beside that of other checkouts, in turn.

`python -m benchmarks.bench_warm --against DIR` compares this checkout with the one in DIR, each in its own .venv, with
empty caches.
"""

import argparse
import os
import resource
import statistics
import subprocess
import tempfile
import time
from pathlib import Path

HERE = Path(__file__).resolve().parents[1]


def cold(checkout: Path, words: tuple[str, ...]) -> tuple[float, float]:
    """Return processor and wall seconds of `surefoot warm --force` and `words`, without anything compiled before."""
    with tempfile.TemporaryDirectory() as empty:
        environment = os.environ | {"NUMBA_CACHE_DIR": f"{empty}/numba", "XDG_CACHE_HOME": f"{empty}/cache"}
        command = [checkout / ".venv/bin/surefoot", "warm", "--force", *words]
        before, began = resource.getrusage(resource.RUSAGE_CHILDREN), time.monotonic()
        subprocess.run(command, cwd=checkout, env=environment, check=True, capture_output=True)
        after, wall = resource.getrusage(resource.RUSAGE_CHILDREN), time.monotonic() - began
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime, wall


def main(arguments: list[str] | None = None) -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--against", type=Path, action="append", default=[], help="another checkout, set up")
    parser.add_argument("--rounds", type=int, default=1)
    options = parser.parse_args(arguments)
    cases = [(path.resolve(), ()) for path in options.against] + [(HERE, ()), (HERE, ("--all",))]
    took: dict[tuple[Path, tuple[str, ...]], list[tuple[float, float]]] = {case: [] for case in cases}
    for _ in range(options.rounds):
        for case in cases:
            took[case].append(cold(*case))
    print(f"{'checkout':32s} {'':6s} {'processor s':>11s} {'wall s':>7s}")
    for (path, words), pairs in took.items():
        cpu, wall = (statistics.median(pair[i] for pair in pairs) for i in (0, 1))
        print(f"{path!s:32s} {' '.join(words):6s} {cpu:11.1f} {wall:7.1f}")


if __name__ == "__main__":
    import sys

    main(sys.argv[1:])
