"""Limits of the file that keeps a walker's command, and what is no fault: no file, and no place for one."""

import json
from pathlib import Path
from typing import Any

import pytest

from surefoot.lockstep.memory import MOST_ID
from surefoot.services.walker.memory import MemoryFile, WalkMemory

KEPT = WalkMemory(3, None, None, None)


@pytest.mark.parametrize(
    "change", [{"walk_id": -1}, {"walk_id": MOST_ID + 1}, {"order": -1}, {"order": MOST_ID + 1}, {"of_others": 1}]
)
def test_a_field_beyond_its_limits_or_unknown_is_reported(tmp_path: Path, change: dict[str, Any]) -> None:
    path = tmp_path / "walker.json"
    MemoryFile(str(path)).keep(2, 100, KEPT)
    path.write_text(json.dumps(json.loads(path.read_text()) | change))
    memory = MemoryFile(str(path))
    assert memory.recall(2, 101) is None
    assert next(iter(change)) in memory.problem


def test_numbers_at_their_limits_are_taken(tmp_path: Path) -> None:
    path, kept = str(tmp_path / "walker.json"), WalkMemory(MOST_ID, None, None, None, order=MOST_ID)
    MemoryFile(path).keep(2, 100, kept)
    assert MemoryFile(path).recall(2, 101) == kept


def test_a_file_that_is_absent_and_a_memory_without_one_are_no_fault(tmp_path: Path) -> None:
    absent, nowhere = MemoryFile(str(tmp_path / "walker.json")), MemoryFile(None)
    assert absent.recall(2, 101) is None
    assert nowhere.recall(2, 101) is None
    nowhere.keep(2, 100, KEPT)
    assert (absent.problem, nowhere.problem) == ("", "")
