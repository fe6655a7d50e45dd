"""Processor settings under which numeric results must hold, and the command that tests them all.

`python -m tests.processors` runs the numeric tests once per setting and prints a line for each; with `--hashes` it
repeats the public list of runs instead, whose hashes must be those of the list; `--list` prints the settings only.
OpenBLAS and numpy choose their code by the processor: each setting makes them choose another.
"""

import argparse
import os
import re
import subprocess
import sys
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

ROOT = Path(__file__).parents[1]
LIMIT_S = 3600.0  # s wall for the numeric tests under one setting
PIN = "import os, sys; os.sched_setaffinity(0, {int(sys.argv[1])}); os.execvp(sys.argv[2], sys.argv[2:])"
CHOICES = ("OPENBLAS_CORETYPE", "OPENBLAS_NUM_THREADS", "NPY_DISABLE_CPU_FEATURES")
AVX512_OF_NUMPY = ("X86_V4", "AVX512_ICL", "AVX512_SPR")

NUMERIC = ("tests/surefoot", "tests/services", "tests/papers")
WITHOUT = (
    "tests/services/supervisor/processes/test_process.py",
    "tests/services/supervisor/processes/test_rundir.py",
    "tests/services/supervisor/processes/test_session.py",
    "tests/surefoot/bus/test_zenoh_bus.py",
    "tests/surefoot/kernels",
    "tests/surefoot/lockstep/test_foreign.py",
    "tests/surefoot/lockstep/test_packaged.py",
    "tests/surefoot/lockstep/test_zenoh_run.py",
    "tests/surefoot/test_import.py",
)
"""Files of these folders about processes, sockets and caches; their results hold no computed numbers."""


@dataclass(frozen=True)
class Setting:
    """One way to choose numeric code.

    Attributes:
        name: short, for the table.
        variables: environment variables; the others of `CHOICES` are unset.
        flags: processor flags that the chosen code needs, by their names in /proc/cpuinfo.
        one_core: whether the process may use a single core only.
    """

    name: str
    variables: Mapping[str, str] = field(default_factory=dict[str, str])
    flags: tuple[str, ...] = ()
    one_core: bool = False

    def environment(self) -> dict[str, str]:
        """Return the environment of a process under this setting."""
        kept = {name: value for name, value in os.environ.items() if name not in CHOICES}
        return {**kept, **self.variables}

    def command(self, *words: str) -> list[str]:
        """Return the command that runs Python with `words` under this setting."""
        python = [sys.executable, *words]
        if not self.one_core:
            return python
        return [sys.executable, "-c", PIN, str(min(os.sched_getaffinity(0))), *python]

    def obstacle(self) -> str:
        """Return why this machine cannot use the setting, empty when it can."""
        missing = [flag for flag in self.flags if flag not in cpu_flags()]
        if missing:
            return f"the processor has no {', '.join(missing)}"
        if self.variables.get("NPY_DISABLE_CPU_FEATURES") == "":
            return "numpy uses no AVX-512 on this machine"
        if self.one_core and not hasattr(os, "sched_setaffinity"):
            return "this system cannot pin a process to a core"
        return ""


def cpu_flags() -> frozenset[str]:
    """Return the flags of the first processor in /proc/cpuinfo, none where there is no such file."""
    try:
        text = Path("/proc/cpuinfo").read_text(encoding="utf-8")
    except OSError:
        return frozenset()
    found = re.search(r"^flags\s*:(.*)$", text, re.MULTILINE)
    return frozenset(found.group(1).split()) if found else frozenset()


def numpy_features(wanted: Sequence[str]) -> str:
    """Return those of the features that this numpy chooses at run time and this machine has, as numpy wants them."""
    from numpy._core import _multiarray_umath as numpy_core

    known, has = numpy_core.__cpu_dispatch__, numpy_core.__cpu_features__
    return " ".join(name for name in wanted if name in known and has.get(name, False))


def settings() -> tuple[Setting, ...]:
    """Return the table of settings; the first is the one without any choice."""
    avx2 = ("avx2", "fma")
    return (
        Setting("default"),
        Setting("prescott", {"OPENBLAS_CORETYPE": "Prescott"}, ("pni",)),
        Setting("haswell", {"OPENBLAS_CORETYPE": "Haswell"}, avx2),
        Setting("skylakex", {"OPENBLAS_CORETYPE": "SkylakeX"}, (*avx2, "avx512f", "avx512dq", "avx512bw", "avx512vl")),
        Setting("zen", {"OPENBLAS_CORETYPE": "Zen"}, avx2),
        Setting("no-avx512", {"NPY_DISABLE_CPU_FEATURES": numpy_features(AVX512_OF_NUMPY)}),
        Setting("1-thread", {"OPENBLAS_NUM_THREADS": "1"}),
        Setting("8-threads", {"OPENBLAS_NUM_THREADS": "8"}),
        Setting("1-core", one_core=True),
    )


def run_tests(setting: Setting, words: Sequence[str]) -> tuple[bool, str]:
    """Run the numeric tests under a setting; return whether they passed, and pytest's output."""
    command = ["-m", "pytest", *NUMERIC, "-m", "not slow and not e2e", *(f"--ignore={path}" for path in WITHOUT)]
    workers = [] if setting.one_core else ["-n", "2"]
    return _run(setting, [*command, *workers, *words])


def run_public_list(setting: Setting, words: Sequence[str]) -> tuple[bool, str]:
    """Repeat the public list of runs under a setting; return whether all hashes are the list's, and what it printed."""
    return _run(setting, ["-m", "surefoot.lab.cli.entry", "verify", *words])


def _run(setting: Setting, words: Sequence[str]) -> tuple[bool, str]:
    process = subprocess.Popen(
        setting.command(*words), cwd=ROOT, env=setting.environment(), text=True,
        stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
    )  # fmt: skip
    try:
        output, _ = process.communicate(timeout=LIMIT_S)
    finally:
        if process.poll() is None:
            process.kill()
            process.wait()
    return process.returncode == 0, output


def summary(output: str) -> str:
    """Return pytest's line of counts without its time, or the last line that a command printed."""
    counts = re.findall(r"^=*\s*((?:\d+ \w+(?:, )?)+) in ", output, re.MULTILINE)
    return next(iter([*counts[-1:], *output.splitlines()[-1:]]), "no result")


def main(arguments: Sequence[str] | None = None) -> int:
    """Test every setting, or list them; return 1 when a test failed."""
    parser = argparse.ArgumentParser(prog="python -m tests.processors", description=__doc__)
    parser.add_argument("--list", action="store_true", help="print the settings and end")
    names = [setting.name for setting in settings()]
    parser.add_argument("--only", action="append", default=[], choices=names, help="this setting; may be repeated")
    parser.add_argument("--hashes", action="store_true", help="repeat the public list of runs instead of the tests")
    parser.add_argument("words", nargs="*", help="more arguments for pytest or `surefoot verify`, after --")
    options = parser.parse_args(arguments)
    chosen = [setting for setting in settings() if not options.only or setting.name in options.only]
    failed = False
    for setting in chosen:
        variables = " ".join(f"{name}={value!r}" for name, value in setting.variables.items())
        what = f"{setting.name:<10} {variables or 'one core' * setting.one_core}"
        obstacle = setting.obstacle()
        if obstacle or options.list:
            print(f"{what}: skipped, {obstacle}" if obstacle else what, flush=True)
            continue
        began = time.monotonic()
        passed, output = (run_public_list if options.hashes else run_tests)(setting, options.words)
        failed |= not passed
        print(
            f"{what}: {'ok' if passed else 'FAILED'}, {summary(output)}, {time.monotonic() - began:.0f} s", flush=True
        )
        if not passed:
            print(output, file=sys.stderr, flush=True)
    return int(failed)


if __name__ == "__main__":
    sys.exit(main())
