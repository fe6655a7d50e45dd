"""Memory that is no longer used goes back to the system when a process is started again."""

import ctypes
from pathlib import Path

import pytest

from surefoot.services.supervisor.processes import system
from surefoot.services.supervisor.processes.heap import hand_back
from tests.services.supervisor.processes.test_system import BOTH, World

BLOCK, BLOCKS, APART = 2000, 20_000, 500


def resident() -> int:
    """Memory of this process in RAM, bytes."""
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return 4096 * pages


@pytest.mark.skipif(not hasattr(ctypes.CDLL(None), "malloc_trim"), reason="the C library has no malloc_trim")
def test_heap_between_what_is_in_use_is_handed_back() -> None:
    blocks = [bytes(BLOCK) for _ in range(BLOCKS)]
    kept = blocks[::APART]  # pins the heap, so that freed memory stays with the process
    del blocks
    before = resident()
    hand_back()
    assert before - resident() > 0.7 * BLOCK * BLOCKS
    assert all(len(block) == BLOCK for block in kept)


def test_it_is_handed_back_at_a_restart_and_not_at_a_start(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    calls: list[int] = []
    monkeypatch.setattr(system, "hand_back", lambda: calls.append(1))
    world = World(tmp_path)
    world.steps(20, well=BOTH)
    assert not calls
    world.processes["second"].kill()
    world.steps(40, well=BOTH)
    assert world.state()["second"] == ("healthy", 1)
    assert len(calls) == 1
