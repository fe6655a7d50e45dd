"""Pools of worker processes and threads for independent jobs."""

import os
import signal
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, ProcessPoolExecutor, ThreadPoolExecutor
from contextlib import contextmanager


@contextmanager
def worker_processes(jobs: int | None = None, begin: Callable[[], object] = bool) -> Iterator[ProcessPoolExecutor]:
    """Yield a process pool; on Ctrl-C its processes are killed at once and waiting jobs are dropped.

    Args:
        jobs: number of processes; None = one per core.
        begin: called once in each process before its first job.
    """
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    pool = ProcessPoolExecutor(jobs or os.cpu_count() or 1, initializer=_begun, initargs=(begin,))
    try:
        yield pool
    except KeyboardInterrupt:
        processes = list(pool._processes.values())  # pyright: ignore[reportPrivateUsage] - before it forgets them
        pool.shutdown(wait=False, cancel_futures=True)  # first, so that what waits is cancelled and not broken
        for process in processes:
            process.kill()
            process.join()
        raise
    except BaseException:
        pool.shutdown(cancel_futures=True)
        raise
    pool.shutdown()


@contextmanager
def worker_threads() -> Iterator[Executor]:
    """Yield a pool with one thread per core; after Ctrl-C or an error running jobs finish, waiting ones are dropped."""
    pool = ThreadPoolExecutor(os.cpu_count() or 1)
    try:
        yield pool
    except BaseException:
        pool.shutdown(cancel_futures=True)
        raise
    pool.shutdown()


def _begun(begin: Callable[[], object]) -> None:
    signal.signal(signal.SIGINT, lambda *_: None)  # of the terminal's group: the pool's owner ends this process
    begin()
