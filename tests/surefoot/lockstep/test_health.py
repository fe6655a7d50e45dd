"""Health of a service: the memory it reports."""

import mmap
import os

import pytest

from tests.surefoot.lockstep.driver_bench import Bench

BLOCK_MB = 64


def test_memory_is_what_the_process_holds_now_and_not_its_peak() -> None:
    node = Bench().node
    before = node.health().rss_mb
    with mmap.mmap(-1, BLOCK_MB * 2**20) as block:  # given back to the system when closed, unlike freed heap
        for page in range(0, len(block), os.sysconf("SC_PAGE_SIZE")):
            block[page] = 1
        assert node.health().rss_mb - before == pytest.approx(BLOCK_MB, abs=8)
    assert node.health().rss_mb == pytest.approx(before, abs=8)
