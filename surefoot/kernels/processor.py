# pyright: basic
"""The processor that kernels are compiled for: all x86-64 processors with AVX2 and FMA count as one."""

import platform
from functools import cache

import llvmlite.binding as llvm

LEVEL = "x86-64-v3"
"""Level 3 of the x86-64 psABI, as LLVM names it."""
NEEDS = frozenset(("avx", "avx2", "bmi", "bmi2", "f16c", "fma", "lzcnt", "movbe", "popcnt", "sse4.2", "xsave"))
"""Features that a processor of that level has, by LLVM's names."""


@cache
def processor() -> str:
    """Return `LEVEL` where the processor has it, else a name that holds for such a processor only.

    LLVM asks the processor itself: /proc/cpuinfo would show the host's under an emulator.
    """
    has = sorted(name for name, there in llvm.get_host_cpu_features().items() if there)
    return LEVEL if NEEDS.issubset(has) else " ".join((platform.machine(), llvm.get_host_cpu_name(), *has))
