"""Command line of the benchmarks.

``python -m benchmarks`` lists them, ``python -m benchmarks NAME [PART] [--option ...]`` runs one, and ``all`` in place
of a name runs every one with its default options, which takes hours. ``--quick`` stands for the smallest options.
"""

import ast
import importlib
import sys
import time
from pathlib import Path

from surefoot.errors import SurefootError

NAMES = (
    "studies", "goals", "obstacles", "walker", "biped", "footholds", "foothold_walks", "foothold_grounds", "trials",
    "estimator", "accuracy", "foreign", "navigator", "policies", "lost", "stability", "queries", "peers", "bus",
    "core", "lockstep", "simulator", "starts", "soak", "flood", "accidents", "secure", "vision", "vision_live",
    "robots", "fuzz", "storage", "view", "report", "own_map", "knocked", "forged", "docking",
)  # fmt: skip


def about(name: str) -> str:
    """Return the first line of a benchmark's docstring; the module is not imported."""
    text = Path(__file__).with_name(f"{name}.py").read_text(encoding="utf-8")
    return (ast.get_docstring(ast.parse(text)) or "").partition("\n")[0]


def main(words: list[str]) -> int:
    """Run a benchmark, all, or list them; return the exit code, 2 of wrong words, 130 after Ctrl-C."""
    name, *rest = words or ["--help"]
    if name in ("-h", "--help"):
        for known in NAMES:
            print(f"{known:15} {about(known)}")
        print("\npython -m benchmarks NAME --help lists the parts or options of one; `all` runs every one")
        return 0
    if name not in (*NAMES, "all"):
        print(f"no benchmark {name!r}; there are {', '.join(NAMES)} and all", file=sys.stderr)
        return 2
    for one in NAMES if name == "all" else (name,):
        print(f"== {one}", flush=True)
        began = time.monotonic()
        try:
            importlib.import_module(f"benchmarks.{one}").BENCH.main(rest)
        except SurefootError as error:
            print(f"{one}: {error}", file=sys.stderr)
            return 2
        except KeyboardInterrupt as kept:
            print(f"{one}: interrupted; {kept}".rstrip("; "), file=sys.stderr)
            return 130
        print(f"== {one}: {time.monotonic() - began:.0f} s\n", flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
