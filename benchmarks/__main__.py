"""``python -m benchmarks [name ...]``: runs the named benchmarks (``bench_<name>.py``), or all of them."""

import importlib
import pkgutil
import sys
import time

import benchmarks


def main(names: list[str]) -> int:
    """Runs benchmarks; returns the exit code."""
    known = sorted(m.name[6:] for m in pkgutil.iter_modules(benchmarks.__path__) if m.name.startswith("bench_"))
    for name in names:
        if name not in known:
            print(f"no benchmark {name!r}; there are {', '.join(known)}", file=sys.stderr)
            return 2
    for name in names or known:
        print(f"== {name}", flush=True)
        began = time.monotonic()
        sys.argv = [f"bench_{name}"]  # what follows on this command line are names, not options of a benchmark
        importlib.import_module(f"benchmarks.bench_{name}").main()
        print(f"== {name}: {time.monotonic() - began:.0f} s\n", flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
