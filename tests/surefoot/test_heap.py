"""Memory that is no longer used goes back to the system when a process comes or goes; threads share few heaps."""

import ctypes
import os
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest

from surefoot import heap
from surefoot.bus.interface import Life
from surefoot.heap import APART_S, ARENAS, hand_back
from surefoot.lockstep import node
from tests.surefoot.lockstep.node_bench import Bench

BLOCK, BLOCKS, APART = 2000, 20_000, 500

THREADS = """
import ctypes, threading
from surefoot.heap import share_heaps
share_heaps()
libc = ctypes.CDLL(None)
libc.fdopen.restype = libc.malloc.restype = ctypes.c_void_p
all_here = threading.Barrier(8)
def take():
    all_here.wait()
    libc.malloc(5000)
    all_here.wait()
threads = [threading.Thread(target=take) for _ in range(8)]
[thread.start() for thread in threads]
[thread.join() for thread in threads]
out = ctypes.c_void_p(libc.fdopen(1, b"w"))
libc.malloc_info(0, out)
libc.fflush(out)
"""
"""Program whose threads take memory at the same time, and that prints the heaps of the C library."""


def resident() -> int:
    """Memory of this process in RAM, bytes."""
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return 4096 * pages


@pytest.mark.skipif(not hasattr(ctypes.CDLL(None), "malloc_trim"), reason="the C library has no malloc_trim")
def test_heap_between_what_is_in_use_is_handed_back(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(heap, "_returned_s", [-APART_S])
    blocks = [bytes(BLOCK) for _ in range(BLOCKS)]
    kept = blocks[::APART]  # pins the heap, so that freed memory stays with the process
    del blocks
    before = resident()
    hand_back()
    assert before - resident() > 0.7 * BLOCK * BLOCKS
    assert all(len(block) == BLOCK for block in kept)


def test_hundreds_that_come_and_go_cost_one_return(monkeypatch: pytest.MonkeyPatch) -> None:
    calls: list[int] = []
    monkeypatch.setattr(heap, "_returned_s", [-APART_S])
    monkeypatch.setattr(heap.ctypes, "CDLL", lambda _: SimpleNamespace(malloc_trim=calls.append))
    for _ in range(500):
        hand_back()
    assert calls == [0]


def test_it_is_handed_back_when_a_process_comes_or_goes(monkeypatch: pytest.MonkeyPatch) -> None:
    calls: list[int] = []
    monkeypatch.setattr(node, "hand_back", lambda: calls.append(1))
    bench = Bench()
    before = len(calls)
    bench.node.handle(Life("walker", "1", False))
    bench.node.handle(Life("walker", "2", True))
    assert len(calls) == before + 2


@pytest.mark.skipif(not hasattr(ctypes.CDLL(None), "malloc_info"), reason="the C library has no malloc_info")
@pytest.mark.parametrize(("limit", "least", "most"), [(None, 1, ARENAS), ("5", ARENAS + 1, 5)])
def test_threads_share_few_heaps_unless_the_user_sets_how_many(limit: str | None, least: int, most: int) -> None:
    environment = {name: value for name, value in os.environ.items() if name != "MALLOC_ARENA_MAX"}
    environment |= {} if limit is None else {"MALLOC_ARENA_MAX": limit}
    done = subprocess.run([sys.executable, "-c", THREADS], env=environment, capture_output=True, text=True, check=True)
    assert least <= done.stdout.count("<heap nr=") <= most
