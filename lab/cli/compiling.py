"""Report on the terminal that kernels are being compiled, once that takes long."""

import threading
import time
from collections.abc import Callable, Generator
from contextlib import contextmanager

from surefoot.kernels.compiling import COMPILING

FIRST_S, EACH_S = 0.5, 10.0
"""Wall time of compiling before the first line, and between further lines."""


@contextmanager
def compilation_reported(notify: Callable[[str], None]) -> Generator[None]:
    """Report the compilation of kernels through `notify` in this context, from `FIRST_S` s of compiling on."""
    began, over = threading.Event(), threading.Event()

    def watch() -> None:
        began.wait()
        start, wait = time.monotonic(), FIRST_S
        text = "surefoot: compiling numeric kernels, half a minute or more, only this once (surefoot warm)"
        while not over.wait(wait):
            if COMPILING.busy:
                notify(text or f"  {COMPILING.done} kernels after {time.monotonic() - start:.0f} s")
                text, wait = "", EACH_S

    watcher = threading.Thread(target=watch, daemon=True)
    watcher.start()
    with COMPILING.reporting(lambda name: began.set()):
        try:
            yield
        finally:
            over.set()
            began.set()
            watcher.join()
