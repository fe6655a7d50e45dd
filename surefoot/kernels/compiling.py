"""State of the compiler of kernels: noted by `surefoot.kernels.jit`, read by the runtime. Imports no compiler."""

from collections import Counter
from collections.abc import Callable, Generator
from contextlib import contextmanager
from threading import get_ident


class Compiling:
    """Compilations of this process; a kernel that comes from the cache on disk is none."""

    def __init__(self) -> None:
        self.used = False
        """Kernels are there at all."""
        self.done = 0
        """Compilations that ended."""
        self.last = ""
        """Name of the kernel that was compiled last."""
        self._depth = 0
        self._by_thread = Counter[int]()
        self._listeners: list[Callable[[str], None]] = []

    @property
    def busy(self) -> bool:
        """Return whether a kernel is being compiled now."""
        return self._depth > 0

    @property
    def done_here(self) -> int:
        """Return the number of compilations that ended on this thread."""
        return self._by_thread[get_ident()]

    def began(self, name: str) -> None:
        """Note that the compilation of a kernel began; listeners are called for the outermost one only."""
        self._depth += 1
        if self._depth == 1:
            for listener in tuple(self._listeners):
                listener(name)

    def ended(self, name: str, counts: bool = True) -> None:
        """Count a kernel as compiled, unless it is one step of several."""
        self._depth -= 1
        self.done += counts
        self._by_thread[get_ident()] += counts
        self.last = name

    @contextmanager
    def reporting(self, listener: Callable[[str], None]) -> Generator[None]:
        """Call `listener` with the name of each kernel before it is compiled, inside the context."""
        self._listeners.append(listener)
        try:
            yield
        finally:
            self._listeners.remove(listener)


COMPILING = Compiling()
"""Compilation of kernels in this process, and its listeners."""
