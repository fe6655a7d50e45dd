"""``python -m benchmarks [name ...]`` runs the named benchmarks (``bench_<name>.py``), or all of them.

``python -m benchmarks name --option ...`` runs one with its options; ``--help`` lists them.
"""

import importlib
import pkgutil
import sys
import time

import benchmarks


def main(words: list[str]) -> int:
    """Run benchmarks; return the exit code."""
    known = sorted(m.name[6:] for m in pkgutil.iter_modules(benchmarks.__path__) if m.name.startswith("bench_"))
    at = next((i for i, word in enumerate(words) if word.startswith("-")), len(words))
    names, options = words[:at], words[at:]
    for name in names:
        if name not in known:
            print(f"no benchmark {name!r}; there are {', '.join(known)}", file=sys.stderr)
            return 2
    if options and len(names) != 1:
        print(f"options belong to one benchmark; got {len(names)} before {options[0]}", file=sys.stderr)
        return 2
    for name in names or known:
        print(f"== {name}", flush=True)
        began = time.monotonic()
        sys.argv = [f"bench_{name}", *options]
        importlib.import_module(f"benchmarks.bench_{name}").main()
        print(f"== {name}: {time.monotonic() - began:.0f} s\n", flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
