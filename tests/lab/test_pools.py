"""Worker processes die silently on Ctrl-C, and what waits for them is not begun."""

import os
import signal
import time
from concurrent.futures import CancelledError, Future
from concurrent.futures.process import BrokenProcessPool
from threading import Event

import pytest

from surefoot.lab.pools import worker_processes, worker_threads


def test_a_worker_leaves_ctrl_c_to_its_owner() -> None:
    with worker_processes(1) as pool:
        assert pool.submit(signal.raise_signal, signal.SIGINT).result() is None
        assert list(pool.map(abs, (-1, 2))) == [1, 2]


def test_after_ctrl_c_what_waits_is_not_begun() -> None:
    waiting = []
    try:
        with worker_processes(1) as pool:
            waiting += [pool.submit(time.sleep, 60.0) for _ in range(100)]
            raise KeyboardInterrupt
    except KeyboardInterrupt:
        pass
    assert isinstance(waiting[0].exception(30.0), BrokenProcessPool)
    with pytest.raises(CancelledError):
        waiting[-1].result(30.0)


def test_after_ctrl_c_threads_finish_what_they_run_and_begin_no_more() -> None:
    cancelled, begun = Event(), []

    def job(number: int) -> None:
        begun.append(number)
        cancelled.wait(1.0)

    def interrupted() -> Future[None]:
        with worker_threads() as pool:
            futures = [pool.submit(job, number) for number in range(200)]
            futures[-1].add_done_callback(lambda _: cancelled.set())
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        interrupted()
    assert len(begun) <= (os.cpu_count() or 1)
