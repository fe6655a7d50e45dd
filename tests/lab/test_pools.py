"""Worker processes die silently on Ctrl-C, and what waits for them is not begun."""

import signal
from concurrent.futures import CancelledError

import pytest

from surefoot.lab.pools import worker_processes


def test_a_worker_ends_on_ctrl_c_without_a_traceback() -> None:
    with worker_processes(1) as pool:
        assert pool.submit(signal.getsignal, signal.SIGINT).result() == signal.SIG_DFL
        assert list(pool.map(abs, (-1, 2))) == [1, 2]


def test_after_ctrl_c_what_waits_is_not_begun() -> None:
    waiting = []
    try:
        with worker_processes(1) as pool:
            waiting += [pool.submit(sum, range(10**6)) for _ in range(100)]
            raise KeyboardInterrupt
    except KeyboardInterrupt:
        pass
    with pytest.raises(CancelledError):
        waiting[-1].result()
    assert all(each.done() for each in waiting)
