"""The processor that kernels are compiled for: all x86-64 processors with AVX2 and FMA count as one."""

import platform
from functools import cache
from pathlib import Path

LEVEL = "x86-64-v3"
"""Level 3 of the x86-64 psABI, as LLVM names it."""
FLAGS = frozenset(("avx", "avx2", "bmi1", "bmi2", "f16c", "fma", "abm", "movbe", "popcnt", "sse4_2", "xsave"))
"""Flags that a processor of that level has, by the names of /proc/cpuinfo."""
CPUINFO = Path("/proc/cpuinfo")


@cache
def processor() -> str:
    """Return `LEVEL` where the processor has it, else a name that holds for this processor only."""
    try:
        text = CPUINFO.read_text()
    except OSError:
        text = ""
    flags = next(
        (line.partition(":")[2].split() for line in text.splitlines() if line.startswith("flags")), list[str]()
    )
    return LEVEL if FLAGS.issubset(flags) else f"{platform.machine()} {' '.join(sorted(flags))}"
