"""State of kernel compilation in this process, written by `surefoot.kernels.jit`; the import needs no compiler."""

from collections import Counter
from collections.abc import Callable, Generator
from contextlib import contextmanager
from threading import Timer, get_ident
from time import monotonic

NOTICE_S = 0.9
"""Time, s, after which a process that compiles and has no listeners, such as a program that uses the library, logs a
line."""


class Compiling:
    """Record of the kernel compilations of this process; loading a kernel from the cache on disk does not count."""

    def __init__(self) -> None:
        self.used = False
        """True once `surefoot.kernels.jit` was imported, so kernels may be compiled; False: the process has no
        kernels."""
        self.done = 0
        """Number of kernel compilations that ended in this process."""
        self.last = ""
        """Name of the kernel that was compiled last."""
        self._depth, self._since, self._spent = 0, 0.0, 0.0
        self._timed = False  # a notice was logged, or is due
        self._by_thread = Counter[int]()
        self._listeners: list[Callable[[str], None]] = []

    @property
    def busy(self) -> bool:
        """True while a kernel is being compiled."""
        return self._depth > 0

    @property
    def reported(self) -> bool:
        """True while a kernel is being compiled and a listener is called with the name of each; else False."""
        return self.busy and bool(self._listeners)

    @property
    def spent_s(self) -> float:
        """Wall time, s, in which this process compiled kernels so far."""
        return self._spent + (monotonic() - self._since if self.busy else 0.0)

    @property
    def done_here(self) -> int:
        """Number of kernel compilations that ended on the calling thread."""
        return self._by_thread[get_ident()]

    def began(self, name: str) -> None:
        """Record that compilation of kernel `name` began; call the listeners unless it is part of another one."""
        self._depth += 1
        if self._depth == 1:
            self._since = monotonic()
            for listener in tuple(self._listeners):
                listener(name)
            if not self._listeners and not self._timed:
                self._timed = True
                timer = Timer(NOTICE_S, self._notice)
                timer.daemon = True
                timer.start()

    def ended(self, name: str, counts: bool = True) -> None:
        """Record that compilation of kernel `name` ended; `counts`: False for a step that is not to be counted."""
        self._depth -= 1
        if not self.busy:
            self._spent += monotonic() - self._since
        self.done += counts
        self._by_thread[get_ident()] += counts
        self.last = name

    @contextmanager
    def reporting(self, listener: Callable[[str], None]) -> Generator[None]:
        """Context manager in which `listener` is called with the name of each kernel before it is compiled."""
        self._listeners.append(listener)
        try:
            yield
        finally:
            self._listeners.remove(listener)

    def _notice(self) -> None:
        """Log once that kernels are being compiled, as a warning of logger `surefoot`: by default on the terminal."""
        self._timed = self.busy
        if self.busy:
            import logging

            text = "surefoot: compiling numeric kernels, half a minute or more, only this once (surefoot warm)"
            logging.getLogger("surefoot").warning(text)


COMPILING = Compiling()
"""Record of the kernel compilations in this process, and its listeners."""
