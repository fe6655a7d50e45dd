"""Decorators that compile numeric functions (kernels) with numba and keep the machine code on disk."""

import gc
import importlib
import os
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar, cast

from numba.core import event  # pyright: ignore[reportMissingTypeStubs]

from surefoot.kernels.compiling import COMPILING
from surefoot.kernels.kept import choose_processor
from surefoot.kernels.sources import fingerprint

F = TypeVar("F", bound=Callable[..., Any])


class _Listener(event.Listener):  # pyright: ignore[reportUntypedBaseClass]
    """Counter of compilations by numba; functions loaded from the cache do not count.

    The collector of garbage rests meanwhile: it would go through all of numba's objects again and again, a sixth of
    the time of a compilation.
    """

    def __init__(self) -> None:
        self._collects = False
        self._linked = set[Any]()  # what the compilation now under way has counted: a wrapper of it counts no more

    def on_start(self, event: Any) -> None:
        if not COMPILING.busy:
            self._collects = gc.isenabled()
            gc.disable()
            self._linked.clear()
        COMPILING.began(event.data["dispatcher"].py_func.__qualname__)

    def on_end(self, event: Any) -> None:
        function, args = event.data["dispatcher"].py_func, event.data["args"]
        COMPILING.ended(function.__qualname__, (function, args) not in self._linked)
        self._linked.add((function, args))
        if self._collects and not COMPILING.busy:
            gc.enable()


def _load_without_scipy() -> None:
    """Load numba's array functions without scipy.linalg, which they need for np.cov only, and save 0.15 s at the start.

    Kernels that multiply matrices find scipy's BLAS when they first do so.
    """
    name = "scipy.linalg.cython_blas"
    if name in sys.modules:
        return
    sys.modules[name] = None  # type: ignore[assignment] - an import of it fails at once
    try:
        importlib.import_module("numba.np.arraymath")
    finally:
        del sys.modules[name]


_load_without_scipy()

import numba  # noqa: E402  # pyright: ignore[reportMissingTypeStubs] - after what has to be loaded without scipy
from numba.core.registry import cpu_target  # noqa: E402  # pyright: ignore[reportMissingTypeStubs]

TESTED = "0.68."
"""Prefix of the numba versions whose internals `surefoot.kernels.linking` supports; others compile by numba alone."""
PLAIN = os.environ.get("SUREFOOT_KERNELS") == "plain" or not numba.__version__.startswith(TESTED)
"""True if kernels are compiled by numba alone, with the same results; False: by the faster
`surefoot.kernels.linking`."""

if PLAIN:
    from surefoot.kernels.plain import PlainKernel as Kernel
else:
    from surefoot.kernels.linking import Kernel

_KERNELS: list[Any] = []

COMPILING.used = True
choose_processor()
event.register("numba:compile", _Listener())  # pyright: ignore[reportUnknownMemberType]


def kernel(function: F) -> F:
    """Compile `function` with numba on its first call and keep the machine code on disk.

    The compiled object is given the type of the plain function, so that a type checker sees the signature.
    """
    return _compiled(function)


def inner_kernel(function: F) -> F:
    """Compile `function` with numba and copy (inline) its code into its callers: for steps of a loop with many arrays.

    An array argument is passed as seven numbers or more; a dozen of them cost as much as a short loop. The time of the
    compiler grows with the square of the caller's length, so this is for small functions with few callers.
    """
    return _compiled(function, forceinline=True)


def row_kernel(function: F) -> F:
    """Compile `function` with numba so that x / 0 is inf or NaN as in numpy: its loops can become vector code.

    Other kernels raise ZeroDivisionError instead. The machine code is kept on disk.
    """
    return _compiled(function, error_model="numpy")


def free_kernel(function: F) -> F:
    """Compile `function` with numba so that it runs without the global interpreter lock, and other threads go on.

    x / 0 is inf or NaN as in numpy, without an exception. The machine code is kept on disk.
    """
    return _compiled(function, error_model="numpy", nogil=True)


def load_tables() -> None:
    """Load numba's tables of types and functions, which takes 0.15 s; without a call the first kernel loads them."""
    contexts: Any = cpu_target
    contexts.typing_context.refresh()
    contexts.target_context.refresh()


def loaded() -> dict[str, int]:
    """Return the number of specialisations of each kernel that Python has called in this process, by full name."""
    return {f"{k.__module__}.{k.__qualname__}": len(k.signatures) for k in _KERNELS if k.signatures}


def kept_files() -> dict[str, str]:
    """Return the cache index files of kernels that Python has called: hash of their sources by path of the file."""
    found = dict[str, str]()
    for each in _KERNELS:
        for path in (Path(index._index_path) for index in each.cache_files() if each.signatures):
            hashed = fingerprint(each.__module__)
            if path.exists() and hashed.encode() in path.read_bytes():  # may be of other sources, and not in use
                found[str(path)] = hashed
    return found


def set_aside() -> None:
    """Forget which kernels Python has called; they stay in memory, and count again once they are called."""
    for each in _KERNELS:
        each.set_aside()


def _compiled(function: F, **options: Any) -> F:
    """Return the kernel of a function, whose machine code on disk is valid while all files that went into it stay.

    Loops become vectors where divisions are as in numpy: elsewhere they are short, and vectors give the same bits.
    `options`: target options of numba.
    """
    compiled: Any = Kernel(function, targetoptions=dict(options, nopython=True))
    compiled.vectors = options.get("error_model") == "numpy"
    _KERNELS.append(compiled)
    compiled.enable_caching()
    for index in compiled.cache_files():
        index._source_stamp = (index._source_stamp, *map(fingerprint, (function.__module__, Kernel.__module__)))
    return cast(F, compiled)
