"""Worker processes for walks that do not depend on each other."""

import os
import signal
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager


@contextmanager
def worker_processes(jobs: int | None = None) -> Iterator[ProcessPoolExecutor]:
    """Yield a pool that ends at once on Ctrl-C: its processes die silently, and what waits is not begun.

    Args:
        jobs: processes; None = one a core.
    """
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    pool = ProcessPoolExecutor(
        jobs or os.cpu_count() or 1, initializer=signal.signal, initargs=(signal.SIGINT, signal.SIG_DFL)
    )
    try:
        yield pool
    except BaseException:
        pool.shutdown(cancel_futures=True)
        raise
    pool.shutdown()
