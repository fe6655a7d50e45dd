# pyright: basic
"""The processor that kernels are compiled for: all x86-64 processors with AVX2 and FMA count as one."""

import platform
from functools import cache

import llvmlite.binding as llvm

LEVEL = "x86-64-v3"
"""Processor level for which kernels are compiled: level 3 of the x86-64 psABI, by LLVM's name."""
NEEDS = frozenset(("avx", "avx2", "bmi", "bmi2", "f16c", "fma", "lzcnt", "movbe", "popcnt", "sse4.2", "xsave"))
"""Processor features, by LLVM's names, that `LEVEL` needs; if one is absent, kernels are compiled for this processor
alone."""


@cache
def processor() -> str:
    """Return `LEVEL` if the processor supports it, else a name made of its type and features.

    The features come from LLVM, as /proc/cpuinfo would show those of the host under an emulator.
    """
    has = sorted(name for name, there in llvm.get_host_cpu_features().items() if there)
    return LEVEL if NEEDS.issubset(has) else " ".join((platform.machine(), llvm.get_host_cpu_name(), *has))
