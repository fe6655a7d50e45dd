"""Worker processes for walks that do not depend on each other."""

import os
import signal
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager


@contextmanager
def worker_processes(jobs: int | None = None, begin: Callable[[], object] = bool) -> Iterator[ProcessPoolExecutor]:
    """Yield a pool that ends at once on Ctrl-C: its processes die silently, and what waits is not begun.

    Args:
        jobs: processes; None = one a core.
        begin: called once in each process before its first job.
    """
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    pool = ProcessPoolExecutor(jobs or os.cpu_count() or 1, initializer=_begun, initargs=(begin,))
    try:
        yield pool
    except BaseException:
        pool.shutdown(cancel_futures=True)
        raise
    pool.shutdown()


def _begun(begin: Callable[[], object]) -> None:
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    begin()
